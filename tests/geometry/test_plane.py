import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icgnet.errors import InputError, TableNotFoundError
from icgnet.geometry.camera import look_at
from icgnet.geometry.clouds import estimate_normals
from icgnet.geometry.plane import Plane, fit_table_plane, table_frame
from icgnet.geometry.transforms import invert_transform, make_transform, random_rotation, transform_points

seeds = st.integers(0, 2**32 - 1)
TOP_VIEW = look_at(np.array([0.1, 0.0, 0.7]), np.array([0.0, 0.0, 0.0]))
SIDE_VIEW = look_at(np.array([0.6, 0.1, 0.25]), np.array([0.0, 0.0, 0.05]))


def box_faces(rng: np.random.Generator, lower: list, upper: list, viewpoint: np.ndarray, count: int) -> np.ndarray:
    """Points on those faces of a box that can be seen."""
    lower, upper = np.array(lower), np.array(upper)
    faces = []
    for axis in range(3):
        side = upper if viewpoint[axis] > upper[axis] else lower
        face = rng.uniform(lower, upper, (count, 3))
        face[:, axis] = side[axis]
        faces.append(face)
    return np.concatenate(faces)


def cluttered_table(rng: np.random.Generator, T_world_camera: np.ndarray, on_objects: float = 0.3) -> np.ndarray:
    """A table at z = 0 with two boxes, in the camera frame, with noise of 1 mm."""
    viewpoint = T_world_camera[:3, 3]
    count = 20000
    table = np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)), np.zeros(count)])
    per_face = int(count * on_objects / (1 - on_objects) / 6)
    boxes = [
        box_faces(rng, [-0.1, -0.1, 0.0], [0.0, 0.1, 0.15], viewpoint, per_face),
        box_faces(rng, [0.1, -0.05, 0.0], [0.2, 0.05, 0.06], viewpoint, per_face),
    ]
    points = np.concatenate([table, *boxes])
    points += rng.normal(0, 0.001, points.shape)
    return transform_points(invert_transform(T_world_camera), points)


def assert_is_table(plane: Plane, T_world_camera: np.ndarray, angle: float = 0.01, distance: float = 0.003) -> None:
    up = T_world_camera[2, :3]
    assert np.arccos(np.clip(plane.normal @ up, -1, 1)) < angle
    assert abs(plane.offset - T_world_camera[2, 3]) < distance


def test_height_is_the_signed_distance_along_the_normal():
    plane = Plane(np.array([0.0, 0.6, 0.8]), -0.5)
    assert np.allclose(plane.height(np.array([[0, 0.3, 0.4], [7.0, 0.9, 1.2], [0, 0, 0]])), [0, 1.0, -0.5])


@settings(max_examples=5)
@given(seeds)
@pytest.mark.parametrize("view", [TOP_VIEW, SIDE_VIEW])
def test_table_under_clutter_is_found_from_above_and_from_the_side(view, seed):
    rng = np.random.default_rng(seed)
    plane = fit_table_plane(cluttered_table(rng, view), np.zeros(3), rng)
    assert_is_table(plane, view)


def test_table_is_found_among_planes_of_a_robot_and_the_floor():
    rng = np.random.default_rng(0)
    table = cluttered_table(rng, TOP_VIEW)
    viewpoint = TOP_VIEW[:3, 3]
    base = box_faces(rng, [0.4, -0.4, 0.0], [0.7, 0.4, 0.04], viewpoint, 4000)
    floor = np.column_stack([rng.uniform(-1.5, -0.6, 6000), rng.uniform(-1, 1, 6000), np.full(6000, -0.75)])
    others = transform_points(invert_transform(TOP_VIEW), np.concatenate([base, floor]))
    plane = fit_table_plane(np.concatenate([table, others]), np.zeros(3), rng)
    assert_is_table(plane, TOP_VIEW)


def test_top_of_a_large_box_is_not_taken_for_the_table():
    rng = np.random.default_rng(0)
    inside = rng.uniform([-0.15, -0.2, 0.12], [0.15, 0.2, 0.12], (12000, 3))
    table = np.column_stack([rng.uniform(-0.3, 0.3, (20000, 2)), np.zeros(20000)])
    table = table[(np.abs(table[:, 0]) > 0.18) | (np.abs(table[:, 1]) > 0.24)][:9000]
    assert len(inside) > len(table)
    points = transform_points(invert_transform(TOP_VIEW), np.concatenate([inside, table]))
    plane = fit_table_plane(points, np.zeros(3), rng)
    assert_is_table(plane, TOP_VIEW)


def test_without_a_viewpoint_the_normal_points_up():
    rng = np.random.default_rng(0)
    in_world = transform_points(SIDE_VIEW, cluttered_table(rng, SIDE_VIEW))
    plane = fit_table_plane(in_world, None, rng)
    assert plane.normal[2] > 0.999


@settings(max_examples=5)
@given(seeds)
def test_plane_turns_with_the_cloud(seed):
    rng = np.random.default_rng(seed)
    T = make_transform(random_rotation(rng), rng.uniform(-1, 1, 3))
    points = cluttered_table(rng, TOP_VIEW)
    plane = fit_table_plane(points, np.zeros(3), np.random.default_rng(1))
    turned = fit_table_plane(transform_points(T, points), T[:3, 3].copy(), np.random.default_rng(1))
    assert np.allclose(turned.normal, T[:3, :3] @ plane.normal, atol=1e-4)
    assert np.allclose(turned.height(transform_points(T, points)), plane.height(points), atol=1e-4)


def test_same_seed_gives_the_same_plane():
    points = cluttered_table(np.random.default_rng(0), SIDE_VIEW)
    first, second = (fit_table_plane(points, np.zeros(3), np.random.default_rng(5)) for _ in range(2))
    assert np.array_equal(first.normal, second.normal)
    assert first.offset == second.offset


@pytest.mark.parametrize("size", [0.02, 0.1, 1.0])
@pytest.mark.parametrize("shape", ["ball", "cube of noise"])
def test_cloud_without_a_plane_is_refused_with_the_shares(shape, size):
    rng = np.random.default_rng(0)
    if shape == "ball":
        directions = rng.normal(size=(10000, 3))
        directions[:, 2] = -np.abs(directions[:, 2])
        points = size * directions / np.linalg.norm(directions, axis=1, keepdims=True) + np.array([0, 0, 3 * size])
    else:
        points = rng.uniform(-size, size, (10000, 3)) + np.array([0, 0, 3 * size])
    with pytest.raises(TableNotFoundError, match=r"holds \d+% of the points within .* mm, 20% are required") as error:
        fit_table_plane(points, np.zeros(3), rng)
    assert isinstance(error.value, InputError)
    assert "\n" not in str(error.value)


def test_points_on_a_line_have_no_plane():
    points = np.linspace(0, 1, 200)[:, None] * np.array([1.0, 2.0, 2.0])
    with pytest.raises(TableNotFoundError):
        fit_table_plane(points, np.array([0.0, 0, 1]), np.random.default_rng(0))


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
    T = table_frame(fit_table_plane(points, np.zeros(3), rng), points)
    in_table = transform_points(T, points)
    standing = in_table[in_table[:, 2] > 0.055]
    assert np.allclose(np.median(standing[:, :2], axis=0), 0.15, atol=0.005)
    assert T[:3, 0] @ [1, 0, 0] > 0  # the camera's x axis points along world x
    assert abs(T[1, 0]) < 1e-9


def test_table_frame_ignores_what_stands_beside_the_table():
    rng = np.random.default_rng(0)
    points = cluttered_table(rng, TOP_VIEW)
    plane = fit_table_plane(points, np.zeros(3), rng)
    beside = rng.uniform([0.5, -0.4, 0.01], [0.9, 0.4, 0.2], (30000, 3))
    beside = transform_points(invert_transform(TOP_VIEW), beside)
    expected = table_frame(plane, points)
    assert np.allclose(table_frame(plane, np.concatenate([points, beside])), expected, atol=0.01)


def test_empty_table_is_centred_on_itself():
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.1, 0.3, 5000), rng.uniform(0.0, 0.2, 5000), np.zeros(5000)])
    points = transform_points(invert_transform(TOP_VIEW), table)
    T = table_frame(fit_table_plane(points, np.zeros(3), rng), points)
    assert np.allclose(np.median(transform_points(T, points), axis=0), [0.15, 0.15, 0.05], atol=0.003)


def test_normals_of_the_table_agree_with_its_plane():
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.1, 0.1, (4000, 2)), np.zeros(4000)])
    points = transform_points(invert_transform(SIDE_VIEW), table)
    plane = fit_table_plane(points, np.zeros(3), rng)
    assert np.allclose(estimate_normals(points, np.zeros(3)), plane.normal, atol=1e-3)
