from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.errors import InputError
from icgnet.objects import check
from icgnet.objects.base import FileObjectSet, ObjectSet
from icgnet.objects.check import check_object_set, check_objects
from icgnet.objects.object_set import load_object_set
from icgnet.objects.procedural import ProceduralObjectSet


def fingerprints(objects: ObjectSet) -> dict[str, str]:
    keys = objects.keys()
    return {key: objects.fingerprint(key) for key in keys}


def changed(before: dict[str, str], after: dict[str, str]) -> set[str]:
    assert before.keys() == after.keys()
    return {key for key in before if before[key] != after[key]}


def test_a_fingerprint_changes_with_each_file_of_an_object(urdf_folder: Path):
    before = fingerprints(load_object_set(urdf_folder))
    for name in ("cup_visual.obj", "cup_collision.obj", "cup.urdf"):
        path = urdf_folder / "pile" / "train" / name
        text = path.read_text()
        path.write_text(text + "\n")
        assert changed(before, fingerprints(load_object_set(urdf_folder))) == {"pile/cup"}
        path.write_text(text)
    assert fingerprints(load_object_set(urdf_folder)) == before


def test_a_fingerprint_changes_with_the_class_that_recipes_store(urdf_folder: Path):
    before = fingerprints(load_object_set(urdf_folder))
    (urdf_folder / "classes.json").write_text('{"objects": {"cup": "box", "tin": "can"}}')
    assert changed(before, fingerprints(load_object_set(urdf_folder))) == {"packed/cup", "pile/cup"}


def test_a_fingerprint_changes_with_the_units_and_not_with_the_place(tmp_path: Path):
    for folder in ("here", "there"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "cube.obj").write_text(trimesh.creation.box([0.05] * 3).export(file_type="obj"))
    here, there = (load_object_set(tmp_path / folder, units="m") for folder in ("here", "there"))
    assert here.fingerprint("cube") == there.fingerprint("cube")
    assert here.fingerprint("cube") != load_object_set(tmp_path / "here", units="mm").fingerprint("cube")


def test_missing_and_broken_files_have_fingerprints_too(urdf_folder: Path):
    train = urdf_folder / "pile" / "train"
    before = fingerprints(load_object_set(urdf_folder))
    (train / "cup_visual.obj").unlink()
    (train / "brick.urdf").write_text("<robot")
    assert changed(before, fingerprints(load_object_set(urdf_folder))) == {"pile/cup", "pile/brick"}


def test_an_unknown_object_has_no_fingerprint(urdf_folder: Path):
    for objects in (load_object_set(urdf_folder), ProceduralObjectSet()):
        with pytest.raises(InputError, match="no object 'pile/cap'"):
            objects.fingerprint("pile/cap")


def test_every_procedural_shape_has_a_fingerprint_of_its_own():
    marks = fingerprints(ProceduralObjectSet())
    assert len(set(marks.values())) == len(marks)


def test_a_set_without_some_objects_says_why_and_leaves_the_first_one_alone(urdf_folder: Path):
    objects = load_object_set(urdf_folder)
    assert isinstance(objects, FileObjectSet)
    rest = objects.without({"pile/cup": "cracked"})
    assert set(objects.keys()) - set(rest.keys()) == {"pile/cup"}
    assert rest.left_out == {"pile/cup": "cracked"}
    assert objects.left_out == {}


def test_reports_are_remembered_until_a_file_changes(urdf_folder: Path, monkeypatch: pytest.MonkeyPatch):
    objects = load_object_set(urdf_folder)
    first = check_object_set(objects, objects.keys())
    in_folder = sorted(check_objects(urdf_folder), key=lambda report: report.name)
    assert first == in_folder, "a set and its folder are judged alike"
    with monkeypatch.context() as patch:
        patch.setattr(check, "_report", None)
        assert check_object_set(load_object_set(urdf_folder), objects.keys()) == first
    (urdf_folder / "pile" / "train" / "cup_visual.obj").unlink()
    again = {report.name: report.status for report in check_object_set(objects, objects.keys())}
    assert {name for name, status in again.items() if status != "ok"} == {"pile/cup"}


def test_a_damaged_memory_is_replaced(urdf_folder: Path):
    objects = load_object_set(urdf_folder)
    first = check_object_set(objects, objects.keys())
    (path,) = (check.cache_directory() / "object_checks").iterdir()
    path.write_text("[{")
    assert check_object_set(objects, objects.keys()) == first
    assert path.read_text() != "[{"


def test_a_mesh_that_crosses_itself_is_told_from_overlapping_parts(tmp_path: Path):
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.03)
    vertices = np.array(ball.vertices)
    vertices[0] *= -1.5
    trimesh.Trimesh(vertices, ball.faces, process=False).export(tmp_path / "crossed.ply")
    ball.export(tmp_path / "ball.ply")
    handle = trimesh.creation.box([0.08, 0.01, 0.01])
    trimesh.util.concatenate([ball, handle]).export(tmp_path / "handled.ply")
    found = {report.name: report for report in check_objects(tmp_path, "m")}
    assert {name: report.status for name, report in found.items()} == {
        "crossed": "warning", "ball": "ok", "handled": "ok",
    }  # fmt: skip
    assert "intersects itself" in found["crossed"].problems[0]
