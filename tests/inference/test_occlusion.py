"""Boxes behind a post, as a camera sees them."""

import numpy as np
import pytest

from furnished_scenes import box, depth_cloud
from icgnet.inference.occlusion import join_occluded

POST = box((-0.03, -0.10, 0.0), (0.03, -0.06, 0.22))
EYE = np.array([0.0, -0.6, 0.45])


def pieces_of(behind: list, posts: tuple = (POST,)) -> np.ndarray:
    """Groups of what is left of the post, right of it, and of the post itself."""
    table = box((-0.5, -0.5, -0.02), (0.5, 0.5, 0.0))
    cloud, pose = depth_cloud([table, *behind, *posts], EYE, (0.0, 0.0, 0.05))
    world = cloud.transformed(pose, "table")
    above = world.points[:, 2] > 0.006
    front = world.points[:, 1] < -0.03
    left, right = (np.flatnonzero(above & ~front & side) for side in (world.points[:, 0] < 0, world.points[:, 0] >= 0))
    return join_occluded([left, right, np.flatnonzero(above & front)], world, np.flatnonzero(above))


def test_a_box_behind_a_post_is_one():
    assert pieces_of([box((-0.12, 0.0, 0.0), (0.12, 0.08, 0.08))]).tolist() == [0, 0, 1]


def test_boxes_of_unlike_height_behind_a_post_are_two():
    two = [box((-0.12, 0.0, 0.0), (-0.01, 0.08, 0.08)), box((0.01, 0.03, 0.0), (0.12, 0.11, 0.12))]
    assert pieces_of(two).tolist() == [0, 1, 2]


def test_boxes_of_like_height_and_another_depth_behind_a_post_are_two():
    two = [box((-0.12, 0.0, 0.0), (-0.01, 0.16, 0.08)), box((0.01, 0.0, 0.0), (0.12, 0.05, 0.08))]
    assert pieces_of(two).tolist() == [0, 1, 2]


def test_like_boxes_with_a_gap_that_is_seen_are_two():
    two = [box((-0.12, 0.0, 0.0), (-0.03, 0.08, 0.08)), box((0.03, 0.0, 0.0), (0.12, 0.08, 0.08))]
    aside = box((0.2, -0.3, 0.0), (0.25, -0.25, 0.1))
    assert pieces_of(two, (aside,)).tolist() == [0, 1, 2]


@pytest.mark.parametrize("count", [0, 1, 2])
def test_fewer_than_three_things_hide_nothing_of_each_other(count):
    cloud, _ = depth_cloud([POST], EYE)
    assert len(join_occluded([np.arange(50)] * count, cloud, np.arange(len(cloud)))) == count
