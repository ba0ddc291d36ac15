"""The table frame, and what stands on the table."""

import numpy as np
import pytest

from furnished_scenes import box, depth_cloud
from icgnet.errors import InputError, TableNotFoundError
from icgnet.geometry.camera import unproject
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import invert_transform, rotation_z, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.tabletop import find_tabletop
from tabletop_scenes import INTRINSICS, THREE_BOXES, Box, camera_pose, depth_image


@pytest.fixture(scope="module")
def seen() -> PointCloud:
    """Three boxes on a table, in the camera's frame."""
    grid = unproject(depth_image(THREE_BOXES, camera_pose()), INTRINSICS).reshape(-1, 3)
    return PointCloud(grid[np.isfinite(grid).all(axis=1)], np.zeros(3), "camera")


def rotation_about_y(angle: float) -> np.ndarray:
    return np.roll(np.roll(rotation_z(angle), -1, axis=0), -1, axis=1)


def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def test_the_table_found_without_a_pose_is_level_and_at_its_height(seen):
    tabletop = find_tabletop(seen, None, rng(), level=False)
    world_up = camera_pose()[:3, :3].T @ np.array([0.0, 0.0, 1.0])
    assert tabletop.T_frame_table[:3, 2] @ world_up > np.cos(np.deg2rad(0.2))
    heights = np.delete(tabletop.cloud.points[:, 2], tabletop.standing)
    assert np.median(heights) == pytest.approx(TABLE_HEIGHT, abs=0.0005)


def test_what_stands_on_the_table_is_the_boxes(seen):
    tabletop = find_tabletop(seen, None, rng(), level=False)
    world = transform_points(camera_pose(), seen.points)
    lower, upper = world[tabletop.standing].min(axis=0), world[tabletop.standing].max(axis=0)
    np.testing.assert_allclose(lower[:2], (0.05, 0.05), atol=0.006)
    np.testing.assert_allclose(upper, (0.22, 0.23, 0.13), atol=0.006)


def test_a_level_world_keeps_its_axes_and_finds_the_height(seen):
    tabletop = find_tabletop(seen.transformed(camera_pose(), "world"), None, rng())
    np.testing.assert_allclose(tabletop.T_frame_table, np.eye(4), atol=5e-4)


def test_a_pose_that_is_a_little_off_tilts_the_table_frame_and_nothing_else(seen):
    tilt = np.eye(4)
    tilt[:3, :3] = rotation_about_y(np.deg2rad(6))
    tilted = tilt @ camera_pose()
    tabletop = find_tabletop(seen.transformed(tilted, "world"), None, rng())
    np.testing.assert_allclose(tabletop.T_frame_table[:3, :3], tilt[:3, :3], atol=2e-3)
    level = find_tabletop(seen.transformed(camera_pose(), "world"), None, rng())
    assert len(np.setxor1d(tabletop.standing, level.standing)) < 0.05 * len(level.standing)
    middle = seen.transformed(tilted, "world").points[tabletop.standing].mean(axis=0)
    assert np.linalg.norm(tabletop.cloud.points[tabletop.standing].mean(axis=0)[:2] - middle[:2]) < 0.02


def test_of_two_groups_of_things_far_from_each_other_one_is_seen(seen):
    world = seen.transformed(camera_pose(), "world").points
    far = PointCloud(np.concatenate([world, world + (3.0, 0.0, 0.0)]), camera_pose()[:3, 3], "world")
    tabletop = find_tabletop(far, TABLE_HEIGHT, rng())
    assert len(tabletop.standing) > 100
    assert np.ptp(tabletop.cloud.points[tabletop.standing, 0]) < 1.0


def test_a_given_height_is_taken_as_it_is(seen):
    shifted = camera_pose()
    shifted[2, 3] += 0.7
    tabletop = find_tabletop(seen.transformed(shifted, "world"), 0.75, rng())
    np.testing.assert_allclose(tabletop.T_frame_table[:3, 3], (0.0, 0.0, 0.7))


def test_a_pose_that_tilts_the_table_is_an_error_that_names_the_angle(seen):
    tilt = np.eye(4)
    tilt[:3, :3] = rotation_about_y(np.deg2rad(30))
    with pytest.raises(InputError, match="tilted by 30 degrees"):
        find_tabletop(seen.transformed(tilt @ camera_pose(), "world"), None, rng())


def test_a_ball_without_a_table_is_an_error():
    directions = rng().normal(size=(4000, 3))
    ball = 0.1 * directions / np.linalg.norm(directions, axis=1, keepdims=True) + np.array([0.0, 0.0, 0.5])
    with pytest.raises(TableNotFoundError, match="--table-height"):
        find_tabletop(PointCloud(ball, np.zeros(3), "camera"), None, rng(), level=False)


def test_flying_pixels_do_not_stand_on_the_table(seen):
    flying = invert_transform(camera_pose())
    strays = transform_points(flying, np.array([[0.28, 0.02, 0.2], [0.02, 0.25, 0.15], [0.28, 0.25, 0.18]]))
    cloud = PointCloud(np.concatenate([seen.points, strays]), np.zeros(3), "camera")
    tabletop = find_tabletop(cloud, None, rng(), level=False)
    assert not np.isin(len(seen) + np.arange(3), tabletop.standing).any()


def test_waves_in_the_depth_of_a_noisy_table_do_not_stand_on_it(seen):
    world = transform_points(camera_pose(), seen.points)
    world[:, 2] += 0.003 * np.sin(60 * world[:, 0]) * np.sin(60 * world[:, 1]) + 0.0015 * rng().normal(size=len(world))
    tabletop = find_tabletop(PointCloud(world, camera_pose()[:3, 3], "world"), TABLE_HEIGHT, rng())
    on_boxes = [
        (np.abs(world[:, :2] - (np.array(box.lower) + box.upper)[:2] / 2) < 0.06).all(axis=1) for box in THREE_BOXES
    ]
    assert np.any(on_boxes, axis=0)[tabletop.standing].mean() > 0.99


def test_a_mask_limits_what_stands_on_the_table(seen):
    world = seen.transformed(camera_pose(), "world")
    left = world.points[:, 0] < 0.13
    tabletop = find_tabletop(world, TABLE_HEIGHT, rng(), mask=left)
    assert len(tabletop.standing) > 100
    assert left[tabletop.standing].all()
    assert not left[tabletop.above].all(), "what is masked out can still be hit"


def test_what_stands_beside_a_found_table_is_no_object_but_can_be_hit():
    beside = Box((1.1, 0.1, 0.0), (1.3, 0.3, 0.2))
    pose = camera_pose(1.2, (0.4, 0.15, 0.05))
    grid = unproject(depth_image((*THREE_BOXES, beside), pose), INTRINSICS).reshape(-1, 3)
    world = transform_points(pose, grid[np.isfinite(grid).all(axis=1)])
    tabletop = find_tabletop(PointCloud(world, pose[:3, 3], "world"), None, rng())
    assert world[tabletop.standing, 0].max() < 0.3
    assert world[tabletop.above, 0].max() > 1.09


def test_a_thing_right_beside_what_is_seen_of_the_table_stands_on_it_unless_the_table_is_seen_to_end():
    table, hidden = box((-0.4, -0.3, -0.02), (0.2, 0.3, 0.0)), box((0.26, -0.05, 0.0), (0.34, 0.05, 0.1))
    floor = box((-2.0, -2.0, -0.8), (2.0, 2.0, -0.75))
    eye = np.array([0.0, -0.5, 0.7])
    for room, stands in (([table], True), ([table, floor], False)):
        cloud, pose = depth_cloud([*room, hidden], eye)
        tabletop = find_tabletop(cloud.transformed(pose, "world"), None, rng())
        seen = transform_points(pose, cloud.points)[tabletop.standing]
        assert (seen[:, 0].max(initial=-1.0) > 0.25) == stands


def test_things_taller_than_the_cube_are_not_cut():
    cloud, pose = depth_cloud(
        [box((-0.5, -0.5, -0.02), (0.5, 0.5, 0.0)), box((0.0, 0.0, 0.0), (0.1, 0.1, 0.45))], np.array([0.3, -0.9, 0.8])
    )
    tabletop = find_tabletop(cloud.transformed(pose, "world"), None, rng())
    heights = tabletop.cloud.points[tabletop.standing, 2] - TABLE_HEIGHT
    assert heights.max() == pytest.approx(0.45, abs=0.01)


def test_a_mask_limits_where_the_table_is_looked_for():
    """A small tray on a large table carries what is in the mask."""
    tray = box((0.25, -0.1, 0.0), (0.55, 0.2, 0.12))
    things = [box((-0.3, -0.2, 0.0), (-0.25, -0.15, 0.06)), box((0.35, 0.0, 0.12), (0.42, 0.06, 0.18))]
    cloud, pose = depth_cloud(
        [box((-0.8, -0.8, -0.02), (0.8, 0.8, 0.0)), tray, *things], np.array([0.1, -0.8, 0.9]), (0.1, 0.0, 0.0)
    )
    world = cloud.transformed(pose, "world")
    on_tray = ((world.points[:, :2] > (0.27, -0.08)) & (world.points[:, :2] < (0.53, 0.18))).all(axis=1)
    assert find_tabletop(world, None, rng()).T_frame_table[2, 3] == pytest.approx(-TABLE_HEIGHT, abs=0.004)
    masked = find_tabletop(world, None, rng(), mask=on_tray)
    assert masked.T_frame_table[2, 3] == pytest.approx(0.12 - TABLE_HEIGHT, abs=0.004)


@pytest.mark.parametrize(("given", "contradicts"), [(TABLE_HEIGHT, False), (TABLE_HEIGHT + 0.06, True)])
def test_a_height_that_contradicts_the_picture_is_told_with_both_numbers(seen, given, contradicts):
    tabletop = find_tabletop(seen.transformed(camera_pose(), "world"), given, rng())
    assert len(tabletop.warnings) == contradicts
    if contradicts:
        assert "given as 0.110 m" in tabletop.warnings[0]
        assert "seen at 0.050 m" in tabletop.warnings[0]
    assert tabletop.support is None


def test_an_empty_table_has_nothing_on_it():
    grid = unproject(depth_image((), camera_pose()), INTRINSICS).reshape(-1, 3)
    cloud = PointCloud(grid[np.isfinite(grid).all(axis=1)], np.zeros(3), "camera")
    assert len(find_tabletop(cloud, None, rng(), level=False).standing) == 0
