from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icgnet.geometry.transforms import make_transform, random_rotation, rotation_z
from icgnet.grasping.collision import Reason, check_collisions, draw_back, hits_points, hits_table
from icgnet.grasping.frame import grasp_poses
from icgnet.grasping.gripper import load_gripper
from reference import hand_meets, points_in_hand

TABLE = 0.05
BALL = np.array([0.15, 0.15, 0.08])
RADIUS = 0.03
DOWN = np.array([[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]])
ALONG_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])

franka = load_gripper("franka")


def ball(centre=BALL, radius=RADIUS):
    return lambda points: (np.linalg.norm(points - centre, axis=1) < radius).astype(float)


def box(lower, upper):
    return lambda points: ((points >= lower) & (points <= upper)).all(axis=1).astype(float)


def either(*fields):
    return lambda points: np.max([field(points) for field in fields], axis=0)


def empty(points):
    return np.zeros(len(points))


def from_above(x=0.15, y=0.15, tips=0.075) -> np.ndarray:
    return make_transform(DOWN, np.array([x, y, tips]))[None]


def reason(poses, occupancy, opening=0.072, points=None, approach=0.05, gripper=franka) -> Reason:
    openings = np.full(len(poses), opening)
    found = check_collisions(poses, openings, gripper, occupancy, TABLE, points, approach)
    assert len(found.reason) == 1
    return Reason(found.reason[0])


def test_open_hand_around_a_ball_is_free():
    assert reason(from_above(), ball()) == Reason.FREE


def test_grasp_through_the_table_is_rejected():
    assert reason(from_above(tips=0.0501), empty) == Reason.FREE
    assert reason(from_above(tips=0.0499), empty) == Reason.TABLE


def test_level_hand_is_rejected_when_its_palm_dips_into_the_table():
    # Closing along y, approaching along x: the hand's x axis is vertical and its palm reaches 31.6 mm down.
    for height, expected in ((0.0815, Reason.TABLE), (0.0817, Reason.FREE)):
        pose = make_transform(ALONG_X, np.array([0.15, 0.15, height]))[None]
        assert reason(pose, empty) == expected


def test_grasp_from_below_is_rejected_for_the_table_on_its_way():
    up = DOWN @ np.diag([1.0, -1.0, -1.0])
    pose = make_transform(up, np.array([0.15, 0.15, 0.25]))[None]
    assert reason(pose, empty, approach=0.05) == Reason.FREE
    assert reason(pose, empty, approach=0.07) == Reason.TABLE
    assert not hits_table(pose, np.array([0.08]), franka, TABLE)[0]


def test_hand_inside_its_own_target_collides():
    assert reason(from_above(), ball(), opening=0.05) == Reason.OBJECT
    assert reason(from_above(y=0.165), ball()) == Reason.OBJECT
    assert (
        reason(from_above(tips=0.055), ball(centre=BALL + np.array([0, 0, 0.02]))) == Reason.OBJECT
    )  # palm on its top


def test_box_between_the_pads_is_free_until_it_is_wider_than_the_opening():
    for half_width, expected in ((0.035, Reason.FREE), (0.037, Reason.OBJECT)):
        field = box([0.14, 0.15 - half_width, TABLE], [0.16, 0.15 + half_width, 0.1])
        assert reason(from_above(), field, opening=0.072) == expected


def test_neighbour_beside_the_target_is_found():
    for gap, expected in ((0.0, Reason.OBJECT), (0.06, Reason.FREE)):
        neighbour = box([0.13, 0.15 + RADIUS + gap, TABLE], [0.17, 0.15 + RADIUS + gap + 0.02, 0.09])
        assert reason(from_above(), either(ball(), neighbour)) == expected


def test_neighbour_in_the_way_of_the_approach_is_found():
    pose = make_transform(ALONG_X, np.array([0.25, 0.15, 0.12]))[None]
    behind = ball(centre=np.array([0.25 - 0.1382 - 0.025, 0.15, 0.12]), radius=0.02)
    assert reason(pose, behind, approach=0.0) == Reason.FREE
    assert reason(pose, behind, approach=0.05) == Reason.OBJECT


@pytest.mark.parametrize("x", np.linspace(0.141, 0.159, 7))
def test_wall_of_a_cup_is_found_wherever_it_crosses_a_finger(x):
    wall = box([x - 0.003, 0.0, TABLE], [x + 0.003, 0.3, 0.12])
    assert reason(from_above(), wall) == Reason.OBJECT


@settings(max_examples=12)
@given(st.integers(0, 2**32 - 1))
def test_collisions_with_a_box_match_dense_sampling_of_the_hand(seed):
    rng = np.random.default_rng(seed)
    pose = make_transform(random_rotation(rng), rng.uniform(0.1, 0.2, 3) + np.array([0, 0, 0.2]))
    centre, size = rng.uniform(0.05, 0.25, 3) + np.array([0, 0, 0.2]), rng.uniform(0.02, 0.06, 3)
    field = box(centre - size / 2, centre + size / 2)
    # Between an object that is a little smaller and one a little larger, the answer must lie between theirs.
    smaller = box(centre - size / 2 + 0.004, centre + size / 2 - 0.004)
    larger = box(centre - size / 2 - 0.002, centre + size / 2 + 0.002)
    found = check_collisions(pose[None], np.array([0.06]), franka, field, table_height=-10.0)
    if hand_meets(pose, 0.06, franka, smaller, 0.05):
        assert found.reason[0] == Reason.OBJECT
    if found.reason[0] == Reason.OBJECT:
        assert hand_meets(pose, 0.06, franka, larger, 0.05)


@settings(max_examples=25)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.08))
def test_points_in_the_hand_match_testing_them_one_by_one(seed, opening):
    rng = np.random.default_rng(seed)
    poses = make_transform(np.stack([random_rotation(rng) for _ in range(3)]), rng.uniform(0.1, 0.2, (3, 3)))
    points = rng.uniform(0.0, 0.3, (25, 3))
    hit = hits_points(poses, np.full(3, opening), franka, points, margin=0.002)
    assert hit.tolist() == [points_in_hand(pose, opening, franka, points, 0.002) >= 2 for pose in poses]


def test_measured_points_in_a_finger_are_a_collision_but_not_between_the_fingers():
    spread = np.array([[0, 0, 0], [0.004, 0, 0.004], [-0.004, 0, -0.004]])
    in_finger = np.array([0.15, 0.15 + 0.036 + 0.008, 0.09]) + spread
    between = np.array([0.15, 0.15, 0.09]) + spread
    assert reason(from_above(), empty, points=in_finger) == Reason.POINTS
    assert reason(from_above(), empty, points=between) == Reason.FREE


def test_one_stray_point_is_not_a_collision():
    stray = np.array([[0.15, 0.194, 0.09]])
    assert reason(from_above(), empty, points=stray) == Reason.FREE
    assert reason(from_above(), empty, points=np.vstack([stray, stray + 0.005])) == Reason.POINTS


def test_points_of_the_table_are_left_to_the_table_test():
    across = np.linspace(0.0, 0.3, 80)
    table = np.stack(np.meshgrid(across, across, [TABLE + 0.002]), axis=-1).reshape(-1, 3)
    assert reason(from_above(tips=0.0505), empty, points=table) == Reason.FREE


def test_measured_points_behind_the_palm_are_met_on_the_approach():
    pose = make_transform(ALONG_X, np.array([0.25, 0.15, 0.12]))[None]
    points = np.array([0.25 - 0.1382 - 0.025, 0.15, 0.12]) + np.array([[0, 0, 0], [0, 0.01, 0]])
    assert reason(pose, empty, points=points, approach=0.0) == Reason.FREE
    assert reason(pose, empty, points=points, approach=0.05) == Reason.POINTS


def test_every_rejection_is_counted():
    poses = np.concatenate([from_above(), from_above(tips=0.04), from_above(y=0.165), from_above(x=0.02, y=0.02)])
    points = np.array([[0.02, 0.06, 0.1], [0.02, 0.065, 0.1], [0.02, 0.06, 0.11]])
    found = check_collisions(poses, np.full(4, 0.072), franka, ball(), TABLE, points)
    assert found.reason.tolist() == [Reason.FREE, Reason.TABLE, Reason.OBJECT, Reason.POINTS]
    assert found.counts == {"free": 1, "table": 1, "object": 1, "points": 1}
    assert found.free.tolist() == [True, False, False, False]


def test_field_is_asked_only_for_survivors_and_above_the_table():
    asked = []

    def watched(points):
        asked.append(points)
        return np.zeros(len(points))

    poses = np.concatenate([from_above(tips=0.04), from_above(tips=0.055)])
    check_collisions(poses, np.full(2, 0.08), franka, watched, TABLE)
    points = np.concatenate(asked)
    assert points[:, 2].min() > TABLE
    fingertips = points[points[:, 2] < 0.056]
    assert len(fingertips) > 0
    check_collisions(poses[:1], np.full(1, 0.08), franka, lambda points: pytest.fail("asked"), TABLE)


def test_threshold_decides_what_is_occupied():
    def doubtful(points):
        return 0.4 * ball(radius=0.05)(points)

    opening = np.array([0.072])
    assert check_collisions(from_above(), opening, franka, doubtful, TABLE, threshold=0.5).free[0]
    assert not check_collisions(from_above(), opening, franka, doubtful, TABLE, threshold=0.3).free[0]


def test_batches_give_the_same_answers_as_single_grasps(monkeypatch):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(5, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    poses = grasp_poses(BALL + RADIUS * normals, normals, np.full(5, 2 * RADIUS)).reshape(-1, 4, 4)
    openings = rng.uniform(0.05, 0.08, len(poses))
    points = BALL + np.array([0, 0.06, 0]) + rng.normal(0, 0.01, (200, 3))
    whole = check_collisions(poses, openings, franka, ball(), TABLE, points)
    assert len(set(whole.reason.tolist())) == 4
    monkeypatch.setattr("icgnet.grasping.collision.BATCH", 3000)
    parts = check_collisions(poses, openings, franka, ball(), TABLE, points)
    assert np.array_equal(parts.reason, whole.reason)
    for index in range(0, len(poses), 7):
        single = reason(poses[index : index + 1], ball(), openings[index], points)
        assert single == whole.reason[index]


@settings(max_examples=10)
@given(st.floats(-7, 7))
def test_answers_turn_with_the_scene(yaw):
    R = rotation_z(yaw)
    T = make_transform(R, BALL - R @ BALL)
    neighbour = BALL + np.array([0.0, 0.07, 0.0])
    for pose, expected in ((from_above(), Reason.OBJECT), (from_above(x=0.145, y=0.13), Reason.OBJECT)):
        field = either(ball(), ball(centre=T[:3, :3] @ neighbour + T[:3, 3]))
        assert reason(T @ pose, field) == expected
    far = either(ball(), ball(centre=T[:3, :3] @ (BALL + np.array([0, 0.1, 0])) + T[:3, 3]))
    assert reason(T @ from_above(), far) == Reason.FREE


def test_no_grasps_have_no_collisions():
    found = check_collisions(np.zeros((0, 4, 4)), np.zeros(0), franka, ball(), TABLE, np.zeros((10, 3)))
    assert found.counts == {"free": 0, "table": 0, "object": 0, "points": 0}


def test_hand_without_a_palm_is_checked_by_its_fingers():
    fingers = replace(franka, palm=())
    high = ball(centre=np.array([0.15, 0.15, 0.075 + 0.07]), radius=0.02)
    assert reason(from_above(), high) == Reason.OBJECT
    assert reason(from_above(), high, gripper=fingers) == Reason.FREE
    assert reason(from_above(y=0.165), ball(), gripper=fingers) == Reason.OBJECT


def drawn_back(pose, opening=0.072):
    return draw_back(pose, np.full(len(pose), opening), franka, TABLE, limit=0.008, margin=0.001)


def test_a_hand_a_little_too_low_is_drawn_back_until_it_clears_the_table():
    np.testing.assert_allclose(drawn_back(from_above(tips=0.046))[0, :3, 3], [0.15, 0.15, 0.051], atol=1e-12)
    leaning = make_transform(DOWN @ rotation_about_y(0.5), np.array([0.15, 0.15, 0.05]))[None]
    moved = drawn_back(leaning)
    assert hits_table(leaning, np.array([0.072]), franka, TABLE)[0]
    assert not hits_table(moved, np.array([0.072]), franka, TABLE + 0.00099)[0]
    # Along its own approach, and turned as before.
    np.testing.assert_allclose(np.cross(moved[0, :3, 3] - leaning[0, :3, 3], leaning[0, :3, 2]), 0.0, atol=1e-12)
    np.testing.assert_array_equal(moved[0, :3, :3], leaning[0, :3, :3])


def test_hands_that_clear_the_table_or_cannot_are_left_where_they_are():
    level = make_transform(ALONG_X, np.array([0.15, 0.15, 0.08]))[None]
    up = make_transform(DOWN @ np.diag([1.0, -1.0, -1.0]), np.array([0.15, 0.15, 0.02]))[None]
    for pose in (from_above(tips=0.0511), from_above(tips=0.0429), level, up):
        np.testing.assert_array_equal(drawn_back(pose), pose)


def rotation_about_y(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
