"""What carries the objects, in clouds and in depth images of rooms, bins and shelves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from furnished_scenes import bin_scene, box, depth_cloud, low_table, pile, shelf, wall_behind
from icgnet.errors import InputError, TableNotFoundError
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.plane import Plane
from icgnet.geometry.transforms import invert_transform, make_transform, random_rotation, transform_points
from icgnet.inference.support import Support, find_support
from table_clouds import SIDE_VIEW, TOP_VIEW, box_faces, cluttered_table

seeds = st.integers(0, 2**32 - 1)


def fitted(points: np.ndarray, viewpoint: np.ndarray | None, rng: np.random.Generator) -> Plane:
    return find_support(points, viewpoint, rng, level=viewpoint is None).plane


def support_of(cloud: PointCloud, level: bool) -> Support:
    return find_support(cloud.points, cloud.viewpoint, np.random.default_rng(0), level)


def assert_carries(scene, height: float, level: bool) -> Support:
    """The plane found in a scene is level and at this height; returns what was found."""
    cloud, pose = scene
    support = support_of(cloud if not level else cloud.transformed(pose, "world"), level)
    turn, shift = (np.eye(3), np.zeros(3)) if level else (pose[:3, :3], pose[:3, 3])
    assert np.degrees(np.arccos(np.clip((turn @ support.plane.normal)[2], -1, 1))) < 2
    assert (turn @ support.middle + shift)[2] == pytest.approx(height, abs=0.008)
    return support


@pytest.mark.parametrize("level", [False, True], ids=["no pose", "pose"])
@pytest.mark.parametrize("slope_deg", [0, 20, 37])
@pytest.mark.parametrize("view", ["above", "aside"])
def test_in_a_bin_its_floor_carries_and_not_a_wall(view, slope_deg, level):
    support = assert_carries(bin_scene(slope_deg, view), 0.005, level)
    assert support.enclosed > 0.1


def test_a_steep_bin_from_the_side_is_found_with_a_pose():
    assert_carries(bin_scene(50, "aside", depth=0.15), 0.005, level=True)


@pytest.mark.parametrize("level", [False, True], ids=["no pose", "pose"])
@pytest.mark.parametrize("height", [0.2, 0.45])
def test_a_low_table_in_a_room_carries_and_not_the_floor(height, level):
    assert_carries(low_table(height), height, level)


@pytest.mark.parametrize("level", [False, True], ids=["no pose", "pose"])
def test_a_wall_behind_the_table_is_none(level):
    assert_carries(wall_behind(), 0.0, level)


def test_a_board_of_a_shelf_is_found_with_a_pose():
    assert_carries(shelf(), 0.0, level=True)


def test_a_close_choice_is_told_with_both_planes():
    cloud, _ = shelf()
    support = support_of(cloud, level=False)
    assert support.rivals
    assert "close choice" in support.doubts(level=False)[0]
    assert all(each.score < support.score / 0.5 for each in support.rivals)


def test_a_plain_table_has_no_rivals():
    assert support_of(PointCloud(cluttered_table(np.random.default_rng(0), TOP_VIEW), np.zeros(3)), False).rivals == ()


def test_a_pile_that_fills_the_picture_has_no_support():
    cloud, _ = pile()
    with pytest.raises(TableNotFoundError, match="--table-height"):
        support_of(cloud, level=False)


def test_a_face_of_something_held_in_front_of_the_camera_is_no_table():
    cloud, _ = depth_cloud([box((-0.05, -0.04, 0.0), (0.05, 0.04, 0.03))], np.array([0.0, -0.05, 0.4]))
    with pytest.raises(TableNotFoundError, match="show more of the table"):
        support_of(cloud, level=False)


def test_a_pose_that_is_a_little_off_is_told():
    cloud = PointCloud(cluttered_table(np.random.default_rng(0), SIDE_VIEW), np.zeros(3))
    tilt = make_transform(random_tilt(5.0), np.zeros(3))
    (doubt,) = support_of(cloud.transformed(tilt @ SIDE_VIEW, "world"), level=True).doubts(level=True)
    assert "tilted by 5.0 degrees" in doubt


def random_tilt(degrees: float) -> np.ndarray:
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]])


def test_what_is_seen_below_a_plane_speaks_against_it():
    """A sheet of stray points that float over a table is no support, though as many lie on it."""
    rng = np.random.default_rng(0)
    table = np.column_stack([rng.uniform(-0.4, 0.4, (8000, 2)), np.zeros(8000)])
    floating = np.column_stack([rng.uniform(-0.4, 0.4, (9000, 2)), np.full(9000, 0.1)])
    points = transform_points(invert_transform(TOP_VIEW), np.concatenate([table, floating]))
    assert_is_table(fitted(points, np.zeros(3), rng), TOP_VIEW)


def assert_is_table(plane: Plane, T_world_camera: np.ndarray, angle: float = 0.01, distance: float = 0.003) -> None:
    up = T_world_camera[2, :3]
    assert np.arccos(np.clip(plane.normal @ up, -1, 1)) < angle
    assert abs(plane.offset - T_world_camera[2, 3]) < distance


@settings(max_examples=5)
@given(seeds)
@pytest.mark.parametrize("view", [TOP_VIEW, SIDE_VIEW])
def test_table_under_clutter_is_found_from_above_and_from_the_side(view, seed):
    rng = np.random.default_rng(seed)
    plane = fitted(cluttered_table(rng, view), np.zeros(3), rng)
    assert_is_table(plane, view)


def test_table_is_found_among_planes_of_a_robot_and_the_floor():
    rng = np.random.default_rng(0)
    table = cluttered_table(rng, TOP_VIEW)
    viewpoint = TOP_VIEW[:3, 3]
    base = box_faces(rng, [0.4, -0.4, 0.0], [0.7, 0.4, 0.04], viewpoint, 4000)
    floor = np.column_stack([rng.uniform(-1.5, -0.6, 6000), rng.uniform(-1, 1, 6000), np.full(6000, -0.75)])
    others = transform_points(invert_transform(TOP_VIEW), np.concatenate([base, floor]))
    plane = fitted(np.concatenate([table, others]), np.zeros(3), rng)
    assert_is_table(plane, TOP_VIEW)


def test_top_of_a_large_box_is_not_taken_for_the_table():
    rng = np.random.default_rng(0)
    inside = rng.uniform([-0.15, -0.2, 0.12], [0.15, 0.2, 0.12], (12000, 3))
    table = np.column_stack([rng.uniform(-0.3, 0.3, (20000, 2)), np.zeros(20000)])
    table = table[(np.abs(table[:, 0]) > 0.18) | (np.abs(table[:, 1]) > 0.24)][:9000]
    assert len(inside) > len(table)
    points = transform_points(invert_transform(TOP_VIEW), np.concatenate([inside, table]))
    plane = fitted(points, np.zeros(3), rng)
    assert_is_table(plane, TOP_VIEW)


def test_without_a_viewpoint_the_normal_points_up():
    rng = np.random.default_rng(0)
    in_world = transform_points(SIDE_VIEW, cluttered_table(rng, SIDE_VIEW))
    plane = fitted(in_world, None, rng)
    assert plane.normal[2] > 0.999


@settings(max_examples=5)
@given(seeds)
def test_plane_turns_with_the_cloud(seed):
    rng = np.random.default_rng(seed)
    T = make_transform(random_rotation(rng), rng.uniform(-1, 1, 3))
    points = cluttered_table(rng, TOP_VIEW)
    plane = fitted(points, np.zeros(3), np.random.default_rng(1))
    turned = fitted(transform_points(T, points), T[:3, 3].copy(), np.random.default_rng(1))
    assert np.allclose(turned.normal, T[:3, :3] @ plane.normal, atol=1e-4)
    assert np.allclose(turned.height(transform_points(T, points)), plane.height(points), atol=1e-4)


def test_same_seed_gives_the_same_plane():
    points = cluttered_table(np.random.default_rng(0), SIDE_VIEW)
    first, second = (fitted(points, np.zeros(3), np.random.default_rng(5)) for _ in range(2))
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
    with pytest.raises(TableNotFoundError, match=r"holds \d+% of the points") as error:
        fitted(points, np.zeros(3), rng)
    assert isinstance(error.value, InputError)
    assert "\n" not in str(error.value)


def test_points_on_a_line_have_no_plane():
    points = np.linspace(0, 1, 200)[:, None] * np.array([1.0, 2.0, 2.0])
    with pytest.raises(TableNotFoundError):
        fitted(points, np.array([0.0, 0, 1]), np.random.default_rng(0))
