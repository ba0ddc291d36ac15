"""Files that say where the arm was."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from icgnet.camera_calibration.poses import read_poses
from icgnet.errors import DataError, InputError
from icgnet.geometry.transforms import make_transform, quaternion_to_matrix

WXYZ = np.array([0.5, 0.5, -0.5, 0.5])
TRUE = make_transform(quaternion_to_matrix(WXYZ), np.array([0.4, -0.1, 0.5]))


def written(path: Path, entries: object) -> Path:
    path.write_text(json.dumps(entries) if path.suffix == ".json" else yaml.safe_dump(entries))
    return path


@pytest.mark.parametrize("name", ["poses.yaml", "poses.json"])
@pytest.mark.parametrize(
    "entry",
    [
        {"T_base_tool": TRUE.tolist()},
        {"T_base_tool": [0.4, -0.1, 0.5, *WXYZ.tolist()]},
        {"position": [0.4, -0.1, 0.5], "quaternion_xyzw": [0.5, -0.5, 0.5, 0.5]},
    ],
)
def test_all_forms_say_the_same(tmp_path, name, entry):
    poses = read_poses(written(tmp_path / name, [{"image": "a.png"} | entry]))
    assert list(poses) == ["a.png"]
    np.testing.assert_allclose(poses["a.png"], TRUE, atol=1e-9)


def test_a_table_says_the_same(tmp_path):
    (tmp_path / "poses.csv").write_text("image, qx, qy, qz, qw, x, y, z\na.png, 0.5, -0.5, 0.5, 0.5, 0.4, -0.1, 0.5\n")
    np.testing.assert_allclose(read_poses(tmp_path / "poses.csv")["a.png"], TRUE, atol=1e-9)


def test_joints_are_turned_into_poses_by_the_arm(tmp_path):
    path = written(tmp_path / "poses.yaml", [{"image": "a.png", "joints": [0.1, 0.2]}])
    poses = read_poses(path, lambda joints: make_transform(np.eye(3), np.array([*joints, 0.0])))
    assert poses["a.png"][:3, 3].tolist() == [0.1, 0.2, 0.0]
    with pytest.raises(DataError, match="has joints: say with --arm of which arm they are"):
        read_poses(path)


LEFT_HANDED = TRUE @ np.diag([1.0, 1.0, -1.0, 1.0])


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({}, "must be a list of entries with image and T_base_tool"),
        ([7], "entry 1 must have image and one of"),
        ([{"image": "a.png"}], "entry 1 must have image and one of"),
        ([{"image": "a.png", "T_base_tool": TRUE.tolist(), "joints": [0.0]}], "entry 1 must have image and one of"),
        (
            [{"image": "a.png", "T_base_tool": LEFT_HANDED.tolist()}],
            "entry 1 (a.png): T_base_tool must be right-handed",
        ),
        ([{"image": "a.png", "T_base_tool": [400, -100, 500, *WXYZ.tolist()]}], "that looks like millimetres"),
        (
            [{"image": "a.png", "T_base_tool": [8, 0, 6, *WXYZ.tolist()]}],
            "must be in metres: 10 m is farther than an arm",
        ),
        ([{"image": "a.png", "T_base_tool": [0, 0, 0, 1, 1, 0, 0]}], "of length 1, got length 1.41"),
        ([{"image": "a.png", "position": [0, 0], "quaternion_xyzw": [0, 0, 0, 1]}], "position must have shape (3,)"),
        ([{"image": "a.png", "T_base_tool": np.eye(4).tolist()}] * 2, "there is a pose for a.png already"),
    ],
)
def test_wrong_entries_are_refused_by_their_name(tmp_path, entries, message):
    with pytest.raises(DataError) as error:
        read_poses(written(tmp_path / "poses.yaml", entries))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("image,x,y,z\na.png,0,0,0\n", "must have the columns image, x, y, z, qx, qy, qz, qw, got image, x, y, z"),
        ("image,x,y,z,qx,qy,qz,qw\na.png,0,0,0,0,0,0,one\n", "entry 1: x, y, z, qx, qy, qz, qw must be numbers"),
        ("image,x,y,z,qx,qy,qz,qw\na.png,0,0\n", "entry 1: x, y, z, qx, qy, qz, qw must be numbers"),
    ],
)
def test_wrong_tables_are_refused(tmp_path, text, message):
    (tmp_path / "poses.csv").write_text(text)
    with pytest.raises(DataError) as error:
        read_poses(tmp_path / "poses.csv")
    assert message in str(error.value)


def test_a_file_that_is_none_is_refused(tmp_path):
    with pytest.raises(InputError, match="no such file with poses"):
        read_poses(tmp_path / "poses.yaml")
    (tmp_path / "poses.yaml").write_text("[1, ")
    with pytest.raises(DataError, match="cannot be read"):
        read_poses(tmp_path / "poses.yaml")
