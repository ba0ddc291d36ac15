"""The file that says where the camera is."""

import json

import numpy as np
import pytest
import yaml

import needs_arm  # noqa: F401
from icgnet.arm.hand_eye import HandEye
from icgnet.errors import DataError, InputError
from icgnet.geometry.transforms import check_pose

POSE = [0.4, 0.1, 0.7, 0.0, 1.0, 0.0, 0.0]


def test_a_camera_beside_the_arm(tmp_path, fr3):
    (tmp_path / "eye.yaml").write_text(yaml.safe_dump({"T_base_camera": POSE}))
    pose = HandEye.read(tmp_path / "eye.yaml").pose(fr3)
    np.testing.assert_allclose(pose[:3, 3], POSE[:3])
    np.testing.assert_allclose(pose[:3, :3], np.diag([1.0, -1.0, -1.0]), atol=1e-9)


def test_a_camera_on_the_arm_moves_with_it(tmp_path, fr3):
    T_tool_camera = np.eye(4)
    T_tool_camera[0, 3] = 0.06
    entries = {"T_tool_camera": T_tool_camera.tolist(), "joints": fr3.home.tolist()}
    (tmp_path / "eye.json").write_text(json.dumps(entries))
    pose = HandEye.read(tmp_path / "eye.json").pose(fr3)
    np.testing.assert_allclose(pose, fr3.mount_pose(fr3.home) @ T_tool_camera, atol=1e-9)


@pytest.mark.parametrize("name", ["eye.yaml", "eye.json"])
@pytest.mark.parametrize(
    "eye",
    [
        HandEye(T_base_camera=check_pose(POSE, "pose")),
        HandEye(T_tool_camera=np.eye(4)),
        HandEye(T_tool_camera=np.eye(4), joints=np.array([0.1, 0.2])),
    ],
)
def test_what_is_written_is_read_back(tmp_path, name, eye):
    eye.write(tmp_path / name, ["a note"])
    again = HandEye.read(tmp_path / name)
    for entry in ("T_base_camera", "T_tool_camera", "joints"):
        first, second = getattr(eye, entry), getattr(again, entry)
        assert (first is None) == (second is None)
        np.testing.assert_allclose(first if first is not None else 0.0, second if second is not None else 0.0)


def test_a_file_of_another_kind_is_not_written(tmp_path):
    with pytest.raises(InputError, match=r"a hand-eye file ends in .yaml, .yml, .json, got 'eye.txt'"):
        HandEye(T_tool_camera=np.eye(4)).write(tmp_path / "eye.txt")


def test_a_camera_on_the_arm_needs_the_joints_of_the_picture(fr3):
    with pytest.raises(InputError, match="the camera is on the arm: give --joints"):
        HandEye(T_tool_camera=np.eye(4)).pose(fr3)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({}, "must hold T_base_camera"),
        ({"joints": [0.0] * 7}, "T_tool_camera and perhaps joints"),
        ({"T_base_camera": POSE, "joints": [0.0] * 7}, "must hold T_base_camera"),
        ({"T_base_camera": [400.0, 100.0, 700.0, 0, 1, 0, 0]}, "looks like millimetres"),
        ({"T_base_camera": np.diag([1.0, 1.0, -1.0, 1.0]).tolist()}, "right-handed"),
        ({"T_tool_camera": [60.0, 0, 0, 1, 0, 0, 0], "joints": [0.0] * 7}, "T_tool_camera must be in metres"),
    ],
)
def test_a_wrong_file_is_refused_in_one_line(tmp_path, entries, message):
    (tmp_path / "eye.yaml").write_text(yaml.safe_dump(entries))
    with pytest.raises(DataError) as error:
        HandEye.read(tmp_path / "eye.yaml")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_joints_of_another_arm_are_refused(fr3):
    with pytest.raises(InputError, match="joints must have shape"):
        HandEye.from_dict({"T_tool_camera": POSE[:0] + [0, 0, 0.1, 1, 0, 0, 0], "joints": [0.0] * 6}).pose(fr3)
