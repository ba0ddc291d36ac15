"""The motion of a plan: where the arm, its hand, what it carries and everything else are at each moment."""

from collections.abc import Sequence

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int

from icgnet.arm.arm import Arm
from icgnet.arm.bodies import BACKGROUND, SUPPORT
from icgnet.arm.motion import Kind, Motion, MovingPart
from icgnet.arm.plan import PickPlan
from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform, make_transform
from icgnet.grasping.gripper import Box
from icgnet.inference.prediction import NO_INSTANCE

FRAME_TIME = 0.04
"""Time between two moments of a film [s]."""
ALWAYS = np.array([True])
KINDS: dict[str, Kind] = {SUPPORT: "support", BACKGROUND: "background"}
"""What bodies are that are no objects."""


def motion_of(plan: PickPlan, arm: Arm, times: Float[np.ndarray, "n"] | None = None) -> Motion:
    """The motion of a plan, in the world.

    The object moves with the hand from when it is gripped until it is let go of, also if its shape was left out of
    account; then it stands where it was placed, or is gone where it was dropped: how it falls is not planned.

    Args:
        plan: with phases.
        arm: the arm that it is for.
        times: moments [s]; every `FRAME_TIME` if None.

    Raises:
        InputError: a plan without phases, or for another arm.
    """
    if not plan.is_found or plan.joint_names != arm.joint_names:
        raise InputError(f"a motion needs a plan with phases for the arm {arm.name}, got one for {plan.arm}")
    whole, ends = plan.joint_trajectory(), np.cumsum([phase.trajectory.duration for phase in plan.phases])
    if times is None:
        times = np.append(np.arange(0.0, whole.duration, FRAME_TIME), whole.duration)
    joints = whole.at(times)
    phases = np.minimum(np.searchsorted(ends, times), len(ends) - 1)
    T_world_base = arm.description.T_world_base
    T_world_grasp = T_world_base @ np.stack([arm.grasp_pose(each, plan.gripper) for each in joints])
    parts = []
    for body in plan.bodies:
        poses, shown = T_world_base[None], ALWAYS
        if body.instance == plan.instance:
            poses, shown = _carried(plan, arm, T_world_grasp, phases)
        parts.append(MovingPart(body.name, KINDS.get(body.name, "object"), body.instance, body.mesh, poses, shown))
    links = T_world_base @ np.stack([arm.link_poses(each) for each in joints], axis=1)
    for shape, poses in zip(arm.link_shapes, links, strict=True):
        parts.append(MovingPart(shape.link, "arm", NO_INSTANCE, shape.mesh, poses, ALWAYS))
    return Motion(
        title=f"object {plan.instance}",
        times=times,
        parts=(*parts, *_hand(plan, T_world_grasp, _openings(plan, times, phases))),
        phase_ends=ends,
        captions=tuple(phase.caption for phase in plan.phases),
    )


def _carried(
    plan: PickPlan, arm: Arm, T_world_grasp: Float[np.ndarray, "n 4 4"], phases: Int[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n 4 4"], Bool[np.ndarray, "m"]]:
    """Where the object is that is picked, and whether it is there."""
    assert plan.T_base_grasp is not None
    names, T_world_base = [phase.name for phase in plan.phases], arm.description.T_world_base
    T_grasp_base = invert_transform(plan.T_base_grasp)
    poses = T_world_grasp @ T_grasp_base
    poses[phases <= names.index("close")] = T_world_base
    is_left = phases > names.index("release")
    if "lower" not in names:
        return poses, ~is_left
    released = plan.phases[names.index("release")].trajectory.positions[0]
    poses[is_left] = T_world_base @ arm.grasp_pose(released, plan.gripper) @ T_grasp_base
    return poses, ALWAYS


def _openings(plan: PickPlan, times: Float[np.ndarray, "n"], phases: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Distance between the finger tips at each moment [m]: it changes evenly while the fingers move."""
    ends = np.array([phase.opening for phase in plan.phases])
    durations = np.array([phase.trajectory.duration for phase in plan.phases])
    starts = np.concatenate([ends[:1], ends[:-1]])
    share = np.clip((times - (np.cumsum(durations) - durations)[phases]) / durations[phases], 0.0, 1.0)
    share = np.where([plan.phases[index].moves_fingers for index in phases], share, 1.0)
    return starts[phases] + share * (ends - starts)[phases]


def _hand(
    plan: PickPlan, T_world_grasp: Float[np.ndarray, "n 4 4"], openings: Float[np.ndarray, "n"]
) -> list[MovingPart]:
    """The palm, if there is one, and both fingers."""
    gripper, sideways = plan.gripper, np.zeros((len(openings), 3))
    sideways[:, 1] = openings / 2
    left, right = make_transform(np.eye(3), sideways), make_transform(np.eye(3), -sideways)
    other = tuple(box.mirrored() for box in gripper.finger)
    given = (("palm", gripper.palm, np.eye(4)), ("left finger", gripper.finger, left), ("right finger", other, right))
    return [
        MovingPart(name, "hand", NO_INSTANCE, _mesh(boxes), T_world_grasp @ moved, ALWAYS)
        for name, boxes, moved in given
        if boxes
    ]


def _mesh(boxes: Sequence[Box]) -> trimesh.Trimesh:
    meshes = [trimesh.creation.box(each.size).apply_translation(each.centre) for each in boxes]
    return trimesh.Trimesh(
        *trimesh.util.append_faces([each.vertices for each in meshes], [each.faces for each in meshes]), process=False
    )
