"""Whether what is lifted leaves its neighbours alone: it may leave what stands beside it, not lift what lies on it."""

# The compiled modules of coal carry no types.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.bodies import CollisionBody
from icgnet.arm.libraries import coal
from icgnet.arm.scene import CARRIED, Load, Meeting
from icgnet.geometry.transforms import invert_transform
from icgnet.grasping.gripper import Gripper

PRESSED = 0.005
"""What is lifted may get deeper by this into what it touches where it stands [m]: shapes are not known better."""


def pressed(
    arm: Arm,
    gripper: Gripper,
    bodies: Sequence[CollisionBody],
    holding: Load,
    line: Float[np.ndarray, "n j"],
    touching: Iterable[Meeting],
) -> tuple[Meeting, ...]:
    """What the carried object would push away on a line though it may touch it, in the order of the bodies.

    Two bodies are as deep in each other as their convex hulls have to be moved to part them.

    Args:
        arm: the arm.
        gripper: its hand.
        bodies: what stands around, in the frame of the base.
        holding: the load, with the carried object.
        line: joint positions, the first of them where the object is gripped.
        touching: what the object meets there.
    """
    names = {each.body for each in touching if each.part == CARRIED}
    near = [body for body in bodies if body.name in names]
    if holding.carried is None or holding.T_base_gripped is None or not near:
        return ()
    T_gripped_base = invert_transform(holding.T_base_gripped)
    moved = [arm.grasp_pose(joints, gripper) @ T_gripped_base for joints in line]
    found = []
    for body in near:
        depths = [_depth(holding.carried, pose, body) for pose in moved]
        if max(depths) > max(depths[0], 0.0) + PRESSED:
            found.append(Meeting(CARRIED, body.name))
    return tuple(found)


def _depth(moved: CollisionBody, pose: Float[np.ndarray, "4 4"], body: CollisionBody) -> float:
    """How far the convex hulls of two bodies have to be moved to part them [m]; negative if they are apart."""
    placed = coal.Transform3s(pose[:3, :3], pose[:3, 3])
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return -coal.distance(moved.hull, placed, body.hull, coal.Transform3s(), request, result)
