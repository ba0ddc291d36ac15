from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.errors import DataError
from icgnet.objects import decomposition
from icgnet.objects.kinds import SPLITS
from icgnet.objects.model import THINNEST
from icgnet.objects.object_set import load_object_set
from icgnet.simulation.config import Physics
from icgnet.simulation.physics import Body
from icgnet.simulation.world import World


def write_meshes(folder: Path, *names: str, size: float = 50.0) -> None:
    for name in names:
        trimesh.creation.box([size, size, 2.0 * size]).apply_translation([0, 0, size]).export(folder / name)


def letter_l() -> trimesh.Trimesh:
    outline = np.array([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0, 0.06]])
    from icgnet.objects.solids import extrude

    return extrude(outline, 0.02).surface


def test_all_formats_are_read_in_the_given_units(tmp_path: Path):
    write_meshes(tmp_path, "a.obj", "b.ply", "c.stl")
    objects = load_object_set(tmp_path, units="mm")
    for key in ("a", "b", "c"):
        np.testing.assert_allclose(objects.model(key).visual.extents, [0.05, 0.05, 0.1], atol=1e-6)
        assert objects.model(key).visual.is_watertight


def test_glb_is_turned_upright(tmp_path: Path):
    trimesh.creation.box([0.05, 0.1, 0.05]).export(tmp_path / "bottle.glb")
    np.testing.assert_allclose(
        load_object_set(tmp_path, units="m").model("bottle").visual.extents, [0.05, 0.05, 0.1], atol=1e-6
    )


def test_origin_is_moved_to_the_centre_of_mass(tmp_path: Path):
    write_meshes(tmp_path, "a.stl")
    model = load_object_set(tmp_path, units="mm").model("a")
    np.testing.assert_allclose(model.visual.bounds.mean(axis=0), 0.0, atol=1e-9)
    np.testing.assert_allclose(model.parts[0].bounds.mean(axis=0), 0.0, atol=1e-9)


def test_units_must_be_known(tmp_path: Path):
    write_meshes(tmp_path, "a.stl")
    with pytest.raises(DataError, match='"units: m" or "units: mm"'):
        load_object_set(tmp_path)


def test_list_file_gives_units_classes_and_splits(tmp_path: Path):
    write_meshes(tmp_path, "a.stl", "b.stl", "c.stl")
    (tmp_path / "objects.yaml").write_text("units: mm\nclasses: {a: mug}\nsplits: {val: [b], test: [c]}\n")
    objects = load_object_set(tmp_path)
    assert [objects.names("pile", split) for split in SPLITS] == [("a",), ("b",), ("c",)]
    assert objects.names("packed", "train") == ("a",)
    assert [objects.class_name(key) for key in "abc"] == ["mug", "other", "other"]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("units: inch", "'inch'"),
        ("classes: {a: beaker}", "beaker"),
        ("splits: {train: [a]}", "val and test"),
        ("splits: {val: [a], test: [a]}", "in val and in test"),
        ("unit: mm", "expected the entries"),
        ("{", "not readable as YAML"),
    ],
)
def test_wrong_list_file_is_refused(tmp_path: Path, content: str, message: str):
    write_meshes(tmp_path, "a.stl")
    (tmp_path / "objects.yaml").write_text(content)
    with pytest.raises(DataError, match=message):
        load_object_set(tmp_path, units="mm")


def test_without_a_list_an_object_keeps_its_split_when_others_come(tmp_path: Path):
    write_meshes(tmp_path, *(f"thing{i}.stl" for i in range(40)))
    before = {key: split for split in SPLITS for key in load_object_set(tmp_path, "mm").names("pile", split)}
    write_meshes(tmp_path, "newcomer.stl")
    after = {key: split for split in SPLITS for key in load_object_set(tmp_path, "mm").names("pile", split)}
    assert before.items() <= after.items()
    assert set(before.values()) == set(SPLITS)


def test_two_files_of_one_name_are_left_out(tmp_path: Path):
    write_meshes(tmp_path, "a.stl", "a.obj", "b.obj")
    objects = load_object_set(tmp_path, units="mm")
    assert objects.keys() == ("b",)
    assert objects.left_out == {"a": "2 objects have this name"}


def test_empty_folder_is_refused(tmp_path: Path):
    with pytest.raises(DataError, match="no objects found"):
        load_object_set(tmp_path)


def test_folder_of_urdfs_uses_their_pieces(tmp_path: Path, write_object):
    write_object(tmp_path, "cube")
    objects = load_object_set(tmp_path)
    assert objects.keys() == ("cube",)
    assert len(objects.model("cube").parts) == 2


@pytest.mark.slow
def test_hollow_mesh_is_cut_into_pieces_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    pytest.importorskip("coacd", reason="needs the extra 'decompose'")
    letter_l().export(tmp_path / "l.stl")
    parts = load_object_set(tmp_path, units="m").model("l").parts
    assert len(parts) >= 2
    assert sum(part.volume for part in parts) == pytest.approx(letter_l().volume, rel=0.1)
    monkeypatch.setattr(decomposition, "_run_coacd", None)
    assert len(load_object_set(tmp_path, units="m").model("l").parts) == len(parts)


def test_without_coacd_the_hull_is_used_and_a_notice_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(__import__("sys").modules, "coacd", None)
    letter_l().export(tmp_path / "l.stl")
    objects = load_object_set(tmp_path, units="m")
    assert any("CoACD is not installed" in notice for notice in objects.notices())
    parts = objects.model("l").parts
    assert len(parts) == 1
    assert parts[0].volume > 1.2 * letter_l().volume


def test_slivers_of_a_decomposition_are_thickened_also_those_that_are_stored(tmp_path: Path, monkeypatch):
    cube = trimesh.creation.box((0.05, 0.05, 0.05)).vertices
    flat = cube * [1.0, 1.0, 0.0]
    needle = cube * [1.0, 1e-9, 1e-9]
    monkeypatch.setattr(decomposition, "_run_coacd", lambda _: [cube, flat, needle])
    letter_l().export(tmp_path / "l.stl")
    fresh = load_object_set(tmp_path, units="m").model("l")
    monkeypatch.setattr(decomposition, "_run_coacd", None)
    for model in (fresh, load_object_set(tmp_path, units="m").model("l")):
        extents = np.sort([part.extents for part in model.parts])
        np.testing.assert_allclose(extents[0], 0.05)
        np.testing.assert_allclose(extents[1], [THINNEST, 0.05, 0.05], atol=1e-9)
        np.testing.assert_allclose(extents[2], [THINNEST, THINNEST, 0.05], atol=1e-9)
        assert all(part.is_watertight for part in model.parts)
        World([Body(model, 0.7, np.eye(4))], Physics())
