from pathlib import Path

import pytest
import trimesh

from icgnet.errors import DataError, InputError
from icgnet.objects.check import ObjectReport, check_objects


def reports(folder: Path, units=None) -> dict[str, ObjectReport]:
    return {report.name: report for report in check_objects(folder, units)}


def test_good_objects_are_ok(urdf_folder: Path):
    found = check_objects(urdf_folder)
    assert len(found) == 6
    assert all(report.status == "ok" and not report.problems for report in found)


def test_broken_objects_are_reported_and_the_others_go_on(urdf_folder: Path):
    train = urdf_folder / "pile" / "train"
    (train / "cup.urdf").write_text("<robot")
    (train / "brick_visual.obj").unlink()
    found = reports(urdf_folder)
    assert found["pile/cup"].status == "broken"
    assert "broken URDF" in found["pile/cup"].problems[0]
    assert "missing mesh" in found["pile/brick"].problems[0]
    assert found["pile/tin"].status == "ok"


def test_name_in_two_splits_is_broken(urdf_folder: Path, write_object):
    write_object(urdf_folder / "pile" / "test", "cup")
    assert "2 objects have this name" in reports(urdf_folder)["pile/cup"].problems


def test_impossible_units_are_broken_and_open_meshes_a_warning(tmp_path: Path):
    trimesh.creation.box([50, 50, 80]).export(tmp_path / "huge.stl")
    trimesh.creation.box([0.0003, 0.0003, 0.0004]).export(tmp_path / "tiny.stl")
    box = trimesh.creation.box([0.05, 0.05, 0.05])
    trimesh.Trimesh(box.vertices, box.faces[2:], process=False).export(tmp_path / "open.stl")
    found = reports(tmp_path, "m")
    assert [found[name].status for name in ("huge", "tiny", "open")] == ["broken", "broken", "warning"]
    assert "80 m: are the units right?" in found["huge"].problems[0]
    assert "are the units right?" in found["tiny"].problems[0]
    assert "open" in found["open"].problems[0]


def test_empty_unreadable_and_double_meshes_are_broken(tmp_path: Path):
    (tmp_path / "empty.obj").write_text("v 0 0 0\n")
    (tmp_path / "garbage.ply").write_bytes(b"ply\nnothing")
    for suffix in ("stl", "obj"):
        trimesh.creation.box([0.05, 0.05, 0.05]).export(tmp_path / f"twice.{suffix}")
    found = reports(tmp_path, "m")
    assert {name: report.status for name, report in found.items()} == dict.fromkeys(found, "broken")
    assert "empty" in found["empty"].problems[0] or "cannot read" in found["empty"].problems[0]
    assert "cannot read the mesh" in found["garbage"].problems[0]
    assert "2 objects have this name" in found["twice"].problems


def test_meshes_without_units_are_broken(tmp_path: Path):
    trimesh.creation.box([0.05, 0.05, 0.05]).export(tmp_path / "a.stl")
    assert "units unknown" in reports(tmp_path)["a"].problems[0]
    (tmp_path / "objects.yaml").write_text("units: m")
    assert reports(tmp_path)["a"].status == "ok"


def test_no_folder_and_no_objects_are_errors(tmp_path: Path):
    with pytest.raises(InputError, match="not a folder"):
        check_objects(tmp_path / "nowhere")
    with pytest.raises(DataError, match="no URDFs or meshes"):
        check_objects(tmp_path)
