import numpy as np
import pytest

from icgnet.geometry.camera import pixel_rays
from icgnet.sensors.stereo import add_disparity_noise, quantise_disparity, stereo_shadow
from icgnet.studies.depth_measures import depth_step, find_edges, flat_windows, holes, measure_frame

FOCAL = 580.0
INTRINSICS = np.array([[FOCAL, 0.0, 159.5], [0.0, FOCAL, 119.5], [0.0, 0.0, 1.0]])
SHAPE = (240, 320)


def tilted(angle_deg, distance=0.8):
    normal = np.array([0.0, np.sin(np.deg2rad(angle_deg)), -np.cos(np.deg2rad(angle_deg))])
    return distance * normal[2] / (pixel_rays(INTRINSICS, SHAPE) @ normal)


def posts(near=0.6, far=0.8):
    """Three upright posts before a wall."""
    depth = np.full(SHAPE, far)
    for first in (50, 140, 230):
        depth[:, first : first + 40] = near
    return depth


def test_noise_of_a_tilted_plane_is_told_whatever_its_tilt():
    plain = tilted(50.0)
    noisy = plain + 0.001 * plain**2 * np.random.default_rng(0).standard_normal(SHAPE)
    noise, tilt, alike = flat_windows(noisy, INTRINSICS, 15, ((0, 1), (4, 0)))
    assert np.median(noise) == pytest.approx(1.0, rel=0.05)
    assert np.median(tilt) == pytest.approx(50.0, abs=3.0)
    assert np.abs(np.median(alike, axis=0)).max() < 0.05


def test_correlation_and_waves_are_told_from_independent_noise():
    wavy = add_disparity_noise(np.full(SHAPE, 0.8), FOCAL, 0.1, np.random.default_rng(0), 0.075, (4, 12))
    measures, _ = measure_frame(wavy, INTRINSICS, FOCAL)
    assert measures.alike_1 is not None
    assert measures.alike_4 is not None
    assert measures.noise is not None
    assert measures.ripple is not None
    assert measures.alike_1 > 0.8
    assert measures.alike_down is not None
    assert measures.alike_down < 0.1 < measures.alike_4 < measures.alike_1
    assert measures.ripple > 1.1 * measures.noise


def test_windows_with_holes_or_edges_do_not_count():
    depth = posts()
    depth[::10, ::10] = 0.0
    assert len(flat_windows(depth, INTRINSICS, 15, ((0, 1),))[0]) == 0
    assert measure_frame(depth, INTRINSICS, FOCAL)[0].noise is None


def test_the_steps_of_the_disparity_are_found():
    depth = quantise_disparity(tilted(50.0), FOCAL, 1 / 8, 0.075)
    assert depth_step(depth, 0.8) == pytest.approx(1000 * 0.8**2 / (8 * FOCAL * 0.075), rel=0.05)


def test_holes_inside_of_surfaces_are_told_from_those_at_edges():
    depth = posts()
    assert holes(depth) == (0.0, 0.0)
    depth[:, 49:52] = 0.0
    assert holes(depth) == (pytest.approx(3 / SHAPE[1]), 0.0)
    depth[:, 10:18] = 0.0
    assert holes(depth) == pytest.approx((11 / SHAPE[1], 8 / SHAPE[1]))
    depth[:, 100:] = 0.0
    depth[:, -1] = 0.8
    assert holes(depth)[0] == pytest.approx(11 / 101), "what is wider was cut away"


def test_edges_are_found_on_both_sides_with_their_holes():
    depth = posts()
    depth[:, 45:50] = 0.0
    edges = find_edges(depth)
    assert len(edges.row) == 6 * SHAPE[0]
    assert set(edges.place[~edges.right].tolist()) == {50, 140, 230}
    assert set(edges.place[edges.right].tolist()) == {89, 179, 269}
    assert (edges.holes[edges.place == 50] == 5).all()
    assert (edges.holes[edges.place != 50] == 0).all()
    assert (edges.flying == 0).all()
    np.testing.assert_allclose(edges.near, 0.6)
    np.testing.assert_allclose(edges.far, 0.8)


def test_flying_pixels_are_counted_and_a_gradual_side_is_none():
    depth = posts()
    depth[:, 49] = 0.7
    assert find_edges(depth).flying.sum() == SHAPE[0]
    ramp = posts()
    ramp[:, 90:105] = np.linspace(0.61, 0.68, 15)
    assert (find_edges(ramp).flying == 0).all()


def test_shadows_tell_the_baseline_and_their_side():
    depth = posts().astype(np.float32)
    depth[stereo_shadow(depth, FOCAL, mirrored=True, baseline=0.075)] = 0.0
    measures, samples = measure_frame(depth.astype(np.float64), INTRINSICS, FOCAL)
    assert measures.shadow_baseline == pytest.approx(0.075, rel=0.06)
    assert measures.holes_lit == 0.0
    assert measures.holes_shadow == pytest.approx(FOCAL * 0.075 * (1 / 0.6 - 1 / 0.8), abs=1)
    assert samples.holes.max() == measures.holes_shadow


def test_raggedness_is_the_displacement_of_independent_rows():
    rng = np.random.default_rng(0)
    depth = posts()
    for row, shift in enumerate(np.rint(rng.normal(0, 1.0, SHAPE[0])).astype(int)):
        depth[row] = np.roll(depth[row], shift)
    ragged = measure_frame(depth, INTRINSICS, FOCAL)[0].ragged
    assert ragged == pytest.approx(1.0, rel=0.2)
    assert measure_frame(posts(), INTRINSICS, FOCAL)[0].ragged == 0.0


def test_lengths_are_pixels_of_the_sensor_in_an_image_of_half_the_size():
    large = np.kron(posts(), np.ones((2, 2)))
    large[:, 94:100] = 0.0
    intrinsics = INTRINSICS * [[2.0, 1.0, 2.0], [1.0, 2.0, 2.0], [1.0, 1.0, 1.0]]
    small = large[::2, ::2]
    whole, half = (
        measure_frame(depth, matrix, 2 * FOCAL)[0] for depth, matrix in ((large, intrinsics), (small, INTRINSICS))
    )
    assert (whole.smaller, half.smaller) == (1, 2)
    assert half.holes_shadow == pytest.approx(whole.holes_shadow, rel=0.05)


def test_an_empty_image_tells_nothing():
    measures, samples = measure_frame(np.zeros(SHAPE), INTRINSICS, FOCAL)
    assert measures.noise is measures.ragged is measures.step is None
    assert len(samples.holes) == len(samples.noise) == 0
