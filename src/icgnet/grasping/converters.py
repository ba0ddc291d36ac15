"""Grasps in the conventions of other software, there and back.

Ours: +z approach, +y closing, origin midway between the finger tips. In each of the others:

=================  ========  ========  ==================================================================
convention         approach  closing   origin
=================  ========  ========  ==================================================================
panda_hand link    +z        +y        0.1123 m behind the tips
VGN                +z        +y        TCP 0.0503 m behind the tips
EDGE               +z        +y        0.0723 m behind the tips
graspnetAPI        +x        +y        `depth` behind the tips, each grasp has its own
GraspGen           +z        +x        base link of the gripper
moveit_msgs/Grasp  any       any       the link that the gripper is mounted on
=================  ========  ========  ==================================================================
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from icgnet.errors import InputError
from icgnet.geometry.transforms import (
    invert_transform,
    make_transform,
    matrix_to_quaternion,
    quaternion_to_matrix,
    rotation_z,
)
from icgnet.grasping.frame import APPROACH_ANGLES, contact_frames
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper

PANDA_HAND_OFFSET = 0.1123
VGN_OFFSET = 0.0503
EDGE_OFFSET = 0.0723

GRASPNET_LENGTH = 17
GRASPNET_HEIGHT = 0.02
"""Thickness of the fingers that graspnetAPI assumes [m]."""

# Columns: the other convention's axes in our grasp frame.
_GRASPNET_AXES = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
_GRASPGEN_AXES = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

T_PANDA_HAND_LINK8 = make_transform(rotation_z(np.pi / 4), np.zeros(3))
"""Pose of panda_link8, which the Franka hand is mounted on, in panda_hand: `T_base_parent` for MoveIt."""
T_PANDA_HAND_LINK8.setflags(write=False)

Poses = Float[np.ndarray, "g 4 4"]


def to_panda_hand(poses: Poses) -> Poses:
    """Poses of the link panda_hand for poses of the grasp frame."""
    return _moved_back(poses, PANDA_HAND_OFFSET)


def from_panda_hand(poses: Poses) -> Poses:
    """Poses of the grasp frame for poses of the link panda_hand."""
    return _moved_back(poses, -PANDA_HAND_OFFSET)


def to_vgn(poses: Poses) -> Poses:
    """Poses of VGN's TCP for poses of the grasp frame."""
    return _moved_back(poses, VGN_OFFSET)


def from_vgn(poses: Poses) -> Poses:
    """Poses of the grasp frame for poses of VGN's TCP."""
    return _moved_back(poses, -VGN_OFFSET)


def to_edge(poses: Poses) -> Poses:
    """EdgeGrasp's grasp poses for poses of the grasp frame."""
    return _moved_back(poses, EDGE_OFFSET)


def from_edge(poses: Poses) -> Poses:
    """Poses of the grasp frame for EdgeGrasp's grasp poses."""
    return _moved_back(poses, -EDGE_OFFSET)


def to_graspgen(poses: Poses, gripper: Gripper) -> Poses:
    """GraspGen's poses of the gripper's base link for poses of the grasp frame."""
    return poses @ gripper.T_grasp_base @ make_transform(_GRASPGEN_AXES, np.zeros(3))


def from_graspgen(poses: Poses, gripper: Gripper) -> Poses:
    """Poses of the grasp frame for GraspGen's poses of the gripper's base link."""
    return poses @ invert_transform(gripper.T_grasp_base @ make_transform(_GRASPGEN_AXES, np.zeros(3)))


def to_graspnet(grasps: Grasps, depth: float = 0.02) -> Float[np.ndarray, "g 17"]:
    """Rows for graspnetAPI's `GraspGroup`: score, width, height, depth, rotation (9), translation (3), object id.

    Args:
        grasps: grasps in the camera frame, as graspnetAPI has them; its width is that of the open hand.
        depth: how far the tips reach past the translation [m].
    """
    rotations = grasps.poses[:, :3, :3] @ _GRASPNET_AXES
    rows = np.zeros((len(grasps), GRASPNET_LENGTH))
    rows[:, 0] = grasps.scores
    rows[:, 1] = grasps.openings
    rows[:, 2] = GRASPNET_HEIGHT
    rows[:, 3] = depth
    rows[:, 4:13] = rotations.reshape(-1, 9)
    rows[:, 13:16] = grasps.poses[:, :3, 3] - depth * rotations[:, :, 0]
    rows[:, 16] = grasps.instances
    return rows


def from_graspnet(rows: Float[np.ndarray, "..."], gripper: Gripper) -> Grasps:
    """Grasps for the rows of a graspnetAPI `GraspGroup`.

    The rows say how far the hand is open and not how wide the object is: that is taken to be what the clearance beside
    the fingers leaves, which is too much where the hand was opened further than needed.

    Args:
        rows: [g 17], one row a grasp, see `to_graspnet`.
        gripper: gives finger reach and clearance.

    Raises:
        InputError: rows of another length.
    """
    rows = np.asarray(rows, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != GRASPNET_LENGTH:
        raise InputError(f"graspnetAPI grasps must have shape (g, {GRASPNET_LENGTH}), got {rows.shape}")
    rotations = rows[:, 4:13].reshape(-1, 3, 3)
    origins = rows[:, 13:16] + rows[:, 3, None] * rotations[:, :, 0]
    poses = make_transform(rotations @ _GRASPNET_AXES.T, origins)
    openings = rows[:, 1]
    widths = np.maximum(openings - 2 * gripper.clearance, 0.0)
    return grasps_from_poses(poses, widths, openings, rows[:, 0], rows[:, 16].astype(np.int64), gripper.finger_reach)


def to_moveit(
    grasps: Grasps,
    gripper: Gripper,
    frame_id: str,
    hand_frame: str = "panda_hand",
    joint_names: Sequence[str] = ("panda_finger_joint1", "panda_finger_joint2"),
    T_base_parent: Float[np.ndarray, "4 4"] = T_PANDA_HAND_LINK8,
    approach: float = 0.05,
    lift: float = 0.10,
    up: Float[np.ndarray, "3"] | None = None,
) -> list[dict[str, Any]]:
    """Messages moveit_msgs/Grasp as plain dictionaries with the message's field names (ROS 2).

    Args:
        grasps: grasps in the frame `frame_id`.
        gripper: gives the base link and the force.
        frame_id: name of the frame of the grasps.
        hand_frame: a link whose z axis is the approach direction.
        joint_names: the finger joints; each one opens half of the width.
        T_base_parent: pose of the link that the gripper is mounted on, in the gripper's base link. MoveIt wants the
            pose of that link; the default is the Franka arm's panda_link8.
        approach: length of the approach [m].
        lift: length of the retreat, upwards [m].
        up: direction away from the table in the frame `frame_id`, `prediction.T_frame_table[:3, 2]`; its z axis if
            None.

    Raises:
        InputError: grasps in the camera frame, whose z axis points at the table, without `up`.
    """
    if up is None and frame_id == "camera":
        raise InputError("in the camera frame z points at the table: give up, prediction.T_frame_table[:3, 2]")
    away = (0.0, 0.0, 1.0) if up is None else up / np.linalg.norm(up)
    poses = grasps.poses @ gripper.T_grasp_base @ T_base_parent
    quaternions = matrix_to_quaternion(poses[:, :3, :3])
    return [
        {
            "id": f"grasp_{index}_instance_{grasps.instances[index]}",
            "pre_grasp_posture": _posture(joint_names, grasps.openings[index], None),
            "grasp_posture": _posture(joint_names, grasps.widths[index], gripper.finger_force),
            "grasp_pose": {
                "header": _header(frame_id),
                "pose": {
                    "position": _named(poses[index, :3, 3]),
                    "orientation": dict(zip("wxyz", map(float, quaternions[index]), strict=True)),
                },
            },
            "grasp_quality": float(grasps.scores[index]),
            "pre_grasp_approach": _translation(hand_frame, (0.0, 0.0, 1.0), approach),
            "post_grasp_retreat": _translation(frame_id, away, lift),
            "post_place_retreat": _translation(hand_frame, (0.0, 0.0, -1.0), approach),
            "max_contact_force": float(gripper.finger_force),
            "allowed_touch_objects": [],
        }
        for index in range(len(grasps))
    ]


def from_moveit(
    messages: Sequence[Mapping[str, Any]],
    gripper: Gripper,
    T_base_parent: Float[np.ndarray, "4 4"] = T_PANDA_HAND_LINK8,
) -> Grasps:
    """Grasps for moveit_msgs/Grasp dictionaries; their instances are numbered -1, for the message has none.

    Args:
        messages: dictionaries as `to_moveit` makes them.
        gripper: the gripper that they are for.
        T_base_parent: see `to_moveit`.
    """
    if not messages:
        return Grasps.empty()
    pose = [message["grasp_pose"]["pose"] for message in messages]
    positions = np.array([[p["position"][axis] for axis in "xyz"] for p in pose])
    quaternions = np.array([[p["orientation"][axis] for axis in "wxyz"] for p in pose])
    poses = make_transform(quaternion_to_matrix(quaternions), positions)
    poses = poses @ invert_transform(gripper.T_grasp_base @ T_base_parent)
    widths, openings = (
        np.array([sum(message[posture]["points"][0]["positions"]) for message in messages])
        for posture in ("grasp_posture", "pre_grasp_posture")
    )
    scores = np.array([message["grasp_quality"] for message in messages], dtype=np.float64)
    return grasps_from_poses(poses, widths, openings, scores, np.full(len(poses), -1), gripper.finger_reach)


def grasps_from_poses(
    poses: Poses,
    widths: Float[np.ndarray, "g"],
    openings: Float[np.ndarray, "g"],
    scores: Float[np.ndarray, "g"],
    instances: Int[np.ndarray, "g"],
    finger_reach: float,
) -> Grasps:
    """Grasps that come without contacts: the +y finger's contact and the nearest approach angle follow from the pose.

    Args:
        poses: T_frame_grasp.
        widths: distance between the finger tips when they hold the object [m].
        openings: distance between the finger tips on the way there [m].
        scores: success probabilities.
        instances: id of the instance that is grasped.
        finger_reach: how far the tips reach past the contact along the approach [m].
    """
    closing, approach = poses[:, :3, 1], poses[:, :3, 2]
    contacts = poses[:, :3, 3] + 0.5 * widths[:, None] * closing - finger_reach * approach
    in_contact_frame = np.einsum("gik,gi->gk", contact_frames(closing), approach)
    angle = np.arctan2(in_contact_frame[:, 0], in_contact_frame[:, 2])
    nearest = np.argmax(np.cos(angle[:, None] - APPROACH_ANGLES), axis=1)
    return Grasps(poses, widths, openings, scores, instances, contacts, nearest)


def _moved_back(poses: Poses, distance: float) -> Poses:
    """The poses moved against their own z axis by `distance` [m]."""
    moved = np.array(poses, dtype=np.float64)
    moved[:, :3, 3] -= distance * moved[:, :3, 2]
    return moved


def _named(vector: Float[np.ndarray, "3"] | tuple[float, float, float]) -> dict[str, float]:
    return dict(zip("xyz", map(float, vector), strict=True))


def _header(frame_id: str) -> dict[str, Any]:
    return {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": frame_id}


def _posture(joint_names: Sequence[str], opening: float, effort: float | None) -> dict[str, Any]:
    """A JointTrajectory with one point at this distance between the fingers [m], with this effort [N] if any."""
    joints = len(joint_names)
    point = {
        "positions": [float(opening) / joints] * joints,
        "velocities": [],
        "accelerations": [],
        "effort": [] if effort is None else [float(effort)] * joints,
        "time_from_start": {"sec": 1, "nanosec": 0},
    }
    return {"header": _header(""), "joint_names": list(joint_names), "points": [point]}


def _translation(
    frame_id: str, direction: Float[np.ndarray, "3"] | tuple[float, float, float], distance: float
) -> dict[str, Any]:
    """A GripperTranslation that may stop at half of its length [m]."""
    return {
        "direction": {"header": _header(frame_id), "vector": _named(direction)},
        "desired_distance": float(distance),
        "min_distance": float(distance) / 2,
    }
