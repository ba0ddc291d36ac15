import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icgnet.errors import InputError
from icgnet.geometry.clouds import (
    PointCloud,
    check_points,
    crop,
    estimate_normals,
    radius_outlier_mask,
    statistical_outlier_mask,
    voxel_downsample,
)
from icgnet.geometry.transforms import make_transform, random_rotation, rotation_z, transform_points, transform_vectors
from reference import normal_at

seeds = st.integers(0, 2**32 - 1)


def plane_patch(rng: np.random.Generator, count: int = 2000) -> np.ndarray:
    return np.column_stack([rng.uniform(0, 0.1, (count, 2)), np.full(count, 0.05)])


def sphere_points(rng: np.random.Generator, count: int, radius: float) -> np.ndarray:
    directions = rng.normal(size=(count, 3))
    return radius * directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_finite_points_pass_and_others_are_dropped():
    points = np.random.default_rng(0).uniform(0, 0.3, (120, 3))
    points[3, 1], points[5, 2] = np.nan, np.inf
    assert np.array_equal(check_points(points), np.delete(points, [3, 5], axis=0))
    assert check_points(points.astype(np.float32)).dtype == np.float64


@pytest.mark.parametrize(
    ("points", "message"),
    [
        (np.zeros((0, 3)), r"0 finite points \(of 0 given\), at least 100"),
        (np.full((500, 3), np.nan), r"0 finite points \(of 500 given\), at least 100"),
        (np.zeros((99, 3)), r"99 finite points \(of 99 given\), at least 100"),
        (np.zeros((100, 4)), r"shape \(n, 3\), got \(100, 4\)"),
        (np.zeros((10, 20, 3)), r"shape \(n, 3\), got \(10, 20, 3\)"),
        (np.random.default_rng(0).uniform(0, 300, (500, 3)), "looks like millimetres"),
    ],
)
def test_unusable_cloud_is_refused_with_its_numbers(points, message):
    with pytest.raises(InputError, match=message) as error:
        check_points(points)
    assert "\n" not in str(error.value)


def test_metric_cloud_of_a_whole_room_is_not_taken_for_millimetres():
    assert len(check_points(np.random.default_rng(0).uniform(-5, 5, (500, 3)))) == 500


def test_transformed_cloud_takes_its_viewpoint_along():
    cloud = PointCloud(np.array([[1.0, 0, 0]]), np.array([0.0, 0, 1]), "camera")
    moved = cloud.transformed(make_transform(rotation_z(np.pi / 2), np.array([0, 0, 1.0])), "world")
    assert np.allclose(moved.points, [[0, 1, 1]])
    assert np.allclose(moved.viewpoint, [0, 0, 2])
    assert moved.frame_id == "world"


def test_crop_keeps_the_border():
    points = np.array([[0, 0, 0], [0.3, 0.3, 0.3], [0.31, 0, 0], [0, -0.01, 0]])
    assert crop(points, np.zeros(3), np.full(3, 0.3)).tolist() == [True, True, False, False]


def test_voxel_means_of_a_hand_worked_cloud():
    points = np.array([[0.001, 0.0, 0.0], [0.002, 0.0, 0.0], [0.004, 0.0, 0.0], [-0.001, 0.0, 0.0]])
    means, inverse = voxel_downsample(points, 0.003)
    assert np.allclose(means, [[-0.001, 0, 0], [0.0015, 0, 0], [0.004, 0, 0]])
    assert inverse.tolist() == [1, 1, 2, 0]


@given(seeds, st.floats(0.003, 0.1))
def test_voxel_downsampling_matches_a_dictionary_of_voxels(seed, size):
    points = np.random.default_rng(seed).uniform(-0.2, 0.2, (60, 3))
    voxels: dict[tuple, list[int]] = {}
    for index, point in enumerate(points):
        voxels.setdefault(tuple(np.floor(point / size)), []).append(index)
    means, inverse = voxel_downsample(points, size)
    assert len(means) == len(voxels)
    for members in voxels.values():
        assert len(set(inverse[members])) == 1
        assert np.allclose(means[inverse[members[0]]], points[members].mean(axis=0))


def test_empty_cloud_has_no_voxels():
    means, inverse = voxel_downsample(np.zeros((0, 3)), 0.003)
    assert means.shape == (0, 3)
    assert inverse.shape == (0,)


@given(seeds, st.integers(0, 8))
def test_radius_outliers_match_counting_all_pairs(seed, neighbours):
    points = np.random.default_rng(seed).uniform(0, 1, (40, 3))
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    expected = (distance < 0.3).sum(axis=1) - 1 >= neighbours
    assert np.array_equal(radius_outlier_mask(points, 0.3, neighbours), expected)


def test_flying_pixel_is_an_outlier_by_radius_and_by_statistics():
    points = np.vstack([plane_patch(np.random.default_rng(0)), [[0.05, 0.05, 0.12]]])
    for kept in (radius_outlier_mask(points, 0.01, 5), statistical_outlier_mask(points, ratio=3.0)):
        assert not kept[-1]
        assert kept[:-1].mean() > 0.97


def test_statistical_filter_keeps_an_evenly_spaced_ring():
    angle = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    ring = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(50)])
    assert statistical_outlier_mask(ring, neighbours=4).all()


def test_outlier_masks_of_almost_empty_clouds():
    assert radius_outlier_mask(np.zeros((0, 3)), 0.01, 3).shape == (0,)
    assert not radius_outlier_mask(np.zeros((2, 3)), 0.01, 3).any()
    assert statistical_outlier_mask(np.zeros((1, 3))).all()


def test_normals_of_a_plane_face_the_viewpoint():
    points = plane_patch(np.random.default_rng(0))
    above = estimate_normals(points, np.array([0.3, 0.0, 0.5]))
    below = estimate_normals(points, np.array([0.3, 0.0, -0.5]))
    assert np.allclose(above, [0, 0, 1], atol=1e-6)
    assert np.allclose(below, [0, 0, -1], atol=1e-6)
    assert np.allclose(estimate_normals(points), [0, 0, 1], atol=1e-6)


def test_normals_of_a_ball_point_away_from_its_centre():
    points = sphere_points(np.random.default_rng(0), 20000, 0.05)
    viewpoint = np.array([0.0, 0.0, 1.0])
    facing = points[points[:, 2] > 0.01]
    normals = estimate_normals(points, viewpoint, queries=facing)
    assert np.einsum("nd,nd->n", normals, facing / 0.05).min() > 0.99


@settings(max_examples=20)
@given(seeds)
def test_normals_match_the_slow_version(seed):
    rng = np.random.default_rng(seed)
    points = plane_patch(rng, 300) + rng.normal(0, 0.001, (300, 3))
    viewpoint = rng.uniform(-1, 1, 3) + np.array([0, 0, 1.5])
    normals = estimate_normals(points, viewpoint, neighbours=12, radius=0.02)
    for index in rng.integers(300, size=5):
        expected = normal_at(points, points[index], viewpoint, 12, 0.02)
        assert np.allclose(normals[index], expected, atol=1e-6)


@settings(max_examples=20)
@given(seeds)
def test_normals_turn_with_the_cloud(seed):
    rng = np.random.default_rng(seed)
    points = sphere_points(rng, 500, 0.05)
    viewpoint = np.array([0.1, -0.2, 0.6])
    T = make_transform(random_rotation(rng), rng.uniform(-1, 1, 3))
    expected = transform_vectors(T, estimate_normals(points, viewpoint))
    moved = estimate_normals(transform_points(T, points), transform_points(T, viewpoint))
    assert np.allclose(moved, expected, atol=1e-6)


def test_lonely_point_has_the_direction_to_the_viewpoint():
    points = np.array([[0.0, 0.0, 0.0], [5.0, 0.0, 0.0]])
    normals = estimate_normals(points, np.array([0.0, 0.0, 2.0]))
    assert np.allclose(normals, [[0, 0, 1], np.array([-5, 0, 2]) / np.sqrt(29)])
    assert estimate_normals(np.zeros((0, 3))).shape == (0, 3)


def test_normals_are_exact_far_from_the_origin():
    points = plane_patch(np.random.default_rng(0), 500) + np.array([1000.0, -2000.0, 500.0])
    normals = estimate_normals(points, np.array([1000.0, -2000.0, 501.0]))
    assert np.allclose(normals, [0, 0, 1], atol=1e-6)
