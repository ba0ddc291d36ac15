"""The file that says where the camera is."""

import json

import numpy as np
import pytest
import yaml

import needs_arm  # noqa: F401
from icgnet.arm.hand_eye import HandEye
from icgnet.errors import DataError, InputError

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


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({}, "must hold T_base_camera"),
        ({"T_tool_camera": POSE}, "and joints"),
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
