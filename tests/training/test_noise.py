import numpy as np
import pytest

from icgnet.training.noise import (
    NOISES,
    SensorNoise,
    add_error_field,
    add_flying_pixels,
    apply_gain,
    corrupt_depth,
    corrupt_points,
    cubic_upsampling,
    cut_holes,
    erased_blocks,
    quantise_disparity,
)

PROBABILITIES = ("field_probability", "quantisation_probability", "flying_probability", "holes_probability")


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def step_image():
    """A wall at 0.5 m before a wall at 0.7 m, and a column where nothing was measured."""
    depth = np.full((60, 80), 0.7)
    depth[:, 30:50] = 0.5
    depth[:, 70] = 0.0
    return depth


def test_clean_sensor_changes_nothing(rng):
    depth, flying = corrupt_depth(step_image(), 540.0, NOISES["clean"], rng)
    np.testing.assert_array_equal(depth, step_image())
    assert not flying.any()
    points = rng.uniform(0, 0.3, (100, 3))
    kept, index = corrupt_points(points, NOISES["clean"], rng)
    np.testing.assert_array_equal(kept, points)
    np.testing.assert_array_equal(index, np.arange(100))


def test_same_seed_gives_same_noise():
    first, second = (corrupt_depth(step_image(), 540.0, NOISES["mixed"], np.random.default_rng(7))[0] for _ in range(2))
    np.testing.assert_array_equal(first, second)


def test_unmeasured_pixels_stay_unmeasured(rng):
    everything = SensorNoise(gain=0.03, field=0.005, **dict.fromkeys(PROBABILITIES, 1.0))
    depth, _ = corrupt_depth(step_image(), 540.0, everything, rng)
    assert (depth[:, 70] == 0).all()
    assert not np.array_equal(depth, step_image())


def test_gain_is_one_factor_with_the_named_spread(rng):
    gains = np.array([apply_gain(np.ones((2, 2)), 0.0316, rng) for _ in range(4000)])
    assert np.ptp(gains, axis=(1, 2)).max() == 0
    assert gains.mean() == pytest.approx(1.0, abs=0.002)
    assert gains.std() == pytest.approx(0.0316, rel=0.05)


def test_error_field_is_smooth_and_has_its_sigma(rng):
    field = add_error_field(np.ones((200, 240)), 0.005, rng) - 1.0
    # Between the coarse samples a cubic averages, which takes about a fifth off the sigma in two dimensions.
    assert 0.0035 < field.std() < 0.0055
    assert np.abs(np.diff(field, axis=1)).std() < 0.6 * field.std()


def test_cubic_upsampling_goes_through_its_samples_and_reproduces_parabolas():
    weights = cubic_upsampling(41, 4)
    coarse = np.arange(weights.shape[1]) - 1.0
    fine = np.arange(41) / 4
    np.testing.assert_allclose(weights @ coarse**2, fine**2, atol=1e-9)
    values = np.random.default_rng(1).normal(size=weights.shape[1])
    np.testing.assert_allclose((weights @ values)[::4], values[1 : 1 + 11], atol=1e-12)


def test_quantisation_step_grows_with_the_distance_squared():
    depth = np.linspace(0.4, 1.6, 20000)[None]
    levels = np.unique(quantise_disparity(depth, 540.0, 0.25))
    steps, middle = np.diff(levels), 0.5 * (levels[1:] + levels[:-1])
    np.testing.assert_allclose(steps / middle**2, (steps / middle**2)[0], rtol=0.05)
    assert np.abs(quantise_disparity(depth, 540.0, 0.25) - depth).max() <= 0.51 * steps.max()


def test_flying_pixels_lie_between_the_two_surfaces_and_only_at_edges(rng):
    for _ in range(8):
        depth, flying = add_flying_pixels(step_image(), rng)
        assert ((depth[flying] >= 0.5) & (depth[flying] <= 0.7)).all()
        assert set(np.flatnonzero(flying.any(axis=0))) <= {29, 30, 49, 50}
        np.testing.assert_array_equal(depth[~flying], step_image()[~flying])


def test_holes_are_cut_and_nothing_else_changes(rng):
    depth = cut_holes(step_image(), rng)
    assert (depth == 0).sum() > (step_image() == 0).sum()
    assert np.isin(depth, (0.0, 0.5, 0.7)).all()


def test_blocks_are_erased_whole_and_at_the_given_share(rng):
    points = rng.uniform(0, 0.3, (20000, 3))
    shares = [erased_blocks(points, 0.2, rng).mean() for _ in range(10)]
    assert np.mean(shares) == pytest.approx(0.2, abs=0.02)
    pair = np.repeat(rng.uniform(0, 0.3, (500, 3)), 2, axis=0)
    pair[1::2] += 1e-9
    erased = erased_blocks(pair, 0.5, rng)
    assert (erased[::2] == erased[1::2]).mean() > 0.99


def test_point_noise_keeps_track_of_which_point_is_which(rng):
    points = rng.uniform(0, 0.3, (5000, 3))
    kept, index = corrupt_points(points, SensorNoise(gaussian=0.002, drop=0.5), rng)
    assert 0 < len(kept) < 5000
    assert np.abs(kept - points[index]).max() < 0.012


def test_empty_cloud_survives(rng):
    kept, index = corrupt_points(np.zeros((0, 3)), SensorNoise(block_probability=1.0, drop=0.3), rng)
    assert kept.shape == (0, 3)
    assert len(index) == 0
