import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.errors import DataError
from icgnet.objects import decomposition
from icgnet.objects.check import check_object_set, check_objects, missing_units
from icgnet.objects.classes import CLASSES
from icgnet.objects.kinds import SPLITS
from icgnet.objects.mesh_folder import SHIPPED_LISTS
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
        ("scales: [2]", "scales map names"),
        ("scales: {a: [1, 2]}", r"scale of 'a' must be one or three positive numbers, got \[1, 2\]"),
        ("scales: {a: -1}", "one or three positive numbers, got -1"),
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


def test_folders_in_the_folder_are_part_of_the_keys_and_hidden_ones_are_not_looked_at(tmp_path: Path):
    for folder in ("kitchen", "kitchen/cups", ".trash"):
        (tmp_path / folder).mkdir()
    write_meshes(tmp_path, "a.stl", "kitchen/a.stl", "kitchen/cups/b.ply", ".trash/c.stl", "._a.stl")
    (tmp_path / "objects.yaml").write_text(
        "units: mm\nclasses: {kitchen/cups/b: mug}\nsplits: {val: [kitchen/a], test: [kitchen/cups/b]}\n"
    )
    objects = load_object_set(tmp_path)
    assert [objects.names("table", split) for split in SPLITS] == [("a",), ("kitchen/a",), ("kitchen/cups/b",)]
    assert objects.class_name("kitchen/cups/b") == "mug"
    assert [objects.group(key) for key in ("a", "kitchen/a", "kitchen/cups/b")] == ["", "kitchen", "kitchen/cups"]
    assert {report.name for report in check_objects(tmp_path)} == set(objects.keys())


def test_meshes_that_are_not_of_their_real_size_are_scaled_by_folder_or_name(tmp_path: Path):
    (tmp_path / "flat").mkdir()
    write_meshes(tmp_path, "a.stl", "flat/b.stl", "flat/c.stl")
    before, keys = load_object_set(tmp_path, "mm"), ("a", "flat/b", "flat/c")
    marks = {key: before.fingerprint(key) for key in keys}
    (tmp_path / "objects.yaml").write_text("units: mm\nscales: {flat: [2, 1, 0.1], flat/c: 0.5}\n")
    objects = load_object_set(tmp_path)
    sizes = {key: objects.model(key).visual.extents for key in keys}
    np.testing.assert_allclose(sizes["a"], [0.05, 0.05, 0.1])
    np.testing.assert_allclose(sizes["flat/b"], [0.1, 0.05, 0.01])
    np.testing.assert_allclose(sizes["flat/c"], [0.025, 0.025, 0.05])
    changed = {key for key in marks if objects.fingerprint(key) != marks[key]}
    assert changed == {"flat/b", "flat/c"}


def test_a_mesh_of_no_objects_size_is_named_and_does_not_keep_the_others_from_loading(tmp_path: Path):
    write_meshes(tmp_path, "a.stl")
    write_meshes(tmp_path, "house.stl", size=1500.0)
    (tmp_path / "text.stl").write_text("no mesh at all")
    objects = load_object_set(tmp_path, "mm")
    with pytest.raises(DataError, match=r"house\.stl: the longest side is 3 m: are the units right\?"):
        objects.model("house")
    with pytest.raises(DataError, match=r"text\.stl: cannot read the mesh|text\.stl: the mesh is empty"):
        objects.model("text")
    assert objects.model("a").class_name == "other"
    status = {report.name: report.status for report in check_object_set(objects, objects.keys())}
    assert status == {"a": "ok", "house": "broken", "text": "broken"}


def test_published_meshes_are_known_by_their_names(tmp_path: Path):
    for folder in ("hope", "kit"):
        (tmp_path / folder).mkdir()
    write_meshes(tmp_path, "hope/milk.stl", size=0.05)
    write_meshes(tmp_path, "kit/03.stl", size=20.0)
    objects = load_object_set(tmp_path)
    assert objects.name == "objects_wide"
    assert objects.class_name("hope/milk") == "box"
    assert objects.names("bin", "test") == ("hope/milk",)
    np.testing.assert_allclose(objects.model("kit/03").visual.extents, [0.06, 0.06, 0.04])
    assert all(report.status == "ok" for report in check_objects(tmp_path))
    assert not missing_units(tmp_path)
    write_meshes(tmp_path, "hope/my_own.stl", size=0.05)
    with pytest.raises(DataError, match="in which units"):
        load_object_set(tmp_path)
    assert missing_units(tmp_path)
    (tmp_path / "hope" / "my_own.stl").unlink()
    (tmp_path / "objects.yaml").write_text("units: m\n")
    assert load_object_set(tmp_path).class_name("hope/milk") == "other", "a list in the folder counts alone"


def test_the_shipped_list_holds_out_a_tenth_of_every_folder_and_no_thing_twice():
    listed = json.loads(SHIPPED_LISTS["objects_wide"].read_text())
    classes, val, test = listed["classes"], set(listed["splits"]["val"]), set(listed["splits"]["test"])
    assert len(classes) == 666
    assert set(classes.values()) == set(CLASSES)
    assert val | test <= classes.keys()
    assert not val & test
    for folder in {name.split("/")[0] for name in classes}:
        names = {name for name in classes if name.startswith(f"{folder}/")}
        for held_out in (val, test):
            assert 0.06 <= len(names & held_out) / len(names) <= 0.14, folder
    same = ("objsim/mug objsim/coffeemug", "hope/milk hope/orange_juice", "urdfm/blue_plate urdfm/grey_plate",
            "urdfm/green_bowl urdfm/yellow_bowl", "urdfm/blue_cup urdfm/green_cup urdfm/orange_cup urdfm/yellow_cup",
            "objsim/duck objsim/rubberduck", "hope/red_bowl hope/white_bowl")  # fmt: skip
    for names in map(str.split, same):
        assert len({(name in val, name in test) for name in names}) == 1, names


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


def test_convex_components_are_pieces_and_too_many_are_joined(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    monkeypatch.setattr(decomposition, "find_spec", lambda _: True)
    monkeypatch.setattr(decomposition, "_run_coacd", None)
    ball = trimesh.creation.icosphere(subdivisions=1, radius=0.01)
    row = [ball.copy().apply_translation([0.015 * place, 0.0, 0.0]) for place in range(6)]
    pieces = decomposition.decompose(trimesh.util.concatenate(row), tmp_path)
    assert sorted(round(float(piece.bounds.mean(axis=0)[0]), 4) for piece in pieces) == [
        0.0, 0.015, 0.03, 0.045, 0.06, 0.075,
    ]  # fmt: skip
    monkeypatch.setattr(decomposition, "MOST_PIECES", 3)
    far = ball.copy().apply_translation([0.0, 0.3, 0.0])
    joined = decomposition.decompose(trimesh.util.concatenate([*row, far]), tmp_path)
    assert len(joined) == 3
    assert min(piece.volume for piece in joined) == pytest.approx(ball.volume), "what is far away stays on its own"
    assert max(piece.extents[1] for piece in joined) == pytest.approx(0.02, abs=0.001)


@pytest.mark.slow
def test_cutting_the_same_mesh_again_gives_the_same_pieces(tmp_path: Path):
    pytest.importorskip("coacd", reason="needs the extra 'decompose'")
    first, second = (decomposition.decompose(letter_l(), tmp_path / folder) for folder in "ab")
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)


def test_slivers_of_a_decomposition_are_thickened_also_those_that_are_stored(tmp_path: Path, monkeypatch):
    cube = trimesh.creation.box((0.05, 0.05, 0.05)).vertices
    flat = cube * [1.0, 1.0, 0.0]
    needle = cube * [1.0, 1e-9, 1e-9]
    monkeypatch.setattr(decomposition, "find_spec", lambda name: name)  # as if CoACD were installed
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
