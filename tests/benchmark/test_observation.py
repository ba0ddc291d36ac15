"""The numbers of the published protocol: where the camera stands, and how a cloud is made of its picture."""

from types import SimpleNamespace

import numpy as np
import pytest

from box_objects import EDGE, BoxAndBall, placed
from icgnet.benchmark import observation
from icgnet.benchmark.observation import Observation, draw_camera, observe
from icgnet.grasping.gripper import load_gripper
from icgnet.sensors.config import NOISES

GRIPPER = load_gripper()
SCENE = placed(("box", (0.15, 0.15, 0.05 + EDGE / 2)))
CLUSTER = np.array([0.15, 0.15, 0.10])


def look(noise: str = "none", view: str = "top", seed: int = 0) -> Observation:
    return observe(SCENE, BoxAndBall(), view, noise, GRIPPER, True, np.random.default_rng(seed))


def cameras(view: str, target_height: float) -> np.ndarray:
    """Distance from the target, angle from the vertical and azimuth [degrees] of many cameras, n x 3."""
    rng = np.random.default_rng(0)
    poses = np.array([draw_camera(view, rng) for _ in range(400)])
    outward = poses[:, :3, 3] - [0.15, 0.15, target_height]
    distance = np.linalg.norm(outward, axis=1)
    np.testing.assert_allclose(poses[:, :3, 2], -outward / distance[:, None], atol=1e-9)  # they look at the target
    polar = np.degrees(np.arccos(np.clip(outward[:, 2] / distance, -1, 1)))
    return np.column_stack([distance, polar, np.degrees(np.arctan2(outward[:, 1], outward[:, 0]))])


@pytest.mark.parametrize(("view", "polar"), [("random", (45.0, 60.0)), ("top", (0.0, 2.0))])
def test_cameras_fill_the_published_range(view, polar):
    drawn = cameras(view, target_height=0.25)
    least, most = np.array([[0.60, polar[0], 0.0], [0.75, polar[1], 180.0]])
    assert (drawn >= least - 1e-6).all()
    assert (drawn <= most + 1e-6).all()
    room = 0.02 * (most - least)
    assert (drawn.min(axis=0) < least + room).all()
    assert (drawn.max(axis=0) > most - room).all()


def test_the_side_camera_stands_in_one_place():
    np.testing.assert_allclose(
        cameras("side", target_height=0.10), np.broadcast_to([0.60, 60.0, -90.0], (400, 3)), atol=1e-6
    )


@pytest.fixture
def fused(monkeypatch):
    """Puts points in place of those that the picture is fused to; gives what is left of them."""

    def make(points: np.ndarray) -> np.ndarray:
        grid = SimpleNamespace(surface_points=lambda: np.array(points, np.float64))
        monkeypatch.setattr(observation, "fuse", lambda *_, **__: grid)
        return look().cloud.points

    return make


def cluster(count: int, middle: np.ndarray = CLUSTER) -> np.ndarray:
    """Points within 1 mm."""
    return middle + np.random.default_rng(count).uniform(-0.0005, 0.0005, (count, 3))


def test_the_grid_has_180_voxels_along_an_edge(monkeypatch):
    seen, fuse = [], observation.fuse
    monkeypatch.setattr(observation, "fuse", lambda *given, **named: seen.append(given) or fuse(*given, **named))
    look()
    assert seen[0][3] == 180


@pytest.mark.parametrize(
    ("axis", "least", "most"), [(0, 0.02, 0.28), (1, 0.02, 0.28), (2, 0.055, 0.30)], ids=["x", "y", "z"]
)
def test_the_cloud_ends_2_cm_inside_the_workspace_and_5_mm_above_the_table(fused, axis, least, most):
    step = 1e-6
    for edge, inward in ((least, 1), (most, -1)):
        points = np.tile(CLUSTER, (200, 1))
        points[:, axis] = edge + inward * step
        assert len(fused(points)) == 200
        points[:100, axis] = edge - inward * step
        assert len(fused(points)) == 100


@pytest.mark.parametrize(("neighbours", "stays"), [(20, True), (19, False)])
def test_points_with_fewer_than_20_others_within_2_cm_are_removed(fused, neighbours, stays):
    lonely = cluster(neighbours + 1, middle=CLUSTER + [0.1, 0.0, 0.0])
    assert len(fused(np.concatenate([cluster(200), lonely]))) == 200 + stays * len(lonely)


@pytest.mark.parametrize(("distance", "stays"), [(0.0195, True), (0.0205, False)])
def test_the_others_count_up_to_2_cm(fused, distance, stays):
    points = np.concatenate([np.tile(CLUSTER, (200, 1)), CLUSTER[None] + [distance, 0.0, 0.0]])
    assert len(fused(points)) == 200 + stays


@pytest.mark.parametrize(("count", "left"), [(100, 100), (99, 0)])
def test_fewer_than_100_points_are_none(fused, count, left):
    assert len(fused(cluster(count))) == left


def test_gaussian_noise_is_of_08_mm_in_every_direction_and_on_the_points(fused):
    fused(np.tile(CLUSTER, (5000, 1)))
    noisy = look("gaussian").cloud.points
    np.testing.assert_allclose(noisy.std(axis=0), 0.0008, rtol=0.04)
    np.testing.assert_allclose(noisy.mean(axis=0), CLUSTER, atol=6e-5)
    np.testing.assert_array_equal(look("gaussian").depth, look("none").depth)


def test_noise_may_carry_points_over_the_edge_they_were_cut_at(fused):
    """The published order: first the crop, then the noise."""
    fused(np.tile([0.15, 0.15, 0.0551], (1000, 1)))
    assert (look("gaussian").cloud.points[:, 2] < 0.055).any()


def test_dex_noise_is_on_the_depth_and_not_on_the_points(fused):
    assert observation.SENSORS["dex"] == NOISES["dex"]
    ratio = np.array([np.median(look("dex", seed=seed).depth / look("none", seed=seed).depth) for seed in range(8)])
    assert 0.01 < ratio.std() < 0.06, "one factor on the whole image, of 3.2 %"
    fused(np.tile(CLUSTER, (200, 1)))
    np.testing.assert_array_equal(look("dex").cloud.points, np.tile(CLUSTER, (200, 1)))


def test_without_noise_the_cloud_lies_on_the_box():
    points = look(view="random").cloud.points
    assert len(points) > 500
    outside = np.abs(points - [0.15, 0.15, 0.05 + EDGE / 2]) - EDGE / 2
    distance = np.linalg.norm(np.maximum(outside, 0), axis=1) + np.minimum(outside.max(axis=1), 0)
    assert np.median(np.abs(distance)) < 0.0005
    assert np.abs(distance).max() < 0.004
