import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from icgnet.errors import InputError
from icgnet.geometry.transforms import (
    check_transform,
    invert_transform,
    make_transform,
    matrix_to_quaternion,
    quaternion_to_matrix,
    random_rotation,
    rotation_z,
    transform_points,
    transform_vectors,
    yaw_about,
)

seeds = st.integers(0, 2**32 - 1)


def random_transform(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return make_transform(random_rotation(rng), rng.uniform(-1, 1, 3))


@given(seeds)
def test_random_rotation_is_proper(seed):
    R = random_rotation(np.random.default_rng(seed))
    assert np.allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert abs(np.linalg.det(R) - 1) < 1e-9


@given(seeds)
def test_inverse_undoes_a_transform(seed):
    T = random_transform(seed)
    points = np.random.default_rng(seed).uniform(-1, 1, (5, 3))
    assert np.allclose(invert_transform(T) @ T, np.eye(4), atol=1e-12)
    assert np.allclose(transform_points(invert_transform(T), transform_points(T, points)), points, atol=1e-12)


@given(seeds)
def test_transforms_chain_like_their_matrices(seed):
    T_a_b, T_b_c = random_transform(seed), random_transform(seed + 1)
    points = np.random.default_rng(seed).uniform(-1, 1, (5, 3))
    one_by_one = transform_points(T_a_b, transform_points(T_b_c, points))
    assert np.allclose(transform_points(T_a_b @ T_b_c, points), one_by_one, atol=1e-12)


def test_vectors_are_turned_but_not_shifted():
    T = make_transform(rotation_z(np.pi / 2), np.array([1.0, 2.0, 3.0]))
    assert np.allclose(transform_vectors(T, np.array([[1.0, 0.0, 0.0]])), [[0, 1, 0]])
    assert np.allclose(transform_points(T, np.array([[1.0, 0.0, 0.0]])), [[1, 3, 3]])


def test_batched_transforms_broadcast_over_the_leading_axes():
    T = make_transform(np.eye(3), np.arange(6.0).reshape(2, 3))
    assert T.shape == (2, 4, 4)
    assert np.allclose(invert_transform(T)[:, :3, 3], -np.arange(6.0).reshape(2, 3))


def test_quaternions_have_the_scalar_first():
    half = np.sqrt(0.5)
    assert np.allclose(quaternion_to_matrix(np.array([half, 0, 0, half])), rotation_z(np.pi / 2))
    assert np.allclose(matrix_to_quaternion(rotation_z(np.pi / 2)), [half, 0, 0, half])


@given(seeds)
def test_quaternion_round_trip(seed):
    R = random_rotation(np.random.default_rng(seed))
    quaternion = matrix_to_quaternion(R)
    assert quaternion[0] >= 0
    assert np.allclose(quaternion_to_matrix(quaternion), R, atol=1e-12)


@given(st.floats(-7, 7))
def test_yaw_leaves_the_vertical_through_its_centre_in_place(angle):
    centre = np.array([0.15, 0.1, 0.2])
    axis = centre + np.array([[0, 0, 0], [0, 0, 0.5], [0, 0, -3.0]])
    assert np.allclose(transform_points(yaw_about(centre, angle), axis), axis, atol=1e-12)


def test_valid_transform_passes_the_check():
    T = random_transform(1)
    assert np.array_equal(check_transform(T, "T_world_camera"), T)


@pytest.mark.parametrize(
    ("transform", "message"),
    [
        (np.diag([1.0, 1.0, -1.0, 1.0]), "right-handed"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "scale or shear"),
        (np.array([[1, 0.2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]), "scale or shear"),
        (np.array([[1, 0, 0, np.nan], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]), "must be finite"),
        (np.vstack([np.eye(4)[:3], [0, 0, 0.5, 1]]), "must end with the row"),
    ],
)
def test_improper_pose_is_refused_by_name(transform, message):
    with pytest.raises(InputError, match=message) as error:
        check_transform(transform, "T_world_camera")
    assert "T_world_camera" in str(error.value)
    assert "\n" not in str(error.value)
