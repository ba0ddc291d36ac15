import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icgnet.errors import InputError
from icgnet.geometry.cells import CellGrid
from icgnet.geometry.clouds import voxel_downsample
from icgnet.geometry.transforms import transform_points, yaw_about
from icgnet.geometry.visibility import visibility_grid
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT

BALL = np.array([0.155, 0.145, 0.10])
RADIUS = 0.05
VIEWS = [[0.15, 0.15, 0.65], [0.6, 0.15, 0.3], [0.15, -0.2, 0.25], [-0.1, 0.5, 0.4]]
views = pytest.mark.parametrize("viewpoint", [np.array(view) for view in VIEWS])


def cell_centres(cells: int = 30, pitch: float = 0.01) -> np.ndarray:
    axis = (np.arange(cells) + 0.5) * pitch
    return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)


def visible_ball(viewpoint: np.ndarray, count: int = 40000) -> np.ndarray:
    directions = np.random.default_rng(0).normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = BALL + RADIUS * directions
    return points[np.einsum("nd,nd->n", viewpoint - points, directions) > 0]


def exact_grid(viewpoint: np.ndarray, truncation: float = 0.03, with_ball: bool = True) -> np.ndarray:
    """The value of every cell from the exact intersections of its ray with the ball and the table."""
    rays = cell_centres() - viewpoint
    distance = np.linalg.norm(rays, axis=-1)
    rays /= distance[..., None]
    with np.errstate(divide="ignore", invalid="ignore"):
        surface = np.where(rays[..., 2] < 0, (TABLE_HEIGHT - viewpoint[2]) / rays[..., 2], np.inf)
        along = rays @ (BALL - viewpoint)
        entry = along - np.sqrt(RADIUS**2 - np.sum((BALL - viewpoint) ** 2) + along**2)
    if with_ball:
        surface = np.where(np.isnan(entry), surface, np.minimum(surface, entry))
    return np.clip((surface - distance) / truncation, -1, 1)


@views
@pytest.mark.parametrize("spacing", [None, 0.003])
def test_grid_of_a_ball_matches_exact_ray_intersections(viewpoint, spacing):
    points = visible_ball(viewpoint)
    points = points if spacing is None else voxel_downsample(points, spacing)[0]
    difference = np.abs(visibility_grid(points, viewpoint) - exact_grid(viewpoint))
    assert difference.mean() < 0.02
    # Only rays that pass the ball's edge within a pixel may come out on the wrong side.
    assert (difference > 0.5).mean() < 0.008


@views
def test_without_points_the_table_is_the_surface(viewpoint):
    grid = visibility_grid(np.zeros((0, 3)), viewpoint)
    assert grid.dtype == np.float32
    assert np.abs(grid - exact_grid(viewpoint, with_ball=False)).max() < 1e-4


@views
def test_ball_hides_what_is_behind_it_and_not_what_is_in_front(viewpoint):
    grid = visibility_grid(visible_ball(viewpoint), viewpoint)
    towards = (viewpoint - BALL) / np.linalg.norm(viewpoint - BALL)
    front, behind = (np.floor((BALL + s * towards) / 0.01).astype(int) for s in (0.09, -0.04))
    assert grid[tuple(front)] > 0.9
    assert grid[tuple(behind)] == -1


@views
def test_thin_cloud_leaves_no_pinholes(viewpoint):
    points, _ = voxel_downsample(visible_ball(viewpoint), 0.003)
    grid = visibility_grid(points, viewpoint)
    inside = np.linalg.norm(cell_centres() - BALL, axis=-1) < RADIUS - 0.015
    assert grid[inside].max() < 0


@settings(max_examples=8)
@given(st.integers(1, 3), st.floats(-7, 7), st.floats(0.1, 1.3))
def test_grid_turns_with_the_scene(quarter_turns, azimuth, polar):
    away = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    viewpoint = CENTRE + 0.5 * away
    T = yaw_about(CENTRE, quarter_turns * np.pi / 2)
    grid = visibility_grid(visible_ball(viewpoint), viewpoint)
    turned = visibility_grid(transform_points(T, visible_ball(viewpoint)), transform_points(T, viewpoint))
    difference = np.abs(turned - np.rot90(grid, quarter_turns, axes=(0, 1)))
    # The pixels do not turn along for a camera near the vertical, where the horizon has no meaning.
    assert difference.mean() < 0.005


def test_points_of_the_table_change_almost_nothing():
    viewpoint = np.array([0.5, 0.3, 0.5])
    ball = visible_ball(viewpoint)
    table = np.column_stack([np.random.default_rng(1).uniform(0, 0.3, (40000, 2)), np.full(40000, TABLE_HEIGHT)])
    hidden = np.linalg.norm(np.cross(viewpoint - table, BALL - table), axis=1) < RADIUS * np.linalg.norm(
        viewpoint - table, axis=1
    )
    with_table = visibility_grid(np.vstack([ball, table[~hidden]]), viewpoint)
    assert np.abs(with_table - visibility_grid(ball, viewpoint)).mean() < 0.02


def test_order_of_the_points_does_not_matter():
    viewpoint = np.array([0.4, 0.0, 0.5])
    points = visible_ball(viewpoint)
    shuffled = np.random.default_rng(0).permutation(points)
    assert np.array_equal(visibility_grid(points, viewpoint), visibility_grid(shuffled, viewpoint))


def test_nothing_is_seen_through_the_table():
    viewpoint = np.array([0.15, 0.15, 0.6])
    below = np.column_stack([np.random.default_rng(0).uniform(0, 0.3, (20000, 2)), np.full(20000, 0.01)])
    grid = visibility_grid(below, viewpoint)
    assert np.abs(grid - exact_grid(viewpoint, with_ball=False)).max() < 1e-4


def test_camera_within_the_workspace_sees_nothing_behind_itself():
    viewpoint = np.array([0.05, 0.15, 0.15])
    grid = visibility_grid(visible_ball(viewpoint), viewpoint)
    assert np.isfinite(grid).all()
    assert (grid[:4] == -1).all()


def test_camera_in_the_centre_of_the_workspace_is_refused():
    with pytest.raises(InputError, match="must be apart"):
        visibility_grid(np.zeros((0, 3)), CENTRE)


def test_grid_and_truncation_are_free():
    cells = CellGrid((-8, 8, 0), (48, 24, 16))
    grid = visibility_grid(np.zeros((0, 3)), np.array([0.15, 0.20, 0.7]), cells, truncation=0.06)
    assert grid.shape == (48, 24, 16)
    assert np.allclose(grid[23, 12, 4], (0.045 - TABLE_HEIGHT) / 0.06, atol=0.01)


@views
def test_a_cell_has_the_same_value_in_a_larger_grid(viewpoint):
    ball = visible_ball(viewpoint)
    whole = visibility_grid(ball, viewpoint, CellGrid((-8, -16, 0), (48, 56, 40)))
    # The pixels are a little smaller, since the middle is elsewhere: what differs is along the ball's outline.
    differs = np.abs(whole[8:38, 16:46, :30] - visibility_grid(ball, viewpoint)) > 0.1
    assert differs.mean() < 0.02


def test_a_scene_that_moves_over_the_table_with_its_grid_looks_the_same():
    viewpoint, step = np.array(VIEWS[0]), np.array([0.24, -0.48, 0.0])
    ball = visible_ball(viewpoint)
    here = visibility_grid(ball, viewpoint, CellGrid((0, 0, 0), (32, 32, 32)))
    there = visibility_grid(ball + step, viewpoint + step, CellGrid((24, -48, 0), (32, 32, 32)))
    assert (np.abs(here - there) > 1e-3).mean() < 1e-3
