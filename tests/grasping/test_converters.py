import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform, random_rotation
from icgnet.grasping.converters import (
    from_edge,
    from_graspgen,
    from_graspnet,
    from_moveit,
    from_panda_hand,
    from_vgn,
    grasps_from_poses,
    to_edge,
    to_graspgen,
    to_graspnet,
    to_moveit,
    to_panda_hand,
    to_vgn,
)
from icgnet.grasping.frame import grasp_poses
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import load_gripper

franka = load_gripper("franka")
seeds = st.integers(0, 2**32 - 1)

# A grasp from above with the tips at (0.1, 0.2, 0.3), closing along -y: approach (0, 0, -1).
FROM_ABOVE = np.array([[1.0, 0, 0, 0.1], [0, -1.0, 0, 0.2], [0, 0, -1.0, 0.3], [0, 0, 0, 1.0]])[None]
# The same hand tilted to approach along world x, closing along y.
ALONG_X = np.array([[0, 0, 1.0, 0.1], [0, 1.0, 0, 0.2], [-1.0, 0, 0, 0.3], [0, 0, 0, 1.0]])[None]


def random_poses(seed: int, count: int = 4) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return make_transform(np.stack([random_rotation(rng) for _ in range(count)]), rng.uniform(0, 0.3, (count, 3)))


def random_grasps(seed: int) -> Grasps:
    rng = np.random.default_rng(seed)
    poses = random_poses(seed)
    count = len(poses)
    scores, instances = rng.uniform(size=count), rng.integers(5, size=count)
    widths = rng.uniform(0.0, 0.06, count)
    return grasps_from_poses(poses, widths, franka.opening(widths), scores, instances, franka.finger_reach)


def from_above(opening: float) -> Grasps:
    """One grasp of an object 5 cm wide."""
    numbers = (np.array([0.05]), np.array([opening]), np.array([0.9]), np.array([3]))
    return grasps_from_poses(FROM_ABOVE, *numbers, franka.finger_reach)


PAIRS = {
    "panda_hand": (to_panda_hand, from_panda_hand),
    "vgn": (to_vgn, from_vgn),
    "edge": (to_edge, from_edge),
    "graspgen": (lambda poses: to_graspgen(poses, franka), lambda poses: from_graspgen(poses, franka)),
}


@pytest.mark.parametrize("name", PAIRS)
@given(seeds)
def test_poses_come_back_and_stay_proper(name, seed):
    there, back = PAIRS[name]
    poses = random_poses(seed)
    converted = there(poses)
    assert np.abs(np.linalg.det(converted[:, :3, :3]) - 1).max() < 1e-9
    assert np.allclose(back(converted), poses, atol=1e-12)
    assert np.allclose(there(back(poses)), poses, atol=1e-12)


@pytest.mark.parametrize("name", PAIRS)
def test_conversion_leaves_its_input_untouched(name):
    poses = FROM_ABOVE.copy()
    PAIRS[name][0](poses)
    assert np.array_equal(poses, FROM_ABOVE)


@pytest.mark.parametrize(("convert", "offset"), [(to_panda_hand, 0.1123), (to_vgn, 0.0503), (to_edge, 0.0723)])
def test_origins_lie_behind_the_tips_by_the_published_distance(convert, offset):
    above, along = convert(FROM_ABOVE)[0], convert(ALONG_X)[0]
    assert np.allclose(above[:3, 3], [0.1, 0.2, 0.3 + offset])
    assert np.allclose(along[:3, 3], [0.1 - offset, 0.2, 0.3])
    assert np.array_equal(above[:3, :3], FROM_ABOVE[0, :3, :3])


def test_edge_pose_lies_22_mm_behind_the_vgn_pose():
    # Known from the two benchmarks: p_edge = p_vgn - R (0, 0, 0.022).
    assert np.allclose(to_vgn(FROM_ABOVE)[0, :3, 3] + [0, 0, 0.022], to_edge(FROM_ABOVE)[0, :3, 3])


def test_graspgen_pose_of_a_hand_worked_grasp():
    pose = to_graspgen(FROM_ABOVE, franka)[0]
    assert np.allclose(pose[:3, 0], [0, -1, 0])  # +x closes
    assert np.allclose(pose[:3, 1], [-1, 0, 0])
    assert np.allclose(pose[:3, 2], [0, 0, -1])  # +z approaches
    assert np.allclose(pose[:3, 3], [0.1, 0.2, 0.4123])  # base link


def test_graspnet_row_of_a_hand_worked_grasp():
    row = to_graspnet(from_above(0.062), depth=0.03)[0]
    assert row.shape == (17,)
    assert np.allclose(row[:4], [0.9, 0.062, 0.02, 0.03])  # score, width of the open hand, height, depth
    rotation = row[4:13].reshape(3, 3)
    assert np.allclose(rotation[:, 0], [0, 0, -1])  # +x approaches
    assert np.allclose(rotation[:, 1], [0, -1, 0])  # +y closes
    assert np.allclose(rotation[:, 2], [-1, 0, 0])
    assert np.allclose(row[13:16], [0.1, 0.2, 0.33])  # the tips are `depth` further on
    assert row[16] == 3


@given(seeds, st.floats(0.0, 0.04))
def test_graspnet_round_trip(seed, depth):
    grasps = random_grasps(seed)
    rows = to_graspnet(grasps, depth)
    assert np.abs(np.linalg.det(rows[:, 4:13].reshape(-1, 3, 3)) - 1).max() < 1e-9
    back = from_graspnet(rows, franka)
    for field in ("poses", "widths", "openings", "scores", "instances", "contacts", "angles"):
        assert np.allclose(getattr(back, field), getattr(grasps, field), atol=1e-12)


@pytest.mark.parametrize("shape", [(17,), (3, 16), (3, 4, 4)])
def test_graspnet_rows_of_another_length_are_refused(shape):
    with pytest.raises(InputError, match=r"shape \(g, 17\), got"):
        from_graspnet(np.zeros(shape), franka)


def test_moveit_message_of_a_hand_worked_grasp():
    message = to_moveit(from_above(0.062), franka, "base", T_base_parent=np.eye(4))[0]
    assert message["grasp_pose"]["header"]["frame_id"] == "base"
    pose = message["grasp_pose"]["pose"]
    assert pose["position"] == pytest.approx({"x": 0.1, "y": 0.2, "z": 0.4123})
    assert [abs(pose["orientation"][axis]) for axis in "wxyz"] == pytest.approx([0, 1, 0, 0])
    assert message["grasp_quality"] == 0.9
    assert message["pre_grasp_posture"]["points"][0]["positions"] == pytest.approx([0.031, 0.031])
    assert message["grasp_posture"]["points"][0]["positions"] == pytest.approx([0.025, 0.025])
    assert message["grasp_posture"]["points"][0]["effort"] == [20.0, 20.0]
    assert message["pre_grasp_approach"]["direction"]["vector"] == {"x": 0.0, "y": 0.0, "z": 1.0}
    assert message["pre_grasp_approach"]["direction"]["header"]["frame_id"] == "panda_hand"
    assert message["post_grasp_retreat"]["direction"]["header"]["frame_id"] == "base"


def test_moveit_pose_is_that_of_the_arm_flange_by_default():
    pose = to_moveit(from_above(0.062), franka, "base")[0]["grasp_pose"]["pose"]
    # The Franka hand is mounted on panda_link8 turned by -45 degrees about z, at the same origin.
    assert pose["position"] == pytest.approx({"x": 0.1, "y": 0.2, "z": 0.4123})
    c, s = np.cos(np.pi / 8), np.sin(np.pi / 8)
    orientation = np.array([pose["orientation"][axis] for axis in "wxyz"])
    assert np.allclose(np.abs(orientation @ [0, c, -s, 0]), 1)


@settings(max_examples=10)
@given(seeds)
def test_moveit_round_trip_through_json(seed):
    grasps = random_grasps(seed)
    back = from_moveit(json.loads(json.dumps(to_moveit(grasps, franka, "world"))), franka)
    assert np.abs(np.linalg.det(back.poses[:, :3, :3]) - 1).max() < 1e-9
    for field in ("poses", "widths", "openings", "scores", "contacts", "angles"):
        assert np.allclose(getattr(back, field), getattr(grasps, field), atol=1e-9)
    assert (back.instances == -1).all()


def test_moveit_messages_have_exactly_the_fields_of_the_definition():
    message = to_moveit(random_grasps(0), franka, "world")[0]
    assert set(message) == {
        "id",
        "pre_grasp_posture",
        "grasp_posture",
        "grasp_pose",
        "grasp_quality",
        "pre_grasp_approach",
        "post_grasp_retreat",
        "post_place_retreat",
        "max_contact_force",
        "allowed_touch_objects",
    }


def test_a_hand_that_comes_fully_open_is_told_so_to_other_software():
    fully = from_above(franka.max_opening)
    assert to_graspnet(fully)[0, 1] == franka.max_opening
    message = to_moveit(fully, franka, "base")[0]
    assert sum(message["pre_grasp_posture"]["points"][0]["positions"]) == pytest.approx(franka.max_opening)
    assert sum(message["grasp_posture"]["points"][0]["positions"]) == pytest.approx(0.05)
    assert from_moveit([message], franka).openings == pytest.approx([franka.max_opening])


def test_no_grasps_become_no_rows_and_no_messages():
    assert to_graspnet(Grasps.empty()).shape == (0, 17)
    assert len(from_graspnet(np.zeros((0, 17)), franka)) == 0
    assert to_moveit(Grasps.empty(), franka, "world") == []
    assert len(from_moveit([], franka)) == 0
    assert to_panda_hand(np.zeros((0, 4, 4))).shape == (0, 4, 4)


@given(st.floats(0.3, 2.8), st.floats(0, 6.2), st.floats(0.0, 0.08))
def test_contact_and_angle_are_found_again_from_the_pose(polar, azimuth, width):
    normal = np.array([[np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]])
    contact = np.array([[0.1, 0.2, 0.15]])
    poses = grasp_poses(contact, normal, np.array([width]), franka.finger_reach)[0]
    widths, openings = np.full(12, width), np.full(12, 0.08)
    found = grasps_from_poses(poses, widths, openings, np.ones(12), np.zeros(12, dtype=int), franka.finger_reach)
    assert found.angles.tolist() == list(range(12))
    assert np.allclose(found.contacts, contact, atol=1e-12)


def test_moveit_retreats_from_the_table_also_in_the_camera_frame():
    grasps = random_grasps(0)
    with pytest.raises(InputError, match="give up"):
        to_moveit(grasps, franka, "camera")
    message = to_moveit(grasps, franka, "camera", up=np.array([0.0, -2.0, 0.0]))[0]
    assert message["post_grasp_retreat"]["direction"]["vector"] == {"x": 0.0, "y": -1.0, "z": 0.0}
