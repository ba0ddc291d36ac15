import csv
import json
import pickle
from pathlib import Path

import numpy as np
import pytest

from icgnet.errors import DataError, InputError
from icgnet.geometry.signed_distance import PITCH
from icgnet.objects.base import cache_directory
from icgnet.objects.classes import (
    CLASSES,
    DEFINITIONS,
    VGN_CLASSES,
    VGN_VAL,
    check_class_list,
    class_index,
    known_class,
    read_alternatives,
    read_classes,
)
from icgnet.objects.kinds import CUBE_KINDS, KINDS, SPLITS
from icgnet.objects.object_set import load_object_set, warm_cache


def test_vgn_layout_is_listed_by_kind_and_split(urdf_folder: Path):
    objects = load_object_set(urdf_folder)
    assert objects.name == "things"
    assert objects.names("packed", "train") == ("packed/cup",)
    assert objects.names("pile", "val") == ("pile/brick",)
    assert objects.names("pile", "test") == ("pile/tin",)
    assert len(objects.keys()) == 6


def test_classes_come_from_the_folder_and_default_to_other(urdf_folder: Path):
    objects = load_object_set(urdf_folder)
    assert [objects.class_name(f"pile/{name}") for name in ("cup", "tin", "brick")] == ["mug", "can", "other"]
    assert objects.model("pile/cup").class_name == "mug"
    assert not load_object_set(urdf_folder)._models, "asking for a class must not load meshes"


def test_names_of_the_vgn_set_get_the_shipped_classes_and_val_split(tmp_path: Path, write_object):
    held_out = VGN_VAL.read_text().split()[0]
    write_object(tmp_path / "pile" / "train", held_out)
    write_object(tmp_path / "pile" / "train", "9d8c711750a73b06ad1d789f3b2120d0")
    objects = load_object_set(tmp_path)
    assert objects.name == "vgn"
    assert objects.names("pile", "val") == (f"pile/{held_out}",)
    assert objects.class_name("pile/9d8c711750a73b06ad1d789f3b2120d0") == "mug"


def test_name_in_train_and_test_is_left_out_of_both(urdf_folder: Path, write_object):
    write_object(urdf_folder / "pile" / "test", "cup")
    objects = load_object_set(urdf_folder)
    assert {"pile/cup", "packed/cup"} & set(objects.keys()) == {"packed/cup"}
    assert objects.left_out == {"pile/cup": "2 objects have this name"}
    with pytest.raises(InputError, match="left out: 2 objects have this name"):
        objects.model("pile/cup")


def test_wrong_class_list_is_refused(urdf_folder: Path):
    (urdf_folder / "classes.json").write_text('{"objects": {"cup": "beaker"}}')
    with pytest.raises(DataError, match="'cup' has class 'beaker'"):
        load_object_set(urdf_folder)
    (urdf_folder / "classes.json").write_text("[1")
    with pytest.raises(DataError, match=r"classes\.json"):
        load_object_set(urdf_folder)


def test_a_class_list_may_name_the_class_that_an_object_could_have_had_as_well(urdf_folder: Path):
    path = urdf_folder / "classes.json"
    path.write_text('{"objects": {"cup": "mug"}, "uncertain": {"cup": "no handle left; alternative: cylindric"}}')
    objects = load_object_set(urdf_folder)
    assert objects.class_alternative("packed/cup") == "cylindric"
    assert objects.class_alternative("packed/tin") is None
    with pytest.raises(InputError, match="saucer"):
        objects.class_alternative("packed/saucer")


@pytest.mark.parametrize(
    ("uncertain", "message"),
    [
        (["cup"], r'"uncertain" must map .* found list'),
        ({"cap": "no handle left; alternative: cylindric"}, "'cap' is not among the"),
        ({"cup": "no handle left"}, r"'cup' must end with \"alternative: CLASS\""),
        (
            {"cup": "no handle left; alternative: beaker"},
            "'cup' has the alternative 'beaker'; the classes are mug, box",
        ),
    ],
    ids=["a list", "no such object", "no alternative", "no such class"],
)
def test_a_broken_list_of_alternatives_is_named(urdf_folder: Path, uncertain, message):
    (urdf_folder / "classes.json").write_text(json.dumps({"objects": {"cup": "mug"}, "uncertain": uncertain}))
    with pytest.raises(DataError, match=message):
        load_object_set(urdf_folder)


def test_unknown_source_is_refused_with_what_is_possible(tmp_path: Path):
    with pytest.raises(InputError, match='"procedural" or an existing folder'):
        load_object_set(tmp_path / "nowhere")
    (tmp_path / "pile").mkdir()
    with pytest.raises(DataError, match=r"pile/\{train,test\}"):
        load_object_set(tmp_path)


def test_models_are_loaded_once_and_left_behind_by_pickle(urdf_folder: Path):
    objects = load_object_set(urdf_folder)
    assert objects.model("pile/cup") is objects.model("pile/cup")
    copy = pickle.loads(pickle.dumps(objects))
    assert not copy._models
    assert copy.model("pile/cup").visual.volume == pytest.approx(0.05**3)


def test_signed_distance_is_cached_on_disk(urdf_folder: Path):
    grid = load_object_set(urdf_folder).signed_distance("pile/cup")
    (path,) = (cache_directory() / "signed_distance").iterdir()
    written = path.stat().st_mtime_ns
    again = load_object_set(urdf_folder).signed_distance("pile/cup")
    np.testing.assert_array_equal(again.values, grid.values)
    assert path.stat().st_mtime_ns == written
    assert grid.distance(np.zeros((1, 3)))[0] == pytest.approx(-0.025, abs=PITCH)


def test_warm_cache_builds_every_grid(urdf_folder: Path, write_object):
    write_object(urdf_folder / "pile" / "train", "cup", size=0.02)
    assert warm_cache(load_object_set(urdf_folder)) == 6
    assert len(list((cache_directory() / "signed_distance").iterdir())) == 2, "one grid for each different surface"


@pytest.mark.slow
def test_warm_cache_works_in_other_processes(urdf_folder: Path):
    assert warm_cache(load_object_set(urdf_folder), workers=2, keys=["pile/cup", "pile/tin"]) == 2
    assert len(list((cache_directory() / "signed_distance").iterdir())) == 1


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (7, "classes must be a list of 1 to 1000 names, got 7"),
        ([], "classes must be a list"),
        (["mug", 3], "a class must have a name of 1 to 40 letters, digits and _, got 3"),
        (["mug/../.."], "a class must have a name"),
        (["mug", "box", "mug"], "different names, got mug, box, mug"),
    ],
)
def test_a_broken_list_of_classes_is_refused(names, message):
    with pytest.raises(InputError, match=message):
        check_class_list(names)
    assert check_class_list(list(CLASSES)) == CLASSES


def test_class_index_follows_the_list():
    assert [class_index(name) for name in CLASSES] == list(range(len(CLASSES)))
    assert class_index("vase", ("mug", "vase")) == 1
    with pytest.raises(InputError, match=r"'vase'.*mug, box, can"):
        class_index("vase")


def test_a_class_that_older_weights_do_not_know_is_other_for_them():
    old = ("mug", "box", "other")
    assert [known_class(name, old) for name in ("box", "bowl", "tool", "other")] == ["box", "other", "other", "other"]
    with pytest.raises(InputError, match="the class 'bowl' is not known, nor 'other'; the classes are mug, box"):
        known_class("bowl", ("mug", "box"))


def test_every_class_has_a_definition_of_one_line():
    assert set(DEFINITIONS) == set(CLASSES)
    assert len(CLASSES) == 9
    guide = (Path(__file__).parents[2] / "docs" / "guides" / "own_objects.md").read_text()
    for name, definition in DEFINITIONS.items():
        assert f"| `{name}` | {definition} |\n" in guide


def test_shipped_vgn_lists_are_consistent():
    classes = read_classes(VGN_CLASSES)
    assert len(classes) == 343
    assert set(classes.values()) == set(CLASSES)
    assert {name: classes[name] for name in ("bowl", "power_drill", "pan_poisson_017")} == {
        "bowl": "bowl", "power_drill": "tool", "pan_poisson_017": "other",
    }  # fmt: skip
    assert set(VGN_VAL.read_text().split()) <= classes.keys()
    alternatives = read_alternatives(VGN_CLASSES)
    assert alternatives["campbells_chicken_noodle_soup"] == "can"
    assert all(classes[name] != other for name, other in alternatives.items())


class TestVgn:
    def test_counts_per_split(self, vgn_objects: Path):
        objects = load_object_set(vgn_objects)
        counts = {kind: [len(objects.names(kind, split)) for split in SPLITS] for kind in CUBE_KINDS}
        assert objects.name == "vgn"
        assert counts == {"packed": [99, 15, 16], "pile": [273, 30, 40]}

    def test_val_names_are_held_out_of_both_kinds(self, vgn_objects: Path):
        objects = load_object_set(vgn_objects)
        held_out = set(VGN_VAL.read_text().split())
        for kind in KINDS:
            assert not {key.split("/")[1] for key in objects.names(kind, "train")} & held_out
            assert {key.split("/")[1] for key in objects.names(kind, "val")} <= held_out

    def test_no_name_is_in_two_splits(self, vgn_objects: Path):
        objects = load_object_set(vgn_objects)
        names = [{key.split("/")[1] for kind in KINDS for key in objects.names(kind, split)} for split in SPLITS]
        assert not names[0] & names[1]
        assert not (names[0] | names[1]) & names[2]

    def test_every_convex_group_is_a_piece(self, vgn_objects: Path):
        objects = load_object_set(vgn_objects)
        with (vgn_objects / "object_stats.csv").open() as file:
            rows = [row for row in csv.DictReader(file) if row["split"] != "blocks"][::12]
        for row in rows:
            key = f"{row['split'].split('/')[0]}/{row['name']}"
            assert len(objects.model(key).parts) == int(row["n_convex_parts"]), key

    def test_inside_out_handle_is_turned(self, vgn_objects: Path):
        visual = load_object_set(vgn_objects).model("pile/9d8c711750a73b06ad1d789f3b2120d0").visual
        assert visual.is_watertight
        assert all(component.volume > 0.0 for component in visual.split(only_watertight=False))
