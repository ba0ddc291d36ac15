"""Windows over a table."""

import numpy as np
import pytest

from icgnet.errors import InputError
from icgnet.geometry.transforms import transform_points
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT
from icgnet.inference.windows import STRIDE, Window, cover, fullest_first, owners


def scattered(width: float, depth: float, count: int = 400) -> np.ndarray:
    points = np.random.default_rng(0).uniform((0, 0, 0.06), (width, depth, 0.2), (count, 3))
    return points + np.array([-0.31, 0.22, 0.0])


def test_windows_cover_every_point_of_a_wide_cloud():
    points = scattered(0.83, 0.55)
    windows = cover(points)
    assert len(windows) > 1
    seen = np.unique(np.concatenate([window.inside(points) for window in windows]))
    assert len(seen) == len(points)


@pytest.mark.parametrize("centre", np.random.default_rng(1).uniform((-0.2, 0.3), (0.4, 0.6), (6, 2)).tolist())
def test_an_object_of_half_a_window_is_whole_in_the_window_that_owns_its_middle(centre):
    windows = cover(scattered(0.83, 0.55))
    middle = np.array([[*centre, 0.1]])
    owner = windows[owners(windows, middle)[0]]
    corners = middle + STRIDE / 2 * np.array([[1, 1, 0], [1, -1, 0], [-1, 1, 0], [-1, -1, 0]])
    inner = np.clip(corners[:, :2], [-0.31, 0.22], [0.52, 0.77])
    assert len(owner.inside(np.column_stack([inner, np.full(4, 0.1)]))) == 4


def test_a_cloud_in_the_workspace_keeps_its_place():
    points = np.random.default_rng(0).uniform((0.01, 0.1, 0.06), (0.2, 0.29, 0.2), (50, 3))
    (window,) = cover(points)
    np.testing.assert_array_equal(window.origin, 0.0)


def test_a_small_cloud_elsewhere_gets_one_window_around_its_middle():
    points = scattered(0.2, 0.28)
    (window,) = cover(points)
    middle = (points[:, :2].min(axis=0) + points[:, :2].max(axis=0)) / 2
    np.testing.assert_allclose(window.centre, middle)
    assert len(window.inside(points)) == len(points)


def test_a_cloud_a_little_larger_than_a_window_gets_two():
    windows = cover(scattered(SIZE + 0.01, 0.2))
    assert len(windows) == 2


def test_windows_without_points_in_their_core_are_left_out():
    ends = np.concatenate([scattered(0.05, 0.05), scattered(0.05, 0.05) + np.array([1.2, 0.0, 0.0])])
    full = cover(scattered(1.25, 0.05))
    assert len(cover(ends)) < len(full)


def test_a_table_without_things_has_no_windows():
    assert cover(np.zeros((0, 3))) == []


def test_a_window_of_half_the_scale_sees_twice_as_far_and_the_table_where_it_is():
    window = Window(np.array([0.2, -0.1]), 0.5)
    corners = np.array([[0.2, -0.1, TABLE_HEIGHT], [0.8, 0.5, TABLE_HEIGHT + 0.5]])
    np.testing.assert_allclose(window.to_window(corners), [[0, 0, TABLE_HEIGHT], [0.3, 0.3, TABLE_HEIGHT + 0.25]])
    np.testing.assert_allclose(transform_points(window.T_table_window, window.to_window(corners)), corners)
    np.testing.assert_allclose(window.centre, [0.5, 0.2])


def test_wide_windows_cover_every_point_with_fewer():
    points = np.random.default_rng(0).uniform((0, 0, 0.06), (1.2, 0.9, 0.3), (4000, 3))
    wide = cover(points, scale=0.5)
    assert len(wide) < len(cover(points)) / 2
    assert len(np.unique(np.concatenate([window.inside(points) for window in wide]))) == len(points)


def test_with_a_budget_the_fullest_window_comes_first():
    points = np.concatenate([np.full((5, 3), 0.1), np.full((50, 3), 0.1) + [0.6, 0.0, 0.0]])
    windows = [Window(np.zeros(2)), Window(np.array([0.6, 0.0]))]
    assert fullest_first(windows, points) == windows[::-1]


def test_a_room_is_an_error_that_names_its_size():
    with pytest.raises(InputError, match=r"4\.9.*m: more than 100 windows"):
        cover(scattered(5.0, 5.0))
