"""Ways around things."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh

import needs_arm  # noqa: F401
from icgnet.arm.bodies import CollisionBody
from icgnet.arm.paths import PathFinder, _spread
from icgnet.arm.scene import CollisionChecker, Load

MARGIN = 0.005


@pytest.fixture(scope="module")
def around_a_wall(fr3, hand):
    """A wall between two positions of the arm, one on either side of it."""
    wall = trimesh.creation.box((0.6, 0.02, 0.55)).apply_translation([0.45, 0.0, 0.275])
    checker = CollisionChecker(fr3, hand, [CollisionBody("wall", wall)], Load(0.05, 0.05))
    turn, down = np.array([0.7, 0, 0, 0, 0, 0, 0]), np.array([0, 0.5, 0, 0, 0, 0, 0])
    return checker, fr3.home + down - turn, fr3.home + down + turn


def test_the_way_around_a_wall_meets_nothing(around_a_wall):
    checker, start, goal = around_a_wall
    finder = PathFinder(checker, MARGIN, np.random.default_rng(0))
    assert not finder.is_free(start, goal)
    way = finder.find(start, goal)
    assert way is not None
    np.testing.assert_array_equal(way[[0, -1]], [start, goal])
    fine = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(way)])
    assert checker.first_collision(fine) is None
    assert checker.arm.within_limits(fine)


def test_the_same_seed_gives_the_same_way(around_a_wall):
    checker, start, goal = around_a_wall
    first, second = (PathFinder(checker, MARGIN, np.random.default_rng(3)).find(start, goal) for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_a_free_way_is_a_straight_line(around_a_wall):
    checker, start, _ = around_a_wall
    goal = start - np.array([0.4, 0, 0, 0, 0, 0, 0])
    assert PathFinder(checker, MARGIN, np.random.default_rng(0)).find(start, goal).shape == (2, 7)


def test_where_there_is_no_way_the_search_ends(fr3, hand):
    start = fr3.home
    goal = start + np.array([1.2, 0, 0, 0, 0, 0, 0])
    tip = fr3.grasp_pose(goal, hand)[:3, 3]
    cage = trimesh.creation.box((0.7, 0.5, 0.9)).apply_translation([tip[0], tip[1], 0.45])  # around the goal's hand
    checker = CollisionChecker(fr3, hand, [CollisionBody("cage", cage)], Load(0.05, 0.05))
    assert PathFinder(checker, MARGIN, np.random.default_rng(0)).find(start, goal, most_tries=60) is None


@pytest.mark.parametrize("count", [2, 3, 17])
def test_shares_are_all_there_and_spread(count):
    shares = _spread(count)
    np.testing.assert_allclose(np.sort(shares), np.linspace(0.0, 1.0, count))
    assert shares[0] == 0.0
    assert count < 17 or shares[1] == 1.0 or shares[1] > 0.4
