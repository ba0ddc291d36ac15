import numpy as np
import pytest

from icgnet.sensors.image import (
    add_error_field,
    apply_gain,
    fly_pixels,
    round_depth,
    round_spots,
    shifted,
    smooth,
)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def step_image():
    """A wall at 0.5 m before a wall at 0.7 m, and a column where nothing was measured."""
    depth = np.full((60, 80), 0.7, np.float32)
    depth[:, 30:50] = 0.5
    depth[:, 70] = 0.0
    return depth


def test_gain_is_one_factor_with_the_named_spread(rng):
    gains = np.array([apply_gain(np.ones((2, 2), np.float32), 0.0316, rng) for _ in range(4000)])
    assert np.ptp(gains, axis=(1, 2)).max() == 0
    assert gains.mean() == pytest.approx(1.0, abs=0.002)
    assert gains.std() == pytest.approx(0.0316, rel=0.05)


def test_error_field_keeps_unmeasured_pixels_and_has_two_thirds_of_its_sigma(rng):
    depth = step_image()
    changed = add_error_field(depth, 0.005, rng)
    assert (changed[:, 70] == 0).all()
    assert (changed - depth)[depth > 0].std() == pytest.approx(0.005 * 2 / 3, rel=0.15)


def test_rounded_depth_is_whole_millimetres_and_nothing_moves_by_more_than_half_of_one(rng):
    depth = rng.uniform(0.3, 0.9, (30, 30)).astype(np.float32)
    rounded = round_depth(depth, 0.001)
    np.testing.assert_allclose(rounded * 1000, np.rint(rounded * 1000), atol=1e-3)
    assert np.abs(rounded - depth).max() <= 0.0005 + 1e-6


def test_flying_pixels_lie_between_the_two_surfaces_and_only_at_edges(rng):
    ids = np.where(step_image() == 0.5, 4, -2)
    for _ in range(8):
        depth, owners = fly_pixels(step_image(), ids, 0.7, rng)
        flying = depth != step_image()
        assert flying.any()
        assert ((depth[flying] >= 0.5) & (depth[flying] <= 0.7)).all()
        assert set(np.flatnonzero(flying.any(axis=0))) <= {29, 30, 49, 50}
        assert (owners[flying] == -1).all()
        assert (owners[~flying] == ids[~flying]).all()


def test_flying_pixels_between_two_parts_of_one_object_stay_its_own(rng):
    ids = np.full((60, 80), 4)
    depth, owners = fly_pixels(step_image(), ids, 1.0, rng)
    assert (depth != step_image()).any()
    np.testing.assert_array_equal(owners, ids)


def test_smoothing_takes_noise_away_and_keeps_edges(rng):
    noisy = step_image() + 0.001 * rng.standard_normal((60, 80)).astype(np.float32) * (step_image() > 0)
    smoothed = smooth(noisy, 2)
    for part in (slice(2, 28), slice(32, 48)):
        assert smoothed[:, part].std() < 0.45 * noisy[:, part].std()
    assert (smoothed[:, 70] == 0).all()
    assert np.abs(smoothed - step_image()).max() < 0.004


def test_smoothing_leaves_planes_as_they_are():
    plane = (0.5 + 0.001 * np.arange(40)[None] + 0.002 * np.arange(30)[:, None]).astype(np.float32)
    np.testing.assert_allclose(smooth(plane, 3)[4:-4, 4:-4], plane[4:-4, 4:-4], atol=1e-6)


def test_spots_are_round_and_as_many_as_asked_for(rng):
    assert not round_spots((60, 80), 0, rng).any()
    mask = round_spots((300, 400), 1, rng)
    height, width = np.ptp(np.argwhere(mask), axis=0) + 1
    assert abs(height - width) <= 1
    assert mask.sum() == pytest.approx(np.pi / 4 * height * width, rel=0.2)


@pytest.mark.parametrize("offset", [(0, 1), (1, 0), (0, -1), (-1, 0)])
def test_shifted_image_moves_by_one_and_never_wraps(offset, rng):
    image = rng.random((5, 6))
    expected = np.roll(image, offset, axis=(0, 1))
    axis = 0 if offset[0] else 1
    edge = 0 if sum(offset) > 0 else -1
    moved = shifted(image, offset)
    assert np.array_equal(np.delete(moved, edge, axis), np.delete(expected, edge, axis))
    assert np.array_equal(np.take(moved, edge, axis), np.take(image, edge, axis))
