import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icgnet.geometry.clouds import estimate_normals
from icgnet.geometry.plane import Plane, table_frame
from icgnet.geometry.transforms import invert_transform, transform_points
from table_clouds import SIDE_VIEW, TOP_VIEW, cluttered_table

seeds = st.integers(0, 2**32 - 1)


def table_plane(T_world_camera: np.ndarray) -> Plane:
    """The table at z = 0 of the world, camera frame."""
    return Plane(T_world_camera[2, :3].copy(), float(T_world_camera[2, 3]))


def test_height_is_the_signed_distance_along_the_normal():
    plane = Plane(np.array([0.0, 0.6, 0.8]), -0.5)
    assert np.allclose(plane.height(np.array([[0, 0.3, 0.4], [7.0, 0.9, 1.2], [0, 0, 0]])), [0, 1.0, -0.5])


@settings(max_examples=20)
@given(seeds)
def test_table_frame_is_proper_and_puts_the_table_at_its_height(seed):
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    plane = Plane(normal / np.linalg.norm(normal), float(rng.uniform(0.2, 1)))
    points = rng.uniform(-0.3, 0.3, (300, 3))
    T = table_frame(plane, points)
    assert abs(np.linalg.det(T[:3, :3]) - 1) < 1e-9
    assert np.allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.allclose(transform_points(T, points)[:, 2], plane.height(points) + 0.05)


@pytest.mark.parametrize("view", [TOP_VIEW, SIDE_VIEW])
def test_table_frame_centres_the_workspace_on_the_objects(view):
    rng = np.random.default_rng(0)
    points = cluttered_table(rng, view)
    T = table_frame(table_plane(view), points)
    in_table = transform_points(T, points)
    standing = in_table[in_table[:, 2] > 0.055]
    assert np.allclose(np.median(standing[:, :2], axis=0), 0.15, atol=0.005)
    assert T[:3, 0] @ [1, 0, 0] > 0  # the camera's x axis points along world x
    assert abs(T[1, 0]) < 1e-9


def test_table_frame_ignores_what_stands_beside_the_table():
    rng = np.random.default_rng(0)
    points = cluttered_table(rng, TOP_VIEW)
    plane = table_plane(TOP_VIEW)
    beside = rng.uniform([0.5, -0.4, 0.01], [0.9, 0.4, 0.2], (30000, 3))
    beside = transform_points(invert_transform(TOP_VIEW), beside)
    expected = table_frame(plane, points)
    assert np.allclose(table_frame(plane, np.concatenate([points, beside])), expected, atol=0.01)


def test_empty_table_is_centred_on_itself():
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.1, 0.3, 5000), rng.uniform(0.0, 0.2, 5000), np.zeros(5000)])
    points = transform_points(invert_transform(TOP_VIEW), table)
    T = table_frame(table_plane(TOP_VIEW), points)
    assert np.allclose(np.median(transform_points(T, points), axis=0), [0.15, 0.15, 0.05], atol=0.003)


def test_normals_of_the_table_agree_with_its_plane():
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.1, 0.1, (4000, 2)), np.zeros(4000)])
    points = transform_points(invert_transform(SIDE_VIEW), table)
    plane = table_plane(SIDE_VIEW)
    assert np.allclose(estimate_normals(points, np.zeros(3)), plane.normal, atol=1e-3)
