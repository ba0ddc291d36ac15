import numpy as np
import pytest

from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.training.config import EVALUATION_VIEWS, VIEW_RANGES, ViewRange
from icgnet.training.views import CameraView, crop_view, draw_view


def pixel(view: CameraView, points):
    in_camera = transform_points(invert_transform(view.T_world_camera), points)
    projected = in_camera @ view.intrinsics.T
    return projected[:, :2] / projected[:, 2:]


@pytest.mark.parametrize("ranges", [VIEW_RANGES, EVALUATION_VIEWS])
def test_cameras_stand_where_they_may(ranges):
    rng = np.random.default_rng(0)
    for _ in range(50):
        T = draw_view(ranges, 1.0, rng).T_world_camera
        polar = np.rad2deg(np.arccos(-T[2, 2]))
        assert min(r.polar_deg[0] for r in ranges) - 1e-3 <= polar <= max(r.polar_deg[1] for r in ranges) + 1e-3


def test_camera_looks_at_its_target_from_its_distance():
    rng = np.random.default_rng(0)
    view = draw_view((ViewRange(1.0, (0.6, 0.6), (50.0, 50.0), (0.25, 0.25)),), 1.0, rng)
    target = np.array([[0.15, 0.15, 0.25]])
    np.testing.assert_allclose(pixel(view, target), [[320, 240]], atol=1e-6)
    assert np.linalg.norm(view.T_world_camera[:3, 3] - target) == pytest.approx(0.6)


def test_half_resolution_sees_the_same_with_fewer_pixels():
    full, half = (draw_view(VIEW_RANGES, size, np.random.default_rng(3)) for size in (1.0, 0.5))
    points = np.random.default_rng(0).uniform(0.1, 0.2, (20, 3))
    np.testing.assert_allclose(pixel(full, points), 2 * pixel(half, points), atol=1e-6)
    assert half.shape == (240, 320)


def test_cropped_view_keeps_every_visible_pixel_of_the_box():
    rng = np.random.default_rng(0)
    lower, upper = np.array([0.1, 0.1, 0.05]), np.array([0.2, 0.22, 0.15])
    for _ in range(20):
        view = draw_view(VIEW_RANGES, 1.0, rng)
        cropped = crop_view(view, lower, upper)
        points = rng.uniform(lower, upper, (200, 3))
        whole, part = pixel(view, points), pixel(cropped, points)
        visible = ((whole >= 0) & (whole <= [view.shape[1] - 1, view.shape[0] - 1])).all(axis=1)
        assert ((part[visible] >= 0) & (part[visible] <= [cropped.shape[1] - 1, cropped.shape[0] - 1])).all()
        assert cropped.shape[0] * cropped.shape[1] < view.shape[0] * view.shape[1]
        shift = view.intrinsics[:2, 2] - cropped.intrinsics[:2, 2]
        np.testing.assert_allclose(whole - shift, part, atol=1e-6)


def test_what_the_image_cannot_show_is_told_from_its_corners():
    view = draw_view((ViewRange(1.0, (0.6, 0.6), (0.0, 0.0), (0.05, 0.05)),), 1.0, np.random.default_rng(0))
    view = crop_view(view, np.array([0.1, 0.1, 0.05]), np.array([0.2, 0.2, 0.1]))
    cube = np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))).reshape(3, 8).T / 50
    assert view.may_show(cube + [0.15, 0.15, 0.1])
    assert view.may_show(cube + [0.21, 0.15, 0.05]), "its edge"
    assert not view.may_show(cube + [0.28, 0.15, 0.05]), "beside the image"
    assert not view.may_show(cube + [0.15, 0.15, 1.0]), "behind the camera"
    assert view.may_show(cube * 60), "all around the camera"
