import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from icgnet.errors import InputError
from icgnet.geometry.camera import (
    DEFAULT_INTRINSICS,
    DEFAULT_SHAPE,
    check_depth,
    check_intrinsics,
    look_at,
    metric_depth,
    pixel_rays,
    sphere_pose,
    unproject,
)

K = np.array([[500.0, 0.0, 2.0], [0.0, 400.0, 1.0], [0.0, 0.0, 1.0]])
coordinates = st.floats(-1, 1)
positions = st.builds(lambda x, y, z: np.array([x, y, z]), coordinates, coordinates, coordinates)


def test_unprojection_of_hand_worked_pixels():
    depth = np.full((3, 4), 0.5)
    points = unproject(depth, K)
    assert points.shape == (3, 4, 3)
    assert np.allclose(points[1, 2], [0, 0, 0.5])  # the principal point
    assert np.allclose(points[2, 3], [0.5 / 500, 0.5 / 400, 0.5])  # one pixel to the right and down
    assert np.allclose(points[0, 0], [-2 * 0.5 / 500, -0.5 / 400, 0.5])


@given(st.floats(0.3, 2.0), st.floats(-30, 30))
def test_projecting_the_unprojected_points_gives_the_pixels_back(depth, skew):
    intrinsics = DEFAULT_INTRINSICS.copy()
    intrinsics[0, 1] = skew
    pixels = unproject(np.full((5, 7), depth), intrinsics) @ intrinsics.T
    pixels /= pixels[..., 2:]
    v, u = np.mgrid[:5, :7]
    assert np.allclose(pixels[..., 0], u, atol=1e-9)
    assert np.allclose(pixels[..., 1], v, atol=1e-9)


def test_unmeasured_pixels_become_nan_points():
    depth = np.full((3, 4), 0.5)
    depth[0, 0], depth[0, 1], depth[0, 2], depth[0, 3] = 0, np.nan, np.inf, -1
    points = unproject(depth, K)
    assert np.isnan(points[0]).all()
    assert np.isfinite(points[1:]).all()


def test_rays_have_unit_depth():
    rays = pixel_rays(DEFAULT_INTRINSICS, DEFAULT_SHAPE)
    assert rays.shape == (*DEFAULT_SHAPE, 3)
    assert (rays[..., 2] == 1).all()
    assert np.allclose(rays[240, 320], [0, 0, 1])


def test_depth_scale_turns_millimetres_into_metres():
    raw = np.array([[500, 0], [1500, 250]], dtype=np.uint16)
    assert np.allclose(metric_depth(raw, 1000.0), [[0.5, 0], [1.5, 0.25]])


@pytest.mark.parametrize("scale", [0.0, -1000.0, np.nan, np.inf])
def test_depth_scale_must_be_positive(scale):
    with pytest.raises(InputError, match="depth scale must be a positive number"):
        metric_depth(np.ones((2, 2)), scale)


@pytest.mark.parametrize(
    ("depth", "message"),
    [
        (np.full((4, 5), 600, dtype=np.uint16), "600 m, which looks like millimetres: give --depth-scale 1000"),
        (np.full((4, 5), 0.0006), "was the scale applied twice"),
        (np.zeros((4, 5)), "no measured pixel: all 20"),
        (np.full((4, 5), np.nan), "no measured pixel: all 20"),
        (np.ones((4, 5, 3)), r"shape \(h, w\), got \(4, 5, 3\)"),
        (np.ones(20), r"shape \(h, w\), got \(20,\)"),
        (np.zeros((0, 5)), "no measured pixel"),
    ],
)
def test_unusable_depth_is_refused_with_its_value(depth, message):
    with pytest.raises(InputError, match=message) as error:
        check_depth(depth)
    assert "\n" not in str(error.value)


def test_checking_depth_leaves_the_input_untouched():
    depth = np.array([[0.0, 0.5]])
    check_depth(depth)
    assert np.array_equal(depth, [[0.0, 0.5]])


@pytest.mark.parametrize(
    ("intrinsics", "message"),
    [
        (np.zeros((3, 3)), "fx = 0, fy = 0"),
        (np.diag([-500.0, 500.0, 1.0]), "fx = -500"),
        (np.diag([500.0, 500.0, 0.0]), "must be"),
        (np.eye(4), r"shape \(3, 3\), got \(4, 4\)"),
        (np.diag([500.0, np.nan, 1.0]), "finite"),
        (K.T, "must be"),
    ],
)
def test_impossible_intrinsics_are_refused_with_their_value(intrinsics, message):
    with pytest.raises(InputError, match=message) as error:
        check_intrinsics(intrinsics)
    assert "\n" not in str(error.value)


@given(positions, positions)
def test_camera_looks_at_its_target_and_is_proper(eye, target):
    distance = np.linalg.norm(target - eye)
    assume(distance > 1e-3)
    T = look_at(eye, target)
    assert abs(np.linalg.det(T[:3, :3]) - 1) < 1e-9
    assert np.allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-9)
    assert np.allclose(T[:3, 3], eye)
    assert np.allclose(T[:3, :3].T @ (target - eye), [0, 0, distance], atol=1e-9)


def test_up_in_the_world_is_up_in_the_image():
    T = look_at(np.array([0.5, 0.2, 0.4]), np.array([0.1, 0.1, 0.1]))
    assert T[2, 1] < 0  # the camera's y axis points down
    assert abs(T[2, 0]) < 1e-12  # and its x axis is level


@pytest.mark.parametrize("height", [0.5, -0.5])
def test_camera_can_look_straight_down_and_up(height):
    T = look_at(np.array([0.1, 0.1, height]), np.array([0.1, 0.1, 0.0]))
    assert np.allclose(T[:3, 0], [1, 0, 0])
    assert np.allclose(T[:3, 2], [0, 0, -np.sign(height)])


def test_camera_inside_its_target_is_refused():
    with pytest.raises(InputError, match="must be apart"):
        look_at(np.ones(3), np.ones(3))


@given(st.floats(0.05, 3.0), st.floats(-7, 7), st.floats(0.2, 2.0))
def test_sphere_pose_is_the_look_at_pose_from_its_place(polar, azimuth, radius):
    target = np.array([0.15, 0.15, 0.05])
    T = sphere_pose(target, radius, polar, azimuth)
    assert abs(np.linalg.norm(T[:3, 3] - target) - radius) < 1e-12
    assert abs(T[2, 3] - target[2] - radius * np.cos(polar)) < 1e-12
    assert np.allclose(T, look_at(T[:3, 3], target), atol=1e-9)


@given(st.floats(-7, 7))
def test_sphere_pose_is_continuous_above_the_target(azimuth):
    target = np.zeros(3)
    difference = sphere_pose(target, 0.5, 0.0, azimuth) - sphere_pose(target, 0.5, 1e-6, azimuth)
    assert np.abs(difference).max() < 1e-5
