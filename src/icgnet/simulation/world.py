"""A world of objects on a table with a free-floating hand: one compiled MuJoCo model, exact snapshots."""

# The compiled modules of mujoco carry no types.
# pyright: reportAttributeAccessIssue=false

import re
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.geometry.transforms import make_transform, matrix_to_quaternion
from icgnet.grasping.gripper import Gripper
from icgnet.objects.base import UnusableObjectError
from icgnet.simulation.arm import ArmControl, ArmModel, add_arm
from icgnet.simulation.config import Physics
from icgnet.simulation.hand import SIDES, add_hand
from icgnet.simulation.physics import Body, add_drop_box, add_objects, new_spec
from icgnet.simulation.surroundings import ENDLESS, Surroundings

FINGER_STIFFNESS = 5000.0
"""Of fingers that are driven to an opening [N/m]."""
UNSTABLE = (mujoco.mjtWarning.mjWARN_BADQPOS, mujoco.mjtWarning.mjWARN_BADQVEL, mujoco.mjtWarning.mjWARN_BADQACC)
# The engine would write a log file into the user's folder; `World.is_unstable` tells the same.
mujoco.set_mju_user_warning(lambda _: None)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """The complete state of a world, to go back to with `World.restore`."""

    data: mujoco.MjData
    present: Bool[np.ndarray, "o"]
    has_drop_box: bool


class World:
    """Objects, table and hand in one MuJoCo model.

    Objects can be parked: then they neither move nor collide, as if they were not there. A world without gripper
    serves for settling objects.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        physics: Physics,
        gripper: Gripper | None = None,
        drop_box: bool = False,
        asleep: bool = False,
        surroundings: Surroundings = ENDLESS,
        arm: ArmModel | None = None,
    ) -> None:
        """Compiles the model.

        Args:
            bodies: the objects with their poses.
            physics: engine and material settings.
            gripper: the hand to add, if any; it waits high above the table.
            drop_box: surround the workspace with the walls of the drop box.
            surroundings: the table or bin and what stands around it.
            arm: what carries the hand; without, it floats freely.
            asleep: let the objects begin asleep: they stay exactly where they are, at no cost, until touched.

        Raises:
            UnusableObjectError: the engine cannot make a body of an object.
        """
        self.physics = physics
        spec = new_spec(physics, surroundings)
        add_objects(spec, bodies, physics, movable=True)
        if drop_box:
            add_drop_box(spec, physics)
        if gripper is not None and arm is not None:
            add_arm(spec, arm, gripper, physics)
        elif gripper is not None:
            add_hand(spec, gripper, physics)
        if asleep:
            spec.option.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
            for body in spec.worldbody.bodies:
                if body.name.startswith("object_"):
                    body.sleep = mujoco.mjtSleepPolicy.mjSLEEP_INIT
        self.model = _compile(spec, bodies)
        self.data = mujoco.MjData(self.model)
        self.present = np.ones(len(bodies), bool)
        self._object_bodies = np.array([self.model.body(f"object_{i}").id for i in range(len(bodies))], int)
        self._qpos = self.model.jnt_qposadr[self.model.body_jntadr[self._object_bodies]]
        self._dofs = self.model.body_dofadr[self._object_bodies]
        self._geoms = [np.flatnonzero(self.model.geom_bodyid == body) for body in self._object_bodies]
        self.object_of_geom = np.full(self.model.ngeom, -1)
        """Number of the object that each geom is a part of, -1 for none."""
        for index, geoms in enumerate(self._geoms):
            self.object_of_geom[geoms] = index
        fixed = ["table", *(f"structure_{i}" for i in range(len(surroundings.structures)))]
        self._fixed = np.array([self.model.geom(name).id for name in fixed], int)
        self._walls = (
            np.array([self.model.geom(f"wall_{i}").id for i in range(4)], int) if drop_box else np.zeros(0, int)
        )
        self.has_drop_box = drop_box
        self._hand = HandControl(self.model, self.data, gripper) if gripper is not None else None
        self._arm = ArmControl(self.model, self.data, arm) if gripper is not None and arm is not None else None
        for index in range(len(bodies)):
            self._set_present(index, True)
        mujoco.mj_forward(self.model, self.data)

    @property
    def hand(self) -> "HandControl":
        """The hand, in a world that was made with a gripper."""
        assert self._hand is not None, "this world has no gripper"
        return self._hand

    @property
    def arm(self) -> ArmControl:
        """The arm, in a world that was made with one."""
        assert self._arm is not None, "this world has no arm"
        return self._arm

    def step(self, count: int = 1) -> None:
        """Advances time by `count` steps."""
        mujoco.mj_step(self.model, self.data, count)

    def follow(self, positions: Float[np.ndarray, "s 3"]) -> None:
        """Moves the hand through positions [m], one a step."""
        for position in positions:
            self.hand.move_to(position)
            self.step()

    def is_unstable(self) -> bool:
        """Whether the engine has met numbers that are not finite, and started again from the first state."""
        return any(self.data.warning[kind].number > 0 for kind in UNSTABLE)

    def snapshot(self) -> Snapshot:
        """The complete state: positions, velocities, sleep, solver warm start, targets, what is parked."""
        return Snapshot(_copy(self.model, self.data), self.present.copy(), self.has_drop_box)

    def restore(self, snapshot: Snapshot) -> None:
        """Goes back to a snapshot; from there the same commands give the same motion bit for bit."""
        mujoco.mj_copyData(self.data, self.model, snapshot.data)
        for index in np.flatnonzero(self.present != snapshot.present):
            self._set_present(int(index), bool(snapshot.present[index]))
        if self.has_drop_box != snapshot.has_drop_box:
            self._set_drop_box(snapshot.has_drop_box)

    def object_poses(self) -> Float[np.ndarray, "o 4 4"]:
        """T_world_object of every object after the last step, parked ones included [m]."""
        rotations = self.data.xmat[self._object_bodies].reshape(-1, 3, 3)
        return make_transform(rotations, self.data.xpos[self._object_bodies])

    def object_quaternions(self) -> Float[np.ndarray, "o 4"]:
        """Orientation of every object, wxyz."""
        return self.data.xquat[self._object_bodies].copy()

    def object_positions(self) -> Float[np.ndarray, "o 3"]:
        """Origin of every object in the world [m]."""
        return self.data.xpos[self._object_bodies].copy()

    def centres_of_mass(self) -> Float[np.ndarray, "o 3"]:
        """Centre of mass of every object in the world [m]."""
        return self.data.xipos[self._object_bodies].copy()

    def speeds(self) -> Float[np.ndarray, "o"]:
        """Norm of each object's linear [m/s] and angular [rad/s] velocity together, zero for parked ones."""
        velocity = self.data.qvel[self._dofs[:, None] + np.arange(6)]
        return np.linalg.norm(velocity, axis=1) * self.present

    def linear_speeds(self) -> Float[np.ndarray, "o"]:
        """Speed of each object's origin [m/s], zero for parked ones."""
        return np.linalg.norm(self.data.qvel[self._dofs[:, None] + np.arange(3)], axis=1) * self.present

    def place(self, index: int, T_world_object: Float[np.ndarray, "4 4"]) -> None:
        """Puts an object at a pose [m], at rest, and makes it present."""
        address = self._qpos[index]
        self.data.qpos[address : address + 3] = T_world_object[:3, 3]
        self.data.qpos[address + 3 : address + 7] = matrix_to_quaternion(T_world_object[:3, :3])
        self.data.qvel[self._dofs[index] : self._dofs[index] + 6] = 0.0
        self._set_present(index, True)

    def park(self, index: int) -> None:
        """Takes an object out of the world."""
        self.place(index, make_transform(np.eye(3), np.array([0.0, 0.0, 10.0 + index])))
        self._set_present(index, False)

    def remove_drop_box(self) -> None:
        """Takes the walls of the drop box away."""
        self._set_drop_box(False)

    def touches_anything(self, index: int, margin: float) -> bool:
        """Whether an object is in contact with anything, or nearer to it than `margin` [m]."""
        geoms, body = self._geoms[index], self._object_bodies[index]
        self.model.geom_margin[geoms] = self.model.body_margin[body] = margin
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_collision(self.model, self.data)
        self.model.geom_margin[geoms] = self.model.body_margin[body] = 0.0
        return bool(np.isin(self.data.contact.geom, geoms).any())

    def sunk_objects(self, depth: float) -> Int[np.ndarray, "k"]:
        """The objects that were deeper than `depth` [m] inside of another one, or of anything, in the last step.

        Of two objects the one with the higher index is named.
        """
        deep = self.data.contact.geom[self.data.contact.dist < -depth]
        objects = self.object_of_geom[deep].max(axis=1, initial=-1)
        return np.unique(objects[objects >= 0])

    def is_held(self, index: int) -> bool:
        """Whether both fingers are in contact with an object."""
        pairs = self.data.contact.geom
        touching = pairs[(self.object_of_geom[pairs] == index).any(axis=1)]
        return bool((self.hand.finger_of_geom[touching].max(axis=1, initial=-1)[:, None] == [0, 1]).any(axis=0).all())

    def objects_touched_by_hand(self) -> Int[np.ndarray, "k"]:
        """The objects that any part of the hand was in contact with in the last step, in the order of the contacts."""
        pairs = self.data.contact.geom
        touched = self.object_of_geom[pairs[self.hand.is_hand[pairs].any(axis=1)]].max(axis=1, initial=-1)
        objects, first = np.unique(touched[touched >= 0], return_index=True)
        return objects[np.argsort(first)]

    def hand_touches_surroundings(self) -> bool:
        """Whether any part of the hand was in contact with the table or a structure in the last step."""
        pairs = self.data.contact.geom
        return bool((self.hand.is_hand[pairs].any(axis=1) & np.isin(pairs, self._fixed).any(axis=1)).any())

    def hand_touches_anything(self) -> bool:
        """Whether any part of the hand was in contact with an object, the table or a structure in the last step."""
        return bool(self.hand.is_hand[self.data.contact.geom].any())

    def _set_present(self, index: int, present: bool) -> None:
        body = self._object_bodies[index]
        self._set_solid(self._geoms[index], present)
        self.model.body_contype[body] = self.model.body_conaffinity[body] = int(present)
        self.model.body_gravcomp[body] = 0.0 if present else 1.0
        self.present[index] = present

    def _set_drop_box(self, present: bool) -> None:
        self._set_solid(self._walls, present)
        self.has_drop_box = present

    def _set_solid(self, geoms: np.ndarray, solid: bool) -> None:
        self.model.geom_contype[geoms] = self.model.geom_conaffinity[geoms] = int(solid)


class HandControl:
    """Addresses and commands of the hand in a world; see `icgnet.simulation.hand.add_hand`.

    A hand on an arm goes where the arm goes: only the fingers are commanded here.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, gripper: Gripper) -> None:
        self._data = data
        hand = self._body = model.body("hand").id
        floats = model.body_jntnum[hand] > 0
        self._qpos = model.jnt_qposadr[model.body_jntadr[hand]] if floats else -1
        self._dof = model.body_dofadr[hand] if floats else -1
        self._slides = np.array([model.joint(f"slide_{side}").qposadr[0] for side, _ in SIDES])
        self._slide_dofs = np.array([model.joint(f"slide_{side}").dofadr[0] for side, _ in SIDES])
        self._motors = np.array([model.actuator(f"motor_{side}").id for side, _ in SIDES])
        fingers = [model.body(f"finger_{side}").id for side, _ in SIDES]
        self.is_hand = np.isin(model.geom_bodyid, [hand, *fingers])
        self.finger_of_geom = np.full(model.ngeom, -1)
        for number, finger in enumerate(fingers):
            self.finger_of_geom[model.geom_bodyid == finger] = number

    def place(self, T_world_grasp: Float[np.ndarray, "4 4"], opening: float) -> None:
        """Puts the hand at a grasp pose [m] with this opening [m], at rest."""
        quaternion = matrix_to_quaternion(T_world_grasp[:3, :3])
        self._data.qpos[self._qpos : self._qpos + 3] = self._data.mocap_pos[0] = T_world_grasp[:3, 3]
        self._data.qpos[self._qpos + 3 : self._qpos + 7] = self._data.mocap_quat[0] = quaternion
        self._data.qpos[self._slides] = opening / 2
        self._data.qvel[self._dof : self._dof + 8] = 0.0

    def squeeze(self, force: float) -> None:
        """Lets each finger push inwards with this force [N]; negative opens."""
        self._data.ctrl[self._motors] = -force

    def set_opening(self, opening: float) -> None:
        """Puts the fingers of a hand on an arm at this opening [m], at rest."""
        self._data.qpos[self._slides] = opening / 2
        self._data.qvel[self._slide_dofs] = 0.0

    def drive(self, opening: float) -> None:
        """Lets the fingers push towards this opening [m] for the next step; their motors know no more force."""
        self._data.ctrl[self._motors] = FINGER_STIFFNESS * (opening / 2 - self._data.qpos[self._slides])

    def move_to(self, position: Float[np.ndarray, "3"]) -> None:
        """Moves the hand's target to a position [m], keeping its orientation."""
        self._data.mocap_pos[0] = position

    def position(self) -> Float[np.ndarray, "3"]:
        """Where the hand is, the origin of its grasp frame in the world [m]."""
        return self._data.xpos[self._body].copy()

    def finger_speed(self) -> float:
        """How fast the faster finger moves [m/s]."""
        return float(np.abs(self._data.qvel[self._slide_dofs]).max())

    def opening(self) -> float:
        """The distance between the pads [m]."""
        return float(self._data.qpos[self._slides].sum())


def _compile(spec: mujoco.MjSpec, bodies: Sequence[Body]) -> mujoco.MjModel:
    try:
        return spec.compile()
    except ValueError as error:
        # The engine names the mesh, which carries the number of the object; see `add_objects`.
        named = re.search(r"\b(?:mesh|object)_(\d+)", str(error))
        if named is None:
            raise
        name = bodies[int(named[1])].model.name
        raise UnusableObjectError(name, " ".join(str(error).split())) from error


def _copy(model: mujoco.MjModel, data: mujoco.MjData) -> mujoco.MjData:
    copy = mujoco.MjData(model)
    mujoco.mj_copyData(copy, model, data)
    return copy
