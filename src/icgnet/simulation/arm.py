"""An arm in MuJoCo: a chain of links with position-controlled joints that carries the hand."""

# The compiled modules of mujoco carry no types.
# pyright: reportAttributeAccessIssue=false

from dataclasses import dataclass

import mujoco
import numpy as np
import trimesh
from jaxtyping import Float

from icgnet.geometry.transforms import make_transform, matrix_to_quaternion
from icgnet.grasping.gripper import Gripper
from icgnet.simulation.config import Physics
from icgnet.simulation.hand import SIDES, couple_fingers, fill_hand
from icgnet.simulation.physics import contact_settings

LINK_DENSITY = 1000.0
"""Of the links [kg/m^3], which URDFs may leave out; so the hulls of the FR3 weigh 17 kg, which is its weight."""
ARMATURE = 0.1
"""Inertia of motor and gear as the joint feels it [kg m^2]."""
STIFFNESS = 50.0
"""Of the position control of a joint, per unit of its largest effort [1/rad]: 4350 and 600 N m/rad for the FR3."""
DAMPING_TIME = 0.1
"""Damping of that control, per unit of its stiffness [s]."""


@dataclass(frozen=True, eq=False)
class ArmModel:
    """What the engine needs to know of an arm, in metres and radians.

    Attributes:
        T_world_base: where it stands.
        frames: where each joint sits in the frame of the one before it, at position 0.
        motions: the axis that a joint slides along (first three numbers) or turns about (last three), in its frame.
        ranges: least and largest position of each joint.
        efforts: largest effort of each joint [N m].
        parts: convex shapes, each with the number of the joint that moves it, 0 for none, in the frame of that joint.
        T_joint_grasp: the grasp frame of the hand in the frame of the last joint.
    """

    T_world_base: Float[np.ndarray, "4 4"]
    frames: Float[np.ndarray, "j 4 4"]
    motions: Float[np.ndarray, "j 6"]
    ranges: Float[np.ndarray, "j 2"]
    efforts: Float[np.ndarray, "j"]
    parts: tuple[tuple[int, trimesh.Trimesh], ...]
    T_joint_grasp: Float[np.ndarray, "4 4"]


def add_arm(spec: mujoco.MjSpec, arm: ArmModel, gripper: Gripper, physics: Physics) -> None:
    """Adds an arm with its hand; gravity is compensated, as controllers of arms do.

    Bodies: link_0 (the base), link_1, ..., then those of the hand. Joints joint_1, ... have position-controlled
    actuators of the same names. Links meet objects and surroundings, but not each other nor the hand: plans are checked
    for that.
    """
    body = spec.worldbody.add_body(name="link_0", **_placed(arm.T_world_base))
    _add_parts(spec, body, 0, arm, physics)
    for number, (frame, motion) in enumerate(zip(arm.frames, arm.motions, strict=True), start=1):
        body = body.add_body(name=f"link_{number}", gravcomp=1.0, **_placed(frame))
        slides = bool(np.abs(motion[:3]).any())
        body.add_joint(
            name=f"joint_{number}",
            type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=motion[:3] if slides else motion[3:],
            # The engine's models are written in degrees.
            range=arm.ranges[number - 1] if slides else np.rad2deg(arm.ranges[number - 1]),
            limited=True,
            armature=ARMATURE,
        )
        _add_parts(spec, body, number, arm, physics)
        effort = float(arm.efforts[number - 1])
        stiffness = STIFFNESS * effort
        control = spec.add_actuator(
            name=f"joint_{number}",
            target=f"joint_{number}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            biastype=mujoco.mjtBias.mjBIAS_AFFINE,
            forcerange=[-effort, effort],
            forcelimited=True,
        )
        control.gainprm[0] = stiffness
        control.biasprm[:3] = [0.0, -stiffness, -DAMPING_TIME * stiffness]
    hand = body.add_body(name="hand", gravcomp=1.0, **_placed(arm.T_joint_grasp))
    fill_hand(spec, hand, gripper, physics)
    couple_fingers(spec, physics)
    for part in ("hand", *(f"finger_{side}" for side, _ in SIDES)):
        for number in range(len(arm.frames) + 1):
            spec.add_exclude(bodyname1=part, bodyname2=f"link_{number}")


def _add_parts(spec: mujoco.MjSpec, body: "mujoco.MjsBody", number: int, arm: ArmModel, physics: Physics) -> None:
    own = [mesh for joint, mesh in arm.parts if joint == number]
    for index, surface in enumerate(own):
        mesh = spec.add_mesh(name=f"link_mesh_{number}_{index}")
        mesh.uservert, mesh.userface = surface.vertices.ravel(), surface.faces.ravel()
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=mesh.name,
            density=LINK_DENSITY,
            contype=1,
            conaffinity=0,
            **contact_settings(physics, physics.object_friction),
        )
    if number and not own:  # a joint that moves nothing needs some mass
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.01, 0, 0], mass=0.1, contype=0, conaffinity=0)


def _placed(pose: Float[np.ndarray, "4 4"]) -> dict[str, object]:
    return {"pos": pose[:3, 3], "quat": matrix_to_quaternion(pose[:3, :3])}


class ArmControl:
    """Addresses and commands of the arm in a world that `add_arm` made."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, arm: ArmModel) -> None:
        self._data = data
        names = [f"joint_{number}" for number in range(1, len(arm.frames) + 1)]
        self._qpos = np.array([model.joint(name).qposadr[0] for name in names])
        self._dofs = np.array([model.joint(name).dofadr[0] for name in names])
        self._controls = np.array([model.actuator(name).id for name in names])
        self._last = model.body(f"link_{len(names)}").id
        links = [model.body(f"link_{number}").id for number in range(len(names) + 1)]
        self.is_link = np.isin(model.geom_bodyid, links)
        """Which geoms are links of the arm."""

    def place(self, joints: Float[np.ndarray, "j"]) -> None:
        """Puts the arm at these joint positions, at rest."""
        self._data.qpos[self._qpos] = self._data.ctrl[self._controls] = joints
        self._data.qvel[self._dofs] = 0.0

    def follow(self, joints: Float[np.ndarray, "j"], speeds: Float[np.ndarray, "j"]) -> None:
        """Tells the joints where to be and how fast to move."""
        # The damping acts on the difference to the wanted speed.
        self._data.ctrl[self._controls] = joints + DAMPING_TIME * speeds

    def joints(self) -> Float[np.ndarray, "j"]:
        """Where the joints are."""
        return self._data.qpos[self._qpos].copy()

    def last_link(self) -> Float[np.ndarray, "4 4"]:
        """T_world_joint of the last joint [m], with what it moves."""
        return make_transform(self._data.xmat[self._last].reshape(3, 3), self._data.xpos[self._last].copy())
