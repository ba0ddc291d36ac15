"""Objects that several windows see."""

import numpy as np
import pytest

from icgnet.geometry.clouds import PointCloud
from icgnet.inference.instances import EncodedWindow, Instance, encode_windows, instances_of, keep_one_of_each
from icgnet.inference.tabletop import Tabletop
from icgnet.inference.windows import Window
from icgnet.network.instances import select_instances
from tabletop_scenes import tiny_network


@pytest.fixture(scope="module")
def points() -> np.ndarray:
    """A band of points along x, 0.45 m long."""
    return np.random.default_rng(0).uniform((0.0, 0.1, 0.06), (0.45, 0.2, 0.12), (3000, 3))


@pytest.fixture(scope="module")
def views(points) -> list[EncodedWindow]:
    """Two windows that share the middle third of the band."""
    cloud, rows = PointCloud(points, np.array([0.2, -0.3, 0.6]), "table"), np.arange(len(points))
    tabletop = Tabletop(cloud, rows, rows, np.eye(4))
    return encode_windows(tiny_network(), tabletop, [Window(np.zeros(2)), Window(np.array([0.15, 0.0]))])


def between(points, view, low, high):
    return Instance(view, 0, 0.8, "box", 0.9, np.flatnonzero((points[:, 0] >= low) & (points[:, 0] < high)))


def test_windows_hold_the_points_in_their_cube(points, views):
    np.testing.assert_array_equal(views[0].rows, np.flatnonzero(points[:, 0] <= 0.3))
    assert (views[1].window.to_window(points[views[1].rows])[:, 0] >= 0).all()


def test_no_point_of_a_window_is_claimed_twice(views):
    rows = np.concatenate([item.rows for item in instances_of(views[0])])
    assert len(rows) > 0
    assert len(np.unique(rows)) == len(rows)


def test_instances_carry_the_scores_that_the_network_ranks_them_by(views):
    scores = [item.score for item in instances_of(views[0])]
    assert scores == select_instances(views[0].embedding.stages[-1]).scores.tolist()
    assert all(0.0 < score <= 1.0 for score in scores)


def test_the_window_around_an_object_is_preferred_over_one_that_cuts_it(points, views):
    whole, cut = between(points, views[1], 0.22, 0.36), between(points, views[0], 0.22, 0.30)
    (kept,) = keep_one_of_each([cut, whole], views, points)
    assert kept.view is views[1]
    assert len(kept.rows) == len(whole.rows)


def test_an_object_that_no_window_has_in_its_core_is_kept(points, views):
    (kept,) = keep_one_of_each([between(points, views[0], 0.24, 0.30)], views, points)
    assert kept.view is views[0]


def test_neighbours_that_overlap_a_little_are_both_kept_and_share_no_point(points, views):
    kept = keep_one_of_each([between(points, views[0], 0.0, 0.2), between(points, views[1], 0.17, 0.45)], views, points)
    assert len(kept) == 2
    assert len(np.intersect1d(kept[0].rows, kept[1].rows)) == 0


def test_an_instance_that_two_others_cover_is_not_kept(points, views):
    halves = [between(points, views[0], 0.0, 0.1), between(points, views[0], 0.1, 0.2)]
    both = between(points, views[1], 0.0, 0.2)
    kept = keep_one_of_each([*halves, both], views, points)
    assert all(item.view is views[0] for item in kept)
    assert all(len(item.rows) for item in kept)


def test_an_object_longer_than_a_window_is_put_together(points, views):
    left, right = between(points, views[0], 0.05, 0.30), between(points, views[1], 0.15, 0.42)
    (kept,) = keep_one_of_each([left, right], views, points)
    np.testing.assert_array_equal(kept.rows, between(points, kept.view, 0.05, 0.42).rows)


def test_instances_that_disagree_where_both_windows_see_them_stay_apart(points, views):
    left, right = between(points, views[0], 0.05, 0.20), between(points, views[1], 0.19, 0.42)
    assert len(keep_one_of_each([left, right], views, points)) == 2


def test_the_object_with_most_points_comes_first(points, views):
    kept = keep_one_of_each([between(points, views[0], 0.0, 0.1), between(points, views[1], 0.2, 0.45)], views, points)
    assert len(kept[0].rows) > len(kept[1].rows)
