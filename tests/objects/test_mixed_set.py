import pickle
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.errors import DataError, InputError
from icgnet.objects.check import check_object_set
from icgnet.objects.kinds import KINDS, SPLITS
from icgnet.objects.mixed_set import MixedObjectSet
from icgnet.objects.object_set import load_object_set


@pytest.fixture
def mesh_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "meshes"
    folder.mkdir()
    (folder / "objects.yaml").write_text("units: m\nclasses: {ball: ball}\n")
    trimesh.creation.icosphere(subdivisions=1, radius=0.03).export(folder / "ball.ply")
    return folder


@pytest.fixture
def mixed(urdf_folder: Path, mesh_folder: Path) -> MixedObjectSet:
    objects = load_object_set(f"procedural, {urdf_folder},{mesh_folder}")
    assert isinstance(objects, MixedObjectSet)
    return objects


def test_keys_name_their_set_and_the_name_joins_those_of_the_sets(mixed, urdf_folder, mesh_folder):
    assert mixed.name == "procedural+things+meshes"
    for kind in KINDS:
        for split in SPLITS:
            expected = [
                f"{member.name}:{key}"
                for member in map(load_object_set, ("procedural", urdf_folder, mesh_folder))
                for key in member.names(kind, split)
            ]
            assert list(mixed.names(kind, split)) == sorted(expected)


def test_models_grids_classes_and_fingerprints_are_those_of_the_members(mixed, urdf_folder, mesh_folder):
    (urdf_folder / "classes.json").write_text(
        '{"objects": {"cup": "mug"}, "uncertain": {"cup": "no handle left; alternative: cylindric"}}'
    )
    mixed = load_object_set(f"{urdf_folder},{mesh_folder}")
    things, meshes = load_object_set(urdf_folder), load_object_set(mesh_folder)
    assert mixed.class_name("things:pile/cup") == "mug"
    assert mixed.class_alternative("things:pile/cup") == "cylindric"
    assert mixed.class_alternative("meshes:ball") is None
    assert mixed.fingerprint("meshes:ball") == meshes.fingerprint("ball")
    model = mixed.model("things:pile/cup")
    assert model.name == "things:pile/cup"
    np.testing.assert_array_equal(model.visual.vertices, things.model("pile/cup").visual.vertices)
    np.testing.assert_array_equal(mixed.signed_distance("meshes:ball").values, meshes.signed_distance("ball").values)


def test_the_sets_travel_to_another_process_without_what_they_loaded(mixed):
    mixed.model("meshes:ball")
    copy = pickle.loads(pickle.dumps(mixed))
    assert not copy._models
    assert not copy.member_of("meshes:ball")[0]._models
    assert copy.model("meshes:ball").class_name == "ball"


@pytest.mark.parametrize("key", ["ball", "meshes:bell", "shapes:ball", "things:pile/cap"])
def test_an_unknown_key_is_refused(mixed, key):
    for ask in (mixed.class_name, mixed.fingerprint, mixed.model, mixed.signed_distance):
        with pytest.raises(InputError, match="no object"):
            ask(key)


def test_what_one_member_leaves_out_is_left_out_of_the_mixture(mixed):
    rest = mixed.without({"things:pile/cup": "cracked"})
    assert set(mixed.keys()) - set(rest.keys()) == {"things:pile/cup"}
    assert rest.left_out == {"things:pile/cup": "cracked"}
    assert "things: pile/cup is left out: cracked" in rest.notices()
    assert mixed.left_out == {}
    assert rest.name == mixed.name
    with pytest.raises(DataError, match="'pile/mug_0003' of 'procedural' cannot be used: hollow"):
        mixed.without({"procedural:pile/mug_0003": "hollow"})


def test_files_of_all_members_are_checked(mixed, urdf_folder):
    (urdf_folder / "pile" / "train" / "cup.urdf").write_text("<robot")
    reports = {report.name: report.status for report in check_object_set(mixed, mixed.keys())}
    assert {name for name, status in reports.items() if status == "broken"} == {"things:pile/cup"}
    assert reports["meshes:ball"] == "ok"
    assert len(reports) == 7, "procedural shapes come without a report"


def test_sets_of_one_name_are_not_mixed(urdf_folder, mesh_folder):
    with pytest.raises(InputError, match="2 of the object sets to be mixed are called 'procedural'"):
        load_object_set("procedural,procedural")
    with pytest.raises(InputError, match="no object set 'nowhere': give \"procedural\" or"):
        load_object_set("procedural,nowhere")
    mesh_folder.rename(mesh_folder.parent / "a:b")
    with pytest.raises(InputError, match="without ':', got 'a:b'"):
        load_object_set(f"procedural,{mesh_folder.parent / 'a:b'}")


def test_a_folder_with_a_comma_in_its_name_is_one_set(mesh_folder):
    renamed = mesh_folder.rename(mesh_folder.parent / "cups,plates")
    assert load_object_set(str(renamed)).keys() == ("ball",)


def test_wide_scenes_draw_groups_by_the_root_of_their_size(mixed):
    for split in SPLITS:
        names, weights = mixed.names("table", split), mixed.draw_weights("table", split)
        sizes, shares = Counter(map(mixed.group, names)), Counter()
        for name, weight in zip(names, weights, strict=True):
            shares[mixed.group(name)] += weight
        assert weights.sum() == pytest.approx(1.0)
        assert {"procedural:pile", "procedural:packed", "things:pile"} <= set(sizes)
        total = sum(size**0.5 for size in sizes.values())
        assert shares == pytest.approx({group: size**0.5 / total for group, size in sizes.items()})


def test_packed_and_pile_scenes_draw_all_objects_alike(mixed):
    for kind in ("packed", "pile"):
        weights = mixed.draw_weights(kind, "train")
        np.testing.assert_array_equal(weights, np.full(len(mixed.names(kind, "train")), weights[0]))
        assert weights.sum() == pytest.approx(1.0)


def test_a_set_without_objects_has_no_weights(urdf_folder):
    (urdf_folder / "val.txt").unlink()
    objects = load_object_set(urdf_folder)
    for kind in KINDS:
        assert objects.draw_weights(kind, "val").shape == (0,)
