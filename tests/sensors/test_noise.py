import zlib
from dataclasses import fields

import numpy as np
import pytest

from icgnet.errors import InputError
from icgnet.geometry.camera import DEFAULT_INTRINSICS
from icgnet.sensors.config import CAMERAS, NEVER, NOISES, Amount, SensorNoise, exactly, up_to
from icgnet.sensors.noise import corrupt_depth, corrupt_points
from icgnet.simulation.camera import NOTHING, DepthImage
from icgnet.training.gallery import ALONE

IMAGE_MODELS = {name: noise for name, noise in ALONE.items() if name != "clean"}


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def step_image():
    """A wall at 0.5 m before a wall at 0.7 m, and a column where nothing was measured."""
    depth = np.full((60, 80), 0.7, np.float32)
    depth[:, 30:50] = 0.5
    ids = np.where(depth == 0.5, 0, -2)
    depth[:, 70] = 0.0
    return DepthImage(depth, ids)


@pytest.mark.parametrize(
    ("amount", "share", "least", "most"),
    [(NEVER, 0.0, 0, 0), (exactly(2.0), 1.0, 2, 2), (up_to(3.0, 0.25), 0.25, 0, 3), (Amount(1.0, 2.0, 0.5), 0.5, 1, 2)],
)
def test_amounts_are_drawn_in_their_range_and_as_often_as_asked(amount, share, least, most, rng):
    drawn = np.array([amount.draw(rng) for _ in range(4000)])
    there = drawn[drawn > 0]
    assert len(there) / len(drawn) == pytest.approx(share, abs=0.03)
    if len(there):
        assert least <= there.min() <= there.max() <= most
        assert there.mean() == pytest.approx((least + most) / 2, rel=0.05)


def test_clean_sensor_changes_nothing(rng):
    image = corrupt_depth(step_image(), DEFAULT_INTRINSICS, NOISES["clean"], rng)
    np.testing.assert_array_equal(image.depth, step_image().depth)
    np.testing.assert_array_equal(image.ids, step_image().ids)
    points = rng.uniform(0, 0.3, (100, 3))
    kept, index = corrupt_points(points, NOISES["clean"], rng)
    np.testing.assert_array_equal(kept, points)
    np.testing.assert_array_equal(index, np.arange(100))


@pytest.mark.parametrize("name", NOISES)
def test_same_seed_gives_same_noise(name):
    first, second = (
        corrupt_depth(step_image(), DEFAULT_INTRINSICS, NOISES[name], np.random.default_rng(7)) for _ in range(2)
    )
    np.testing.assert_array_equal(first.depth, second.depth)
    np.testing.assert_array_equal(first.ids, second.ids)


@pytest.mark.parametrize("name", IMAGE_MODELS)
def test_each_model_alone_changes_the_picture_or_the_cloud_and_not_its_input(name, rng):
    image, points = step_image(), rng.uniform(0, 0.3, (500, 3))
    before = points.copy()
    sensed = corrupt_depth(image, DEFAULT_INTRINSICS, IMAGE_MODELS[name], np.random.default_rng(1))
    kept, index = corrupt_points(points, IMAGE_MODELS[name], np.random.default_rng(1))
    smooth_only = name.startswith("spatial filter")
    same = np.array_equal(sensed.depth, image.depth) and np.array_equal(kept, before)
    assert same == smooth_only, "walls without noise have nothing to smooth"
    np.testing.assert_array_equal(image.depth, step_image().depth)
    np.testing.assert_array_equal(points, before)
    assert len(kept) == len(index)
    assert np.abs(kept - points[index]).max() < 0.02


def test_every_error_is_shown_alone_once():
    for each in (each for each in fields(SensorNoise) if isinstance(each.default, Amount)):
        shown = [name for name, noise in ALONE.items() if getattr(noise, each.name) != NEVER]
        assert len(shown) == 1, each.name


@pytest.mark.parametrize("name", NOISES)
def test_unmeasured_pixels_stay_unmeasured_and_depths_stay_finite(name):
    for seed in range(5):
        image = corrupt_depth(step_image(), DEFAULT_INTRINSICS, NOISES[name], np.random.default_rng(seed))
        assert (image.depth[:, 70] == 0).all()
        assert np.isfinite(image.depth).all()
        assert (image.depth >= 0).all()


def test_flying_pixels_belong_to_nothing(rng):
    image = corrupt_depth(step_image(), DEFAULT_INTRINSICS, SensorNoise(flying=exactly(1.0)), rng)
    between = (image.depth > 0.5) & (image.depth < 0.7)
    assert between.any()
    assert (image.ids[between] == NOTHING).all()
    assert (image.ids[~between] == step_image().ids[~between]).all()


def test_the_dex_preset_is_the_published_one():
    wall = DepthImage(np.full((60, 60), 0.6, np.float32), np.zeros((60, 60), int))
    images = [
        corrupt_depth(wall, DEFAULT_INTRINSICS, NOISES["dex"], np.random.default_rng(s)).depth for s in range(400)
    ]
    flat = [np.ptp(image) < 1e-6 for image in images]
    assert np.mean(flat) == pytest.approx(0.5, abs=0.08)
    assert np.std([image.mean() / 0.6 for image in images]) == pytest.approx(1000**-0.5, rel=0.12)
    rough = np.mean([image.std() for image, smooth in zip(images, flat, strict=True) if not smooth])
    assert rough == pytest.approx(0.005 * 2 / 3, rel=0.1)


def test_the_realsense_preset_errs_by_millimetres_and_more_when_farther():
    errors = []
    for distance in (0.4, 0.8):
        wall = DepthImage(np.full((120, 160), distance, np.float32), np.zeros((120, 160), int))
        sensed = [
            corrupt_depth(wall, DEFAULT_INTRINSICS, NOISES["realsense"], np.random.default_rng(s)).depth
            for s in range(20)
        ]
        errors.append(np.mean([image[image > 0].std() for image in sensed]))
    assert 0.0005 < errors[0] < 0.0015
    assert 2.5 < errors[1] / errors[0] < 4.5


def test_point_noise_keeps_track_of_which_point_is_which(rng):
    points = rng.uniform(0, 0.3, (5000, 3))
    kept, index = corrupt_points(points, SensorNoise(gaussian=up_to(0.002), drop=exactly(0.3)), rng)
    assert len(kept) / 5000 == pytest.approx(0.7, abs=0.03)
    assert np.abs(kept - points[index]).max() < 0.012


def test_empty_cloud_survives(rng):
    everything = SensorNoise(
        blocks=exactly(0.2), drop=exactly(0.3), deformation=exactly(0.001), gaussian=exactly(0.002)
    )
    kept, index = corrupt_points(np.zeros((0, 3)), everything, rng)
    assert kept.shape == (0, 3)
    assert len(index) == 0


def box_on_a_slope():
    v, u = np.indices((90, 120))
    depth, ids = (0.5 + 0.001 * v + 0.0005 * u).astype(np.float32), np.full((90, 120), -2)
    depth[20:60, 40:80] -= np.float32(0.1)
    ids[20:60, 40:80] = 0
    depth[:, 100], ids[:, 100] = 0.0, -1
    return DepthImage(depth, ids)


@pytest.mark.parametrize(
    ("name", "picture", "kept", "following"),
    [
        ("clean", 2681763208, 19900, 0.7074955673371773),
        ("gaussian", 2681763208, 19900, 0.30381958476026616),
        ("dex", 1595828642, 19900, 0.5033639655536645),
        ("realsense", 2775995525, 19900, 0.07608352812014951),
        ("mixed", 58394517, 17668, 0.04399601123237251),
    ],
)
def test_published_presets_give_the_pictures_and_clouds_that_they_gave_when_weights_were_trained(
    name, picture, kept, following
):
    rng = np.random.default_rng(5)
    sensed = corrupt_depth(box_on_a_slope(), DEFAULT_INTRINSICS, NOISES[name], rng)
    pixels = np.rint(sensed.depth * 1e6).astype(np.int32).tobytes() + sensed.ids.astype(np.int32).tobytes()
    assert zlib.crc32(pixels) == picture
    _, index = corrupt_points(np.linspace(0, 0.3, 600).reshape(200, 3), NOISES[name], rng)
    assert index.sum() == kept
    assert rng.random() == following


def test_one_kind_is_drawn_for_each_picture(rng):
    kinds = [NOISES[name] for name in ("stereo", "structured_light", "time_of_flight")]
    drawn = [NOISES["wide"].pick(rng) for _ in range(300)]
    assert all(each in kinds for each in drawn)
    assert min(drawn.count(kind) for kind in kinds) > 60
    pick, straight = np.random.default_rng(3), np.random.default_rng(3)
    picked = NOISES["wide"].pick(pick)
    np.testing.assert_array_equal(
        corrupt_depth(box_on_a_slope(), DEFAULT_INTRINSICS, picked, pick).depth,
        corrupt_depth(box_on_a_slope(), DEFAULT_INTRINSICS, NOISES["wide"], straight).depth,
    )


def test_a_disparity_without_a_baseline_is_refused():
    assert SensorNoise(baseline=0.0).baseline == 0.0
    with pytest.raises(InputError, match="baseline above 0 m, got 0"):
        SensorNoise(baseline=0.0, ripple=exactly(0.1))


def test_a_single_kind_is_picked_without_a_draw():
    rng = np.random.default_rng(3)
    assert NOISES["mixed"].pick(rng) is NOISES["mixed"]
    assert rng.random() == np.random.default_rng(3).random()


@pytest.mark.parametrize(("colour", "left", "right"), [(0.0, 0.075, 0.0), (0.025, 0.050, 0.025), (-0.015, 0.090, 0.0)])
def test_aligned_depth_is_lost_where_camera_or_projector_does_not_see(colour, left, right):
    depth = np.full((20, 160), 0.7, np.float32)
    depth[:, 60:90] = 0.5
    noise = SensorNoise(shadow=exactly(1.0), baseline=0.075, colour=colour)
    for seed in range(4):
        sensed = corrupt_depth(DepthImage(depth, np.zeros(depth.shape, int)), DEFAULT_INTRINSICS, noise, rng_of(seed))
        lost = (sensed.depth == 0).all(axis=0)
        widths = sorted((lost[:60].sum(), lost[90:].sum()))
        expected = [540 * baseline * (1 / 0.5 - 1 / 0.7) for baseline in sorted((left, right))]
        assert widths == pytest.approx(expected, abs=1.5)


def rng_of(seed):
    return np.random.default_rng(seed)


@pytest.mark.parametrize("name", CAMERAS)
def test_cameras_have_their_axis_in_the_middle_and_noise_that_grows_with_the_distance(name):
    camera = CAMERAS[name]
    assert camera.name == name
    height, width = camera.shape
    np.testing.assert_allclose(camera.intrinsics[:2, 2], ((width - 1) / 2, (height - 1) / 2))
    assert camera.intrinsics[0, 0] == camera.intrinsics[1, 1] == camera.focal
    spread = []
    for distance in (0.35, 1.4):
        wall = DepthImage(np.full((120, 160), distance, np.float32), np.full((120, 160), -2))
        images = [corrupt_depth(wall, camera.intrinsics, camera.noise, rng_of(seed)).depth for seed in range(4)]
        assert all((image > 0).mean() > 0.8 for image in images)
        spread.append(np.mean([image[image > 0].std() for image in images]))
    assert 2.0 < spread[1] / spread[0] < 40.0
    assert spread[1] < 0.03
