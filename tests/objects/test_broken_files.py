"""A folder with one object for every fault: each is named with what is wrong, and the good one goes on."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.cli.main import main
from icgnet.errors import DataError
from icgnet.objects.check import check_objects
from icgnet.objects.model import clean_surface
from icgnet.objects.object_set import load_object_set

SQUARE = np.array([[0, 0, 0], [0.05, 0, 0], [0.05, 0.05, 0], [0, 0.05, 0]])


def square(two_sided: bool) -> trimesh.Trimesh:
    faces = [[0, 1, 2], [0, 2, 3], [0, 2, 1], [0, 3, 2]]
    return trimesh.Trimesh(SQUARE, faces if two_sided else faces[:2], process=False)


def sheet_rolled_into_a_tube(two_sided: bool) -> trimesh.Trimesh:
    tube = trimesh.creation.cylinder(0.03, 0.06, sections=24)
    wall = tube.faces[np.abs(tube.face_normals[:, 2]) < 0.5]
    faces = np.concatenate([wall, wall[:, ::-1]]) if two_sided else wall
    return trimesh.Trimesh(tube.vertices, faces, process=False)


def box_with_a_corner_through_the_opposite_one() -> trimesh.Trimesh:
    mesh = trimesh.creation.box([0.05, 0.05, 0.05]).subdivide().subdivide()
    vertices = mesh.vertices.copy()
    vertices[(vertices @ [1, 1, 1]).argmax()] = [-0.04, -0.04, -0.04]
    return trimesh.Trimesh(vertices, mesh.faces, process=False)


def replace_first_vertex(path: Path, text: str) -> None:
    lines = path.read_text().splitlines()
    lines[next(row for row, line in enumerate(lines) if line.startswith("v "))] = f"v {text}"
    path.write_text("\n".join(lines))


FAULTS: dict[str, tuple[Callable[[Path], object], str, str]] = {
    "broken_xml": (lambda at: (at / "broken_xml.urdf").write_text("<robot><link"), "broken", "broken URDF"),
    "missing": (lambda at: (at / "missing_visual.obj").unlink(), "broken", "missing mesh"),
    "no_pieces": (lambda at: (at / "no_pieces_collision.obj").unlink(), "broken", "missing mesh"),
    "visual_in_mm": (
        lambda at: trimesh.creation.box([50, 50, 50]).export(at / "visual_in_mm_visual.obj"),
        "broken",
        "50 m long, the collision geometry 0.05 m: are the units right?",
    ),
    "empty": (lambda at: (at / "empty_visual.obj").write_text(""), "broken", "empty"),
    "nan": (lambda at: replace_first_vertex(at / "nan_visual.obj", "nan 0 0"), "broken", "not finite numbers"),
    "infinite": (lambda at: replace_first_vertex(at / "infinite_visual.obj", "inf 0 0"), "broken", "not finite"),
    "nan_piece": (lambda at: replace_first_vertex(at / "nan_piece_collision.obj", "nan 0 0"), "broken", "NaN"),
    "flat": (lambda at: square(False).export(at / "flat_visual.obj"), "broken", "flat"),
    "two_sided": (lambda at: square(True).export(at / "two_sided_visual.obj"), "broken", "flat"),
    "flat_piece": (lambda at: square(False).export(at / "flat_piece_collision.obj"), "broken", "convex group is flat"),
    "open": (lambda at: sheet_rolled_into_a_tube(False).export(at / "open_visual.obj"), "warning", "open"),
    "open_two_sided": (
        lambda at: sheet_rolled_into_a_tube(True).export(at / "open_two_sided_visual.obj"),
        "warning",
        "open",
    ),
    "crossing": (
        lambda at: box_with_a_corner_through_the_opposite_one().export(at / "crossing_visual.obj"),
        "warning",
        "intersects itself",
    ),
}
"""Name -> what is done to the files of a good object, the verdict and part of the report."""


@pytest.fixture
def folder(tmp_path: Path, write_object) -> Path:
    train = tmp_path / "things" / "pile" / "train"
    write_object(train, "good")
    write_object(train, "in_mm", 50.0)
    for name, (spoil, _, _) in FAULTS.items():
        write_object(train, name)
        spoil(train)
    for split in ("train", "test"):
        write_object(train.parent / split, "twin")
    return tmp_path / "things"


def test_every_fault_is_reported_by_name_and_the_good_object_is_in_order(folder: Path):
    reports = {report.name: report for report in check_objects(folder)}
    assert reports["pile/good"].status == "ok"
    for name, (_, status, words) in FAULTS.items():
        report = reports[f"pile/{name}"]
        assert report.status == status, report
        assert words in "; ".join(report.problems), report
        assert all("\n" not in problem for problem in report.problems)
    assert "are the units right?" in reports["pile/in_mm"].problems[0]
    assert "2 objects have this name" in reports["pile/twin"].problems


def test_the_command_names_them_all_and_ends_with_an_error(folder: Path, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    assert main(["objects", "check", str(folder)]) == 2
    output = capsys.readouterr()
    for name in (*FAULTS, "in_mm", "twin"):
        assert f"pile/{name}" in output.out
    assert "cannot be used" in output.err


def test_a_broken_object_does_not_keep_the_others_from_loading(tmp_path: Path, write_object):
    train = tmp_path / "pile" / "train"
    write_object(train, "good")
    write_object(train, "flat")
    square(False).export(train / "flat_visual.obj")
    objects = load_object_set(tmp_path)
    assert objects.model("pile/good").visual.is_watertight
    with pytest.raises(DataError, match="flat"):
        objects.model("pile/flat")


def test_the_second_side_of_a_sheet_is_dropped():
    one, two = (clean_surface(sheet_rolled_into_a_tube(sides), "tube") for sides in (False, True))
    assert len(one.faces) == len(two.faces)


def test_unused_vertices_that_are_not_finite_do_no_harm():
    box = trimesh.creation.box([0.05, 0.05, 0.05])
    vertices = np.vstack([box.vertices, [np.nan, 0.0, 0.0]])
    assert clean_surface(trimesh.Trimesh(vertices, box.faces, process=False), "box").is_watertight
