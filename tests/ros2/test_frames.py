"""Poses from the tree of /tf and /tf_static."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("cyclonedds", reason="needs icgnet[ros2]")

from icgnet.errors import InputError
from icgnet.geometry.transforms import (
    invert_transform,
    make_transform,
    matrix_to_quaternion,
    random_rotation,
    rotation_z,
)
from icgnet.ros2.frames import NANOSECONDS, Frames
from icgnet.ros2.messages import Header, Quaternion, Time, Transform, TransformStamped, Vector3

NOW = 100 * NANOSECONDS


def stamped(parent: str, child: str, pose: np.ndarray, seconds: float = 100.0) -> TransformStamped:
    w, x, y, z = matrix_to_quaternion(pose[:3, :3]).tolist()
    time = Time(int(seconds), round(1e9 * (seconds % 1)))
    return TransformStamped(
        Header(time, parent), child, Transform(Vector3(*pose[:3, 3].tolist()), Quaternion(x, y, z, w))
    )


def some_pose(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return make_transform(random_rotation(rng), rng.normal(size=3))


@given(seed=st.integers(0, 10_000))
def test_poses_are_chained_up_and_down_the_tree(seed):
    base, tool, camera, table = map(some_pose, range(seed, seed + 4))
    frames = Frames()
    frames.add([stamped("world", "base", base), stamped("/tool", "camera", camera)], is_fixed=True)
    frames.add([stamped("base", "tool", tool), stamped("world", "table", table)], is_fixed=False)
    np.testing.assert_allclose(frames.pose("world", "camera", NOW), base @ tool @ camera, atol=1e-9)
    np.testing.assert_allclose(frames.pose("camera", "world", 0), invert_transform(base @ tool @ camera), atol=1e-9)
    expected = invert_transform(table) @ base @ tool
    np.testing.assert_allclose(frames.pose("table", "/tool", NOW), expected, atol=1e-9)
    np.testing.assert_array_equal(frames.pose("camera", "camera", NOW), np.eye(4))


def test_a_moving_frame_is_where_it_was_then():
    frames = Frames()
    for second, angle in ((102.0, 1.0), (100.0, 0.0), (101.0, 0.5)):  # out of order
        frames.add(
            [stamped("world", "camera", make_transform(rotation_z(angle), np.array([angle, 0, 0])), second)], False
        )
    pose = frames.pose("world", "camera", int(101.5 * NANOSECONDS))
    np.testing.assert_allclose(pose, make_transform(rotation_z(0.75), np.array([0.75, 0, 0])), atol=1e-9)
    np.testing.assert_allclose(frames.pose("world", "camera", 0)[0, 3], 1.0)
    np.testing.assert_allclose(frames.pose("world", "camera", int(102.05 * NANOSECONDS))[0, 3], 1.0)


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (102.5, "newest transform of 'camera' is 0.50 s older than the image"),
        (98.0, "oldest transform of 'camera' is 2.00 s newer than the image"),
    ],
)
def test_what_is_not_known_of_that_time_is_not_guessed(seconds, said):
    frames = Frames(tolerance=0.1)
    for second in (100.0, 102.0):
        frames.add([stamped("world", "camera", np.eye(4), second)], False)
    with pytest.raises(InputError, match=said):
        frames.pose("world", "camera", int(seconds * NANOSECONDS))


def test_a_clock_that_is_set_back_starts_anew():
    frames = Frames()
    frames.add([stamped("world", "camera", some_pose(1), 1000.0)], False)
    frames.add([stamped("world", "camera", some_pose(2), 5.0)], False)
    np.testing.assert_allclose(frames.pose("world", "camera", 5 * NANOSECONDS), some_pose(2), atol=1e-9)


def test_what_is_old_is_forgotten():
    frames = Frames()
    for second in range(100, 200):
        frames.add([stamped("world", "camera", np.eye(4), float(second))], False)
    assert len(frames._moving["camera"]) == 11


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "'camera' and 'world' not known|'world' and 'camera' not known; frames of /tf are none yet"),
        ([stamped("world", "base", np.eye(4))], "'camera' not known; frames of /tf are base, world"),
        ([stamped("world", "base", np.eye(4)), stamped("tool", "camera", np.eye(4))], "not connected"),
    ],
)
def test_a_frame_that_is_not_known_is_one_line(given, said):
    frames = Frames()
    frames.add(given, is_fixed=True)
    with pytest.raises(InputError, match=said):
        frames.pose("world", "camera", NOW)


def test_a_loop_is_one_line():
    frames = Frames()
    frames.add([stamped("a", "b", np.eye(4)), stamped("b", "a", np.eye(4))], is_fixed=True)
    with pytest.raises(InputError, match="make a loop at 'b'"):
        frames.pose("world", "b", NOW)


def test_numbers_that_are_no_pose_are_left_out():
    nan, zero, itself = (stamped("world", "camera", np.eye(4)) for _ in range(3))
    nan.transform.translation.x = float("nan")
    zero.transform.rotation = Quaternion(0.0, 0.0, 0.0, 0.0)
    itself.header.frame_id = "camera"
    frames = Frames()
    frames.add([nan, zero, itself], is_fixed=True)
    with pytest.raises(InputError, match="not known"):
        frames.pose("world", "camera", NOW)
