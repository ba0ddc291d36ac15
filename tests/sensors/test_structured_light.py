import numpy as np
import pytest

from icgnet.sensors.structured_light import dark_pixels, wander_edges


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def pole():
    """A pole at 0.5 m before a wall at 0.7 m."""
    depth = np.full((200, 160), 0.7, np.float32)
    depth[:, 60:90] = 0.5
    return depth, np.where(depth < 0.6, 3, -2)


def test_edges_wander_by_their_sigma_and_take_their_ids_with_them(rng):
    depth, ids = pole()
    moved, owners = wander_edges(depth, ids, 1.0, rng)
    assert set(np.unique(moved)) == set(np.unique(depth))
    assert ((moved == np.float32(0.5)) == (owners == 3)).all()
    # A column d pixels beside the edge shows the other side where the displacement is more than d.
    shares = [(owners == 3)[:, column].mean() for column in (56, 58, 59, 60, 61, 75)]
    assert shares[0] < 0.02
    assert 0.02 < shares[1] < shares[2] < 0.5 < shares[3] < shares[4] < 1.0
    assert shares[5] == 1.0


def test_wandering_leaves_slanted_surfaces_and_holes_alone(rng):
    slope = np.tile(0.5 + 0.002 * np.arange(160, dtype=np.float32), (50, 1))
    slope[20:30, 40:60] = 0.0
    moved, _ = wander_edges(slope, np.zeros(slope.shape, int), 1.0, rng)
    np.testing.assert_array_equal(moved, slope)


def test_dark_objects_lose_patches_and_the_table_and_bright_ones_nothing(rng):
    ids = np.repeat(np.arange(40), 30)[None].repeat(60, axis=0)
    ids[50:] = -2
    depth = np.full(ids.shape, 0.6, np.float32)
    lost = dark_pixels(depth, ids, 0.5, rng)
    assert not lost[50:].any()
    shares = np.array([lost[ids == each].mean() for each in range(40)])
    assert 0.2 < (shares > 0).mean() < 0.7
    assert 0.2 < shares[shares > 0].mean() < 0.8
    # In patches: most neighbours of a lost pixel are lost as well.
    assert (lost[:, 1:] & lost[:, :-1]).sum() > 0.8 * lost.sum()
    assert not dark_pixels(depth, ids, 0.0, rng).any()
    assert not dark_pixels(depth, np.full(ids.shape, -2), 1.0, rng).any()
