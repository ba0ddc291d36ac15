import numpy as np
import pytest

from icgnet.geometry.camera import pixel_rays
from icgnet.sensors.time_of_flight import WIGGLE_PERIOD, add_multipath, add_shot_noise, blend_edges, wiggle

SHAPE = (200, 240)
INTRINSICS = np.array([[365.0, 0.0, 120.0], [0.0, 365.0, 100.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def plane(normal, distance):
    """Depth of the plane of the points p with normal @ p = -distance."""
    return (-distance / (pixel_rays(INTRINSICS, SHAPE) @ normal)).astype(np.float32)


def wall(distance):
    return np.full(SHAPE, distance, np.float32)


def noise_of(depth, ids=None, sigma=0.002):
    ids = np.full(SHAPE, -2) if ids is None else ids
    return add_shot_noise(depth, ids, INTRINSICS, sigma, np.random.default_rng(1)) - depth


def test_shot_noise_grows_with_the_distance():
    assert noise_of(wall(1.0))[90:110, 100:140].std() == pytest.approx(0.002, rel=0.15)
    assert noise_of(wall(1.4)).std() / noise_of(wall(0.7)).std() == pytest.approx(2.0, rel=0.03)


def test_shot_noise_grows_with_the_incidence():
    steep = np.array([np.sin(np.deg2rad(70.0)), 0.0, -np.cos(np.deg2rad(70.0))])
    depth = plane(steep, 0.7 * np.cos(np.deg2rad(70.0)))
    centre = (slice(80, 120), slice(118, 123))
    ratio = (noise_of(depth) / depth)[centre].std() / (noise_of(wall(0.7)) / 0.7)[centre].std()
    assert ratio == pytest.approx(np.cos(np.deg2rad(70.0)) ** -0.5, rel=0.1)


def test_shot_noise_is_larger_on_dim_objects_and_alike_for_neighbours():
    ids = np.repeat(np.arange(8), 30)[None].repeat(SHAPE[0], axis=0)
    spread = [noise_of(wall(0.8), ids)[:, ids[0] == each].std() for each in range(8)]
    assert max(spread) > 1.2 * min(spread)
    error = noise_of(wall(0.8))
    alike = [np.corrcoef(error[:, :-lag].ravel(), error[:, lag:].ravel())[0, 1] for lag in (1, 2, 6)]
    assert alike == pytest.approx([0.8, 0.4, 0.0], abs=0.05)


def test_wiggling_goes_up_and_down_with_the_distance_and_leaves_holes(rng):
    depth = np.linspace(0.35, 1.4, 2000, dtype=np.float32)[None].repeat(2, axis=0)
    depth[1] = 0.0
    error = wiggle(depth, 0.004, rng) - depth
    assert (error[1] == 0).all()
    assert np.abs(error[0]).max() == pytest.approx(0.004, rel=0.01)
    crossings = np.count_nonzero(np.diff(np.sign(error[0])))
    assert crossings == pytest.approx(2 * 1.05 / WIGGLE_PERIOD, abs=1)


def test_pixels_at_edges_fly_between_the_surfaces_and_belong_to_nothing():
    depth, ids = wall(0.7), np.full(SHAPE, -2)
    depth[:, 100:140], ids[:, 100:140] = 0.5, 4
    blended, owners = blend_edges(depth, ids, 0.6)
    flying = np.flatnonzero((np.abs(blended - depth) > 1e-4).any(axis=0))
    assert set(flying) == {99, 100, 139, 140}
    assert ((blended[:, flying] > 0.5) & (blended[:, flying] < 0.7)).all()
    # The nearer surface sends more light: the far pixel comes nearer by more than a share of its neighbour's light.
    assert (0.7 - blended[:, 99]).mean() > (blended[:, 100] - 0.5).mean()
    assert (owners[:, flying] == -1).all()
    assert (np.delete(owners, flying, axis=1) == np.delete(ids, flying, axis=1)).all()


def test_blending_leaves_flat_parts_and_holes_and_parts_of_one_object_their_id():
    depth = wall(0.7)
    depth[:, 100:140] = 0.5
    depth[:, 110] = 0.0
    blended, owners = blend_edges(depth, np.full(SHAPE, 4), 0.6)
    assert (blended[:, 110] == 0).all()
    np.testing.assert_allclose(blended[:, [50, 109, 111, 120]], depth[:, [50, 109, 111, 120]], rtol=1e-5)
    assert (owners == 4).all()


def test_light_that_bounces_between_the_walls_of_a_corner_bends_them_away():
    # Two walls, upright and at 45 degrees to the camera, meet at 0.8 m in the middle of the image.
    left, right = (np.array([side, 0.0, -1.0]) / np.sqrt(2.0) for side in (1.0, -1.0))
    depth = np.minimum(plane(left, 0.8 / np.sqrt(2.0)), plane(right, 0.8 / np.sqrt(2.0)))
    assert depth[100, 120] == depth.max()
    error = (add_multipath(depth, INTRINSICS, 0.5) - depth)[100]
    assert 0.001 < error[60:115].max() < 0.03
    assert error.min() >= 0.0
    np.testing.assert_allclose(error[100:120], error[140:120:-1], atol=1e-3)
    stronger = (add_multipath(depth, INTRINSICS, 1.0) - depth)[100]
    assert stronger[100] > 1.4 * error[100]


def test_nothing_bounces_on_a_flat_or_a_convex_surface():
    np.testing.assert_allclose(add_multipath(wall(0.8), INTRINSICS, 0.8), 0.8, atol=1e-5)
    left, right = (np.array([side, 0.0, -1.0]) / np.sqrt(2.0) for side in (1.0, -1.0))
    roof = np.maximum(plane(left, 0.5 / np.sqrt(2.0)), plane(right, 0.5 / np.sqrt(2.0)))
    roof = np.where((roof > 0) & (roof < 2), roof, 0).astype(np.float32)
    np.testing.assert_allclose(add_multipath(roof, INTRINSICS, 0.8), roof, atol=1e-4)
