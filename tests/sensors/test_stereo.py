import numpy as np
import pytest

from icgnet.geometry.camera import DEFAULT_INTRINSICS, pixel_rays
from icgnet.sensors.config import BASELINE
from icgnet.sensors.stereo import (
    RIPPLE_PITCH,
    add_disparity_noise,
    fatten_edges,
    grazing_pixels,
    quantise_disparity,
    stereo_shadow,
)

FOCAL = 540.0


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def pole(near=0.5, far=0.7, first=60, last=90):
    depth = np.full((40, 160), far, np.float32)
    depth[:, first:last] = near
    return depth


@pytest.mark.parametrize("distance", [0.4, 0.6, 0.9])
def test_disparity_noise_is_the_error_of_a_stereo_pair_and_alike_for_neighbours(distance, rng):
    errors = add_disparity_noise(np.full((300, 300), distance, np.float32), FOCAL, 0.1, rng) - distance
    assert errors.std() == pytest.approx(distance**2 * 0.1 / (FOCAL * BASELINE), rel=0.08)
    correlation = [np.corrcoef(errors[:, :-lag].ravel(), errors[:, lag:].ravel())[0, 1] for lag in (1, 5, 12)]
    assert correlation[0] > 0.8
    assert 0.1 < correlation[1] < 0.45
    assert abs(correlation[2]) < 0.1


@pytest.mark.parametrize("window", [(1, 1), (4, 12), (1, 6), RIPPLE_PITCH])
def test_disparity_noise_is_alike_within_the_window_and_as_large_for_all(window, rng):
    errors = add_disparity_noise(np.full((400, 400), 0.8, np.float32), FOCAL, 0.1, rng, 0.075, window) - 0.8
    assert errors.std() == pytest.approx(0.8**2 * 0.1 / (FOCAL * 0.075), rel=0.1)
    for image, length in ((errors, window[1]), (errors.T, window[0])):
        alike = [np.corrcoef(image[:, :-lag].ravel(), image[:, lag:].ravel())[0, 1] for lag in (1, 2 * length)]
        assert (alike[0] > 0.8) == (length > 1)
        assert abs(alike[1]) < 0.2


def test_disparity_noise_leaves_unmeasured_pixels(rng):
    depth = pole()
    depth[5] = 0.0
    assert (add_disparity_noise(depth, FOCAL, 0.5, rng)[5] == 0).all()


def test_quantisation_step_grows_with_the_distance_squared():
    depth = np.linspace(0.4, 1.6, 20000)[None]
    levels = np.unique(quantise_disparity(depth, FOCAL, 0.25))
    steps, middle = np.diff(levels), 0.5 * (levels[1:] + levels[:-1])
    np.testing.assert_allclose(steps / middle**2, 0.25 / (FOCAL * BASELINE), rtol=0.05)
    assert np.abs(quantise_disparity(depth, FOCAL, 0.25) - depth).max() <= 0.53 * steps.max()
    assert quantise_disparity(np.zeros((2, 2)), FOCAL, 0.25).max() == 0


def test_the_shadow_lies_to_the_left_of_a_near_object_and_is_as_wide_as_the_disparities_differ():
    hidden = stereo_shadow(pole(), FOCAL)
    width = FOCAL * BASELINE * (1 / 0.5 - 1 / 0.7)
    columns = np.flatnonzero(hidden.all(axis=0))
    assert columns.max() == 59
    assert len(columns) == pytest.approx(width, abs=1)
    assert hidden.any(axis=0).sum() == len(columns)
    mirrored = np.flatnonzero(stereo_shadow(pole(), FOCAL, mirrored=True).all(axis=0))
    assert mirrored.min() == 90
    assert len(mirrored) == len(columns)


@pytest.mark.parametrize("baseline", [0.03, 0.075])
def test_shadows_are_as_wide_as_the_baseline_makes_them(baseline):
    hidden = stereo_shadow(pole(), FOCAL, mirrored=True, baseline=baseline).all(axis=0)
    assert np.flatnonzero(hidden).min() == 90
    assert hidden.sum() == pytest.approx(FOCAL * baseline * (1 / 0.5 - 1 / 0.7), abs=1)


def test_steps_of_the_kinect_are_the_published_ones():
    # Khoshelham and Elberink 2012: about 2.9 mm at 1 m, 1/8 pixel at 580 pixels and 75 mm.
    levels = np.unique(quantise_disparity(np.linspace(0.95, 1.05, 5000)[None], 580.0, 1 / 8, 0.075))
    assert np.diff(levels).mean() == pytest.approx(0.00287, rel=0.02)


def test_a_flat_or_tilted_surface_casts_no_shadow():
    u = np.arange(160, dtype=np.float32)
    for slope in (0.0, 0.002, -0.002):
        assert not stereo_shadow(np.tile(0.6 + slope * (u - 80), (5, 1)), FOCAL).any()


def test_unmeasured_pixels_neither_hide_nor_are_hidden():
    depth = pole()
    depth[:, 60:90] = 0.0
    assert not stereo_shadow(depth, FOCAL).any()


def test_near_surfaces_grow_by_the_reach_and_take_their_ids_with_them(rng):
    depth, ids = pole(), np.where(pole() < 0.6, 3, -2)
    grown, grown_ids = fatten_edges(depth, ids, 2, rng)
    changed = np.flatnonzero((grown != depth).any(axis=0))
    assert set(changed) == {58, 59, 90, 91}
    assert ((grown == 0.5) == (grown_ids == 3)).all()
    share = (grown != depth)[:, [59, 90]].mean()
    assert 0.1 < share < 0.9, "edges grow in patches"


def tilted_plane(angle_deg):
    """A plane through the optical axis at 0.6 m whose normal there leans by this much from the line of sight."""
    normal = np.array([np.sin(np.deg2rad(angle_deg)), 0.0, -np.cos(np.deg2rad(angle_deg))])
    depth = 0.6 * normal[2] / (pixel_rays(DEFAULT_INTRINSICS, (480, 640)) @ normal)
    return np.where((depth > 0) & (depth < 2), depth, 0.0).astype(np.float32)


@pytest.mark.parametrize(("angle", "lost"), [(0, False), (60, False), (88, True)])
def test_surfaces_seen_from_their_side_are_lost(angle, lost, rng):
    mask = grazing_pixels(tilted_plane(angle), DEFAULT_INTRINSICS, 0.25, rng)
    assert (mask[230:250, 319:322].mean() > 0.9) == lost
    assert (mask[230:250, 319:322].mean() < 0.1) != lost


def test_depth_edges_are_lost_but_not_the_walls_beside_them(rng):
    mask = grazing_pixels(pole(), DEFAULT_INTRINSICS, 0.2, rng)
    assert set(np.flatnonzero(mask.any(axis=0))) == {59, 60, 89, 90}
