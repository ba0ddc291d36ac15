import numpy as np
import pytest

from icgnet.sensors.cloud import deform, erased_blocks, jitter


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def test_jitter_has_its_sigma_on_every_axis(rng):
    points = rng.uniform(0, 0.3, (20000, 3))
    np.testing.assert_allclose((jitter(points, 0.002, rng) - points).std(axis=0), 0.002, rtol=0.05)


def test_deformation_bends_the_cloud_and_keeps_its_small_shapes(rng):
    points = rng.uniform(0, 0.3, (5000, 3))
    pair = points + [0.004, 0, 0]
    moved = deform(np.concatenate([points, pair]), 0.003, rng)
    shift = moved - np.concatenate([points, pair])
    assert 0.0015 < shift.std() < 0.005
    assert np.abs(shift[:5000] - shift[5000:]).mean() < 0.0005


def test_blocks_are_erased_whole_and_at_the_given_share(rng):
    points = rng.uniform(0, 0.3, (20000, 3))
    shares = [erased_blocks(points, 0.2, rng).mean() for _ in range(10)]
    assert np.mean(shares) == pytest.approx(0.2, abs=0.02)
    pair = np.repeat(rng.uniform(0, 0.3, (500, 3)), 2, axis=0)
    pair[1::2] += 1e-9
    erased = erased_blocks(pair, 0.5, rng)
    assert (erased[::2] == erased[1::2]).mean() > 0.99
