import numpy as np
import pytest

from icgnet.geometry.transforms import make_transform
from icgnet.simulation.approach import ApproachChecker
from icgnet.simulation.config import Physics

DOWN = np.diag([1.0, -1.0, -1.0])


def _from_above(x=0.15, y=0.15, z=0.12):
    return make_transform(DOWN, np.array([x, y, z]))[None]


def _check(bodies, gripper, poses, opening=0.062):
    return ApproachChecker(bodies, gripper, Physics()).collides(poses, np.full(len(poses), opening)).tolist()


def test_a_hand_astride_a_box_is_free(standing_box, gripper):
    assert _check([standing_box(0.05, 0.05, 0.1)], gripper, _from_above()) == [False]


def test_a_hand_that_is_not_open_enough_collides(standing_box, gripper):
    assert _check([standing_box(0.05, 0.05, 0.1)], gripper, _from_above(), opening=0.049) == [True]


def test_a_hand_too_deep_collides_with_its_palm(standing_box, gripper):
    assert _check([standing_box(0.05, 0.05, 0.1)], gripper, _from_above(z=0.10)) == [True]


@pytest.mark.parametrize(("height", "collides"), [(0.049, True), (0.051, False)])
def test_a_hand_through_the_table_collides(gripper, standing_box, height, collides):
    far_away = standing_box(0.02, 0.02, 0.02, x=0.02, y=0.02)
    assert _check([far_away], gripper, _from_above(z=height)) == [collides]


def test_a_hand_through_a_neighbour_collides(standing_box, gripper):
    target, neighbour = standing_box(0.05, 0.05, 0.1), standing_box(0.05, 0.05, 0.1, y=0.205)
    assert _check([target], gripper, _from_above()) == [False]
    assert _check([target, neighbour], gripper, _from_above()) == [True]


def test_an_obstacle_that_is_only_in_the_way_of_the_approach_collides(standing_box, gripper):
    # Free at the grasp pose, but 30 mm above the back of the hand.
    target, shelf = standing_box(0.05, 0.05, 0.1), standing_box(0.05, 0.05, 0.01)
    back_of_hand = 0.12 - min(box.centre[2] - box.size[2] / 2 for box in gripper.palm)
    shelf.T_world_object[2, 3] = back_of_hand + 0.03
    assert _check([target, shelf], gripper, _from_above()) == [True]
    shelf.T_world_object[2, 3] = back_of_hand + 0.07
    assert _check([target, shelf], gripper, _from_above()) == [False]


def test_more_poses_than_hands_give_the_same_answers_as_one_by_one(standing_box, gripper, rng):
    checker = ApproachChecker([standing_box(0.05, 0.05, 0.1)], gripper, Physics(), hands=4)
    poses = np.concatenate([_from_above(*xyz) for xyz in rng.uniform([0.1, 0.1, 0.06], [0.2, 0.2, 0.2], (30, 3))])
    openings = rng.uniform(0.02, 0.08, 30)
    together = checker.collides(poses, openings)
    assert 0 < together.sum() < 30
    assert together.tolist() == [checker.collides(poses[i : i + 1], openings[i : i + 1])[0] for i in range(30)]


def test_collisions_agree_with_surface_points_of_the_hand(standing_box, gripper, rng):
    """The slow version: any of the hand's surface points inside the box, at many poses along the way."""
    size = np.array([0.06, 0.05, 0.1])
    checker = ApproachChecker([standing_box(*size)], gripper, Physics())
    outcomes = set()
    for x, y, z in rng.uniform([0.1, 0.1, 0.08], [0.2, 0.2, 0.2], (12, 3)):
        pose = _from_above(x, y, z)
        points = gripper.surface_points(0.07, spacing=0.005) @ DOWN.T + pose[0, :3, 3]
        ways = np.linspace(0.0, 0.05, 13)[:, None, None]
        offsets = np.abs(points + ways * [0.0, 0.0, 1.0] - [0.15, 0.15, 0.1]) - size / 2
        deepest = float(-offsets.max(axis=2).min())
        collides = bool(checker.collides(pose, np.array([0.07]))[0])
        outcomes.add((deepest > 0, collides))
        if deepest > 0:
            assert collides
        elif collides:
            assert deepest > -0.006, "a collision without any point near the box"
    assert {(True, True), (False, False)} <= outcomes
