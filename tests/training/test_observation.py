from dataclasses import replace

import numpy as np
import pytest

from icgnet.geometry.transforms import transform_points, yaw_about
from icgnet.geometry.workspace import CENTRE, SIZE, TABLE_HEIGHT
from icgnet.network.config import NETWORKS
from icgnet.sensors.config import NOISES, SensorNoise, exactly
from icgnet.training.config import Sampling
from icgnet.training.observation import sense, take_picture

CLEAN = replace(Sampling().for_validation(), noise=NOISES["clean"])
RAW, FUSED = replace(CLEAN, tsdf=0.0), replace(CLEAN, tsdf=1.0)


@pytest.fixture
def placements(make_dataset):
    dataset = make_dataset(CLEAN, NETWORKS["tiny"])
    return dataset._placements(dataset.recipes[0])


def look(placements, sampling, seed=0):
    rng = np.random.default_rng(seed)
    picture = take_picture(placements, sampling, rng)
    return picture, sense(picture, sampling.noise, TABLE_HEIGHT, rng)


def distance_to(placement, points):
    local = (points - placement.T_world_object[:3, 3]) @ placement.T_world_object[:3, :3] / placement.scale
    return placement.assets.distance.distance(local) * placement.scale


@pytest.mark.parametrize("sampling", [RAW, FUSED], ids=["pixels", "fused"])
@pytest.mark.parametrize("seed", range(4))
def test_every_point_lies_on_the_object_that_owns_it(placements, sampling, seed):
    _, seen = look(placements, sampling, seed)
    assert len(seen.points) > 1000
    assert (seen.owners >= 0).mean() > 0.97
    for index, placement in enumerate(placements):
        own = seen.points[seen.owners == index]
        distance = np.abs(distance_to(placement, own))
        assert np.median(distance) < 0.0006
        # At a silhouette the distance grid rounds off by up to a voxel or two.
        assert np.percentile(distance, 98) < 0.004


def test_both_clouds_show_the_same_objects_from_the_same_camera(placements):
    (first, raw), (second, fused) = look(placements, RAW, 1), look(placements, FUSED, 1)
    np.testing.assert_array_equal(first.view.T_world_camera, second.view.T_world_camera)
    assert (first.fused, second.fused) == (False, True)
    for index in range(len(placements)):
        a, b = (each.points[each.owners == index] for each in (raw, fused))
        np.testing.assert_allclose(a.min(axis=0), b.min(axis=0), atol=0.004)
        np.testing.assert_allclose(a.max(axis=0), b.max(axis=0), atol=0.004)


@pytest.mark.parametrize("sampling", [RAW, FUSED], ids=["pixels", "fused"])
def test_the_table_is_gone_up_to_the_height_that_is_asked_for(placements, sampling):
    picture, _ = look(placements, sampling, 2)
    rng = np.random.default_rng(0)
    assert sense(picture, NOISES["clean"], TABLE_HEIGHT, rng).points[:, 2].min() > TABLE_HEIGHT + 0.0039
    lower = sense(picture, NOISES["clean"], TABLE_HEIGHT - 0.01, rng)
    assert (lower.owners == -2).any()


def test_a_turned_scene_gives_a_turned_cloud(placements):
    T_work_world = yaw_about(CENTRE, 1.0)
    picture, seen = look(placements, RAW, 3)
    turned = sense(picture.seen_from(T_work_world), NOISES["clean"], TABLE_HEIGHT, np.random.default_rng(0))
    np.testing.assert_allclose(turned.points, transform_points(T_work_world, seen.points), atol=1e-6)
    np.testing.assert_allclose(turned.viewpoint, transform_points(T_work_world, seen.viewpoint), atol=1e-9)


def test_a_fused_cloud_lies_in_the_workspace(placements):
    picture, _ = look(placements, FUSED, 3)
    points = sense(picture, NOISES["realsense"], TABLE_HEIGHT, np.random.default_rng(0)).points
    assert ((points >= 0) & (points <= SIZE)).all()


def test_shares_of_the_visits_are_as_configured(placements):
    sampling = replace(RAW, tsdf=0.4, half_resolution=0.5)
    kinds = [take_picture(placements, sampling, np.random.default_rng(seed)) for seed in range(150)]
    fused = np.array([each.fused for each in kinds])
    half = np.array([each.view.intrinsics[0, 0] < 500 for each in kinds])
    assert fused.mean() == pytest.approx(0.4, abs=0.12)
    assert half[~fused].mean() == pytest.approx(0.5, abs=0.15)
    assert not half[fused].any()


def test_image_and_cloud_are_spoiled_by_the_same_one_of_several_noises(placements):
    picture = take_picture(placements, CLEAN, np.random.default_rng(0))
    kinds = (SensorNoise(shadow=exactly(1.0), drop=exactly(0.5)), SensorNoise())
    clean = len(sense(picture, SensorNoise(), TABLE_HEIGHT, np.random.default_rng(0)).points)
    counts = {
        len(sense(picture, SensorNoise(one_of=kinds), TABLE_HEIGHT, np.random.default_rng(seed)).points) / clean
        for seed in range(12)
    }
    assert 1.0 in counts
    assert all(share == 1.0 or share < 0.55 for share in counts)
    assert len(counts) > 1
