"""Rigid transforms as 4 x 4 matrices. `T_a_b` maps coordinates in frame b to frame a; quaternions are wxyz."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from icgnet.errors import InputError
from icgnet.geometry.arrays import check_near, described, real_array

UNIT_TOLERANCE = 1e-2
"""Quaternions whose length differs from 1 by more than this are no rotations, or in another order."""
POSE_FORMS = (
    "a 4 x 4 matrix, its 16 numbers row by row, 7 numbers x y z [m] qw qx qy qz, or position and orientation by name "
    "as in ROS"
)
"""What a camera's pose may be, for messages."""
ROS_NAMES = (("position", "orientation"), ("translation", "rotation"))
"""Entries of geometry_msgs/Pose and geometry_msgs/Transform."""


def make_transform(
    rotation: Float[np.ndarray, "*#b 3 3"], translation: Float[np.ndarray, "*#b 3"]
) -> Float[np.ndarray, "... 4 4"]:
    """The transforms with these rotations and translations [m]; leading axes broadcast."""
    rotation, translation = np.asarray(rotation, float), np.asarray(translation, float)
    batch = np.broadcast_shapes(rotation.shape[:-2], translation.shape[:-1])
    transform = np.zeros((*batch, 4, 4))
    transform[..., :3, :3] = rotation
    transform[..., :3, 3] = translation
    transform[..., 3, 3] = 1.0
    return transform


def invert_transform(T_a_b: Float[np.ndarray, "*b 4 4"]) -> Float[np.ndarray, "*b 4 4"]:
    """`T_b_a`, by transposing the rotation."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return make_transform(R_b_a, -(R_b_a @ T_a_b[..., :3, 3:])[..., 0])


def transform_points(T_a_b: Float[np.ndarray, "4 4"], points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Points [m] of frame b in frame a."""
    return transform_vectors(T_a_b, points) + T_a_b[:3, 3]


def transform_vectors(T_a_b: Float[np.ndarray, "4 4"], vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Directions of frame b in frame a (rotated, not shifted)."""
    # This side of the product is several times faster than `vectors @ R.T` with its many short rows.
    flat = (T_a_b[:3, :3] @ vectors.reshape(-1, 3).T).T
    return np.ascontiguousarray(flat).reshape(vectors.shape)


def rotation_z(angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation about +z by `angle` [rad]."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def yaw_about(centre: Float[np.ndarray, "3"], angle: float) -> Float[np.ndarray, "4 4"]:
    """The transform that turns space by `angle` [rad] about the vertical through `centre` [m]."""
    rotation = rotation_z(angle)
    return make_transform(rotation, centre - rotation @ centre)


def quaternion_to_matrix(quaternion: Float[np.ndarray, "*b 4"]) -> Float[np.ndarray, "*b 3 3"]:
    """Rotation matrices of wxyz quaternions (normalised on the way)."""
    quaternion = np.asarray(quaternion, float)
    flat = Rotation.from_quat(quaternion.reshape(-1, 4)[:, [1, 2, 3, 0]]).as_matrix()
    return flat.reshape(*quaternion.shape[:-1], 3, 3)


def matrix_to_quaternion(rotation: Float[np.ndarray, "*b 3 3"]) -> Float[np.ndarray, "*b 4"]:
    """Quaternions (wxyz) of rotation matrices, with w >= 0."""
    rotation = np.asarray(rotation, float)
    flat = Rotation.from_matrix(rotation.reshape(-1, 3, 3)).as_quat(canonical=True)
    return flat[:, [3, 0, 1, 2]].reshape(*rotation.shape[:-2], 4)


def random_rotation(rng: np.random.Generator) -> Float[np.ndarray, "3 3"]:
    """A rotation drawn uniformly from SO(3)."""
    quaternion = rng.normal(size=4)
    return quaternion_to_matrix(quaternion / np.linalg.norm(quaternion))


def check_transform(transform: Any, name: str) -> Float[np.ndarray, "4 4"]:
    """The transform as float64, after making sure that it is rigid and right-handed.

    Args:
        transform: 4 x 4 homogeneous matrix, translation in [m].
        name: how the caller calls it, for the message.

    Raises:
        InputError: no numbers, wrong shape, non-finite entries, a bottom row other than (0, 0, 0, 1), or a rotation
            part that is scaled, sheared or left-handed.
    """
    T = real_array(transform, name, (4, 4))
    if not np.allclose(T[3], [0, 0, 0, 1], atol=1e-6):
        raise InputError(f"{name} must end with the row (0, 0, 0, 1), got {T[3].tolist()}")
    R = T[:3, :3]
    with np.errstate(over="ignore", invalid="ignore"):
        error = np.abs(R.T @ R - np.eye(3)).max()
    if not error <= 1e-3:
        raise InputError(
            f"{name} must have an orthonormal rotation, but R^T R differs from 1 by {error:.3g} (scale or shear)"
        )
    if np.linalg.det(R) < 0:
        raise InputError(f"{name} must be right-handed, but its rotation has determinant {np.linalg.det(R):.3f}")
    return T


def check_pose(pose: Any, name: str) -> Float[np.ndarray, "4 4"]:
    """A pose as a 4 x 4 matrix.

    Args:
        pose: 4 x 4 matrix, its 16 numbers row by row, the seven numbers x y z [m] qw qx qy qz of a position and a unit
            quaternion, or a mapping as ROS writes it: `position` and `orientation`, or `translation` and `rotation`,
            each with its numbers under x, y, z (and w).
        name: how the caller calls it, for the message.

    Raises:
        InputError: none of these, see `check_transform`, a quaternion that is not of length 1, or a translation that
            looks like millimetres.
    """
    if isinstance(pose, Mapping):
        pose = _seven_numbers(pose, name)
    shape = np.shape(_or_nothing(pose))
    if shape in ((16,), (1, 16)):
        pose = np.reshape(pose, (4, 4))
    elif shape in ((1, 7), (7, 1)):  # as text files hold them
        pose = np.reshape(pose, 7)
    elif len(shape) != 2 and shape != (7,):
        raise InputError(f"{name} must be {POSE_FORMS}, got {described(pose)}")
    if np.shape(pose) == (7,):
        numbers = real_array(pose, name, (7,))
        length = float(np.linalg.norm(numbers[3:]))
        if not abs(length - 1.0) <= UNIT_TOLERANCE:
            raise InputError(f"{name} must have a quaternion qw qx qy qz of length 1, got length {length:.3g}")
        T = make_transform(quaternion_to_matrix(numbers[3:]), numbers[:3])
    else:
        T = check_transform(pose, name)
    check_near(T[:3, 3], name)
    return T


def _seven_numbers(pose: Mapping[Any, Any], name: str) -> list[Any]:
    """Position [m] and quaternion wxyz of a mapping that has them by name, as seven numbers."""
    for position, orientation in ROS_NAMES:
        if position in pose and orientation in pose:
            parts = (pose[position], "xyz"), (pose[orientation], "wxyz")
            if all(isinstance(part, Mapping) and set(part) == set(axes) for part, axes in parts):
                return [part[axis] for part, axes in parts for axis in axes]
            raise InputError(
                f"{name} must have {position} with x, y, z [m] and {orientation} with x, y, z, w, got {described(pose)}"
            )
    raise InputError(f"{name} must be {POSE_FORMS}, got {described(pose)}")


def _or_nothing(value: Any) -> Any:
    """The value if its shape can be told, else nothing."""
    try:
        return np.asanyarray(value)
    except Exception:  # whoever converts it next says what is wrong with it
        return ()
