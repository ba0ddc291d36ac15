import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from icgnet.geometry.cells import ALIGNMENT, PITCH, ROOM, WORKSPACE_CELLS, CellGrid, grid_around
from icgnet.geometry.workspace import SIZE

places = st.tuples(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.0, 0.6))


def test_a_grid_says_which_of_its_cells_a_point_is_in():
    grid = CellGrid((24, -48, 0), (8, 16, 32))
    assert grid.origin == pytest.approx((0.24, -0.48, 0.0))
    points = np.array([[0.245, -0.475, 0.005], [0.319, -0.325, 0.319], [0.325, -0.4, 0.1], [0.3, -0.485, 0.1]])
    cells, inside = grid.cells(points)
    assert cells[:2].tolist() == [[0, 0, 0], [7, 15, 31]]
    assert inside.tolist() == [True, True, False, False]


def test_the_cells_of_the_workspace_fill_it():
    assert WORKSPACE_CELLS.lower == (0, 0, 0)
    assert np.array(WORKSPACE_CELLS.shape) * PITCH == pytest.approx(SIZE)


@given(points=st.lists(places, min_size=1, max_size=5))
def test_a_grid_around_points_is_aligned_and_holds_them_with_the_room_asked(points):
    cloud = np.array(points)
    grid = grid_around(cloud)
    lower, upper = np.array(grid.lower), np.array(grid.lower) + grid.shape
    assert not (lower % ALIGNMENT).any()
    assert not (upper % ALIGNMENT).any()
    assert lower[2] == 0
    assert grid.cells(cloud)[1].all()
    least, most = cloud.min(0) - ROOM, cloud.max(0) + ROOM
    assert (lower[:2] * PITCH <= least[:2] + 1e-9).all()
    assert (upper * PITCH >= most - 1e-9).all()
    # And no larger than the next step.
    step = ALIGNMENT * PITCH
    assert (lower[:2] * PITCH > least[:2] - step - 1e-9).all()
    assert (upper * PITCH < most + step + 1e-9).all()


def test_a_grid_moves_with_the_points():
    cloud = np.array([[0.11, 0.123, 0.07], [0.21, 0.163, 0.13]])
    here, there = grid_around(cloud), grid_around(cloud + np.array([0.24, -0.48, 0.0]))
    assert there.shape == here.shape
    assert np.array(there.lower).tolist() == (np.array(here.lower) + [24, -48, 0]).tolist()


def test_points_under_the_foot_of_the_table_still_have_a_grid():
    assert grid_around(np.array([[0.1, 0.1, -0.3]])).shape[2] == ALIGNMENT
