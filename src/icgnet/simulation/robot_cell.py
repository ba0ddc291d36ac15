"""A workcell with a whole arm: it follows trajectories with what it carries, and what it meets is written down."""

# The compiled modules of mujoco carry no types.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import mujoco
import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.gripper import Gripper
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.arm import ArmModel
from icgnet.simulation.config import default_physics
from icgnet.simulation.hand import closing_time
from icgnet.simulation.motion import steps_in
from icgnet.simulation.physics import scene_bodies
from icgnet.simulation.scene import BACKGROUND, TABLE, Scene
from icgnet.simulation.settling import Settling
from icgnet.simulation.surroundings import Structure, block
from icgnet.simulation.trials import CLOSE_MARGIN, CLOSED_SPEED
from icgnet.simulation.world import World

TIMESTEP = 0.002
"""Of the engine with an arm [s]: its joints are stiffer than the springs that hold a floating hand."""
NO_TARGET = -1
LONGEST_OPENING = 0.3
"""Time that the fingers have at most to get to an opening, where the plan gives less [s]."""
EMPTY_OPENING = 0.002
"""Fingers that have closed to less than this hold nothing [m]: a real gripper tells how far it is open, too."""
HELD_STEPS = 5
"""Both fingers must touch the target in one of so many steps; contacts may be missing for a moment."""
HIT_FORCE, HIT_DEPTH = 1.0, 0.001
"""What the carried object touches it hits if it is pressed harder than this [N], or deeper in than this [m]."""
PARTED = 0.02
"""Once it has risen by so much [m], it must not touch what it touched where it stood, either."""
DISPLACED = 0.01
"""An object whose centre of mass has moved farther than this was displaced [m]."""
REST = 0.3
"""How long an object that was let go of falls before the arm goes back [s]."""
BOX_NAME = "drop-off box"


class PickCause(Enum):
    """How a pick ended."""

    IN_BOX = "in the box"
    MISSED = "missed"
    SLIPPED_CLOSING = "slipped on closing"
    SLIPPED_LIFTING = "slipped on lifting"
    LOST_CARRYING = "lost on the way"
    STUCK = "stuck in the hand"
    BESIDE_BOX = "fell beside the box"
    UNSTABLE = "simulation unstable"


PHASE_OF = {
    PickCause.MISSED: "close",
    PickCause.SLIPPED_CLOSING: "close",
    PickCause.SLIPPED_LIFTING: "lift",
    PickCause.LOST_CARRYING: "carry",
    PickCause.STUCK: "release",
    PickCause.BESIDE_BOX: "release",
}
"""The phase in which a pick failed."""


@dataclass(frozen=True)
class DropBox:
    """An open box beside the table, its floor as high as the table.

    Attributes:
        centre: x and y of its middle in the world [m].
        inner: length and width inside [m].
        height: of the walls [m].
        wall: thickness of walls and floor [m].
    """

    centre: tuple[float, float]
    inner: tuple[float, float] = (0.30, 0.30)
    height: float = 0.12
    wall: float = 0.01

    def structures(self) -> tuple[Structure, ...]:
        """Floor and four walls."""
        (x, y), (width, depth), wall, height = self.centre, self.inner, self.wall, self.height
        middle = TABLE_HEIGHT + height / 2

        def at(dx: float, dy: float, z: float) -> Float[np.ndarray, "4 4"]:
            return make_transform(np.eye(3), np.array([x + dx, y + dy, z]))

        floor = block(BOX_NAME, (width + 2 * wall, depth + 2 * wall, wall), at(0.0, 0.0, TABLE_HEIGHT + wall / 2))
        sides = [
            block(BOX_NAME, (wall, depth + 2 * wall, height), at(side * (width + wall) / 2, 0.0, middle))
            for side in (-1, 1)
        ]
        ends = [
            block(BOX_NAME, (width + 2 * wall, wall, height), at(0.0, side * (depth + wall) / 2, middle))
            for side in (-1, 1)
        ]
        return (floor, *sides, *ends)

    def holds(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Which points of the world [m] are over its floor and not above its walls."""
        inside = np.abs(points[:, :2] - self.centre) <= np.array(self.inner) / 2
        return inside.all(axis=1) & (points[:, 2] < TABLE_HEIGHT + self.height)


@dataclass(frozen=True, eq=False)
class Command:
    """One phase of a pick as the controllers get it.

    Attributes:
        name: of the phase.
        times: when the positions are due, from 0 [s].
        joints: positions.
        opening: that the fingers are driven to [m]; None for closing them with full force.
    """

    name: str
    times: Float[np.ndarray, "n"]
    joints: Float[np.ndarray, "n j"]
    opening: float | None


@dataclass(frozen=True)
class Carried:
    """What came of a pick; objects are indices in the cell, `TABLE` the support, `BACKGROUND` a structure or the box.

    Attributes:
        cause: how it ended.
        removed: objects that lie in the box now, and are taken out of it.
        lost: objects that left the workspace otherwise.
        touched: what arm and hand touched other than the target, before the object was let go of.
        displaced: objects other than the target that were moved.
        hit: what the carried object met on its way.
        hit_force: how hard, at most [N].
        hit_depth: how deep, at most [m].
        carried: whether the target was held when it had been lifted.
        seconds: how long it took.
        tracking: largest difference between where a joint should be and where it was.
    """

    cause: PickCause
    removed: tuple[int, ...]
    lost: tuple[int, ...]
    touched: tuple[int, ...]
    displaced: tuple[int, ...]
    hit: tuple[int, ...]
    hit_force: float
    hit_depth: float
    carried: bool
    seconds: float
    tracking: float

    @property
    def success(self) -> bool:
        """Whether the target is in the box."""
        return self.cause is PickCause.IN_BOX


class RobotCell:
    """The objects of a scene, an arm with a hand before them, and a box that it drops them into."""

    def __init__(
        self,
        scene: Scene,
        object_set: ObjectSet,
        gripper: Gripper,
        arm: ArmModel,
        box: DropBox,
        joints: Float[np.ndarray, "j"],
    ) -> None:
        """Compiles the world.

        Args:
            scene: what stands there, at rest.
            object_set: of the scene.
            gripper: the hand.
            arm: what carries it.
            box: where objects are dropped.
            joints: positions of the arm at the start.
        """
        self._scene, self._gripper, self._box = scene, gripper, box
        surroundings = replace(scene.surroundings, structures=(*scene.surroundings.structures, *box.structures()))
        physics = replace(default_physics(scene.kind), timestep=TIMESTEP)
        bodies = scene_bodies(scene, object_set)
        self._world = World(bodies, physics, gripper, asleep=True, surroundings=surroundings, arm=arm)
        self._settling = Settling(self._world, scene.surroundings)
        self._T_joint_grasp = arm.T_joint_grasp
        model, world = self._world.model, self._world
        # What a geom is: an object by its number, else TABLE, BACKGROUND, or the arm.
        self._is_arm = world.arm.is_link | world.hand.is_hand
        self._name_of_geom = world.object_of_geom.copy()
        self._name_of_geom[(world.object_of_geom < 0) & ~self._is_arm] = BACKGROUND
        self._name_of_geom[model.geom("table").id] = TABLE
        world.arm.place(joints)
        world.hand.set_opening(gripper.max_opening)
        self._opening: float | None = gripper.max_opening
        world.hand.drive(gripper.max_opening)
        mujoco.mj_forward(model, world.data)

    @property
    def remaining(self) -> Int[np.ndarray, "r"]:
        """Indices of the objects that are still there."""
        return np.flatnonzero(self._world.present)

    def scene(self) -> Scene:
        """What is there now, in the order of `remaining`, without the box."""
        poses = self._world.object_poses()
        placed = [replace(self._scene.objects[i], T_world_object=poses[i]) for i in self.remaining]
        return replace(self._scene, objects=tuple(placed))

    def joints(self) -> Float[np.ndarray, "j"]:
        """Where the joints of the arm are."""
        return self._world.arm.joints()

    def hand_pose(self) -> Float[np.ndarray, "4 4"]:
        """T_world_grasp: where the hand is [m]."""
        return self._world.arm.last_link() @ self._T_joint_grasp

    def move(self, command: Command) -> float:
        """Moves without anything in the hand; returns how long it took [s]."""
        watch = _Watch(self, NO_TARGET)
        self._run(command, watch)
        return watch.seconds

    def pick(self, commands: Sequence[Command], target: int) -> Carried:
        """Carries out the phases of a pick, one after the other.

        A hand that has closed on nothing goes back as it came, closed, and the pick is over. Should the simulation
        become unstable, the pick has failed, and everything is as it was before it.

        Args:
            commands: of the phases, among them close, lift, carry and release.
            target: the object that the grasp is for; `NO_TARGET` for none.
        """
        world, before = self._world, self.remaining
        snapshot, centres = world.snapshot(), world.centres_of_mass()
        watch = _Watch(self, target)
        for number, command in enumerate(commands):
            watch.begin(command.name)
            self._run(command, watch)
            watch.end_of(command.name)
            if command.name == "close" and world.hand.opening() < EMPTY_OPENING:
                self._go_back(commands[:number], watch)
                break
        if world.is_unstable():
            world.restore(snapshot)
            return watch.outcome(PickCause.UNSTABLE, (), (), ())
        world.step(steps_in(REST, world.physics))
        removed = [int(i) for i in self.remaining if self._box.holds(world.centres_of_mass()[i][None])[0]]
        for index in removed:
            world.park(index)
        self._settling.remove_outside()
        shifts = np.linalg.norm(world.centres_of_mass() - centres, axis=1)
        displaced = [int(i) for i in before if i != target and (shifts[i] > DISPLACED)]
        lost = set(before.tolist()) - set(self.remaining.tolist()) - set(removed)
        cause = PickCause.IN_BOX if target in removed else watch.cause
        return watch.outcome(cause, tuple(removed), tuple(sorted(lost)), tuple(displaced))

    def _run(self, command: Command, watch: "_Watch") -> None:
        """Follows one phase in time; closing goes on until the fingers stand still, opening until they are there."""
        world, hand = self._world, self._world.hand
        self._opening = command.opening
        steps = max(1, steps_in(float(command.times[-1]), world.physics))
        times = world.physics.timestep * np.arange(1, steps + 1)
        joints = np.stack([np.interp(times, command.times, column) for column in command.joints.T], axis=1)
        speeds = np.gradient(joints, world.physics.timestep, axis=0) if steps > 1 else np.zeros_like(joints)
        for position, speed in zip(joints, speeds, strict=True):
            world.arm.follow(position, speed)
            self._step(watch)
            watch.follow(position)
        if command.opening is None and command.name == "close":
            for _ in range(steps_in(closing_time(self._gripper) + CLOSE_MARGIN, world.physics)):
                self._step(watch)
                if hand.finger_speed() < CLOSED_SPEED:
                    break
        elif command.name == "release":
            for _ in range(steps_in(LONGEST_OPENING, world.physics)):
                self._step(watch)

    def _go_back(self, done: Sequence[Command], watch: "_Watch") -> None:
        """Follows phases backwards from the end of the last one, the fingers closed."""
        watch.begin("back")
        for command in reversed(done):
            times = command.times[-1] - command.times[::-1]
            self._run(Command("back", times, command.joints[::-1], None), watch)

    def _step(self, watch: "_Watch") -> None:
        hand = self._world.hand
        if self._opening is None:
            hand.squeeze(self._gripper.finger_force)
        else:
            hand.drive(self._opening)
        self._world.step()
        watch.look()


class _Watch:
    """Looks at the contacts after every step of a pick, and knows in which phase it is."""

    def __init__(self, cell: RobotCell, target: int) -> None:
        self._cell, self._world, self._target = cell, cell._world, target
        self._phase = "before"
        self._is_target = self._world.object_of_geom == target if target >= 0 else np.zeros(1, bool)
        self.touched: dict[int, None] = {}
        self.hit: dict[int, None] = {}
        self.force = self.depth = self.tracking = 0.0
        self.steps = 0
        self.cause = PickCause.MISSED
        self._was_touched = self._carried = False
        self._stood_on: set[int] = set()
        self._height = 0.0

    @property
    def seconds(self) -> float:
        """Time that has passed [s]."""
        return self.steps * self._world.physics.timestep

    def follow(self, wanted: Float[np.ndarray, "j"]) -> None:
        """Notes how far the arm is from where it should be."""
        self.tracking = max(self.tracking, float(np.abs(self._cell.joints() - wanted).max()))

    def look(self) -> None:
        """Notes the contacts of the last step."""
        self.steps += 1
        data, cell = self._world.data, self._cell
        if data.ncon == 0:
            return
        pairs = data.contact.geom
        of_arm = cell._is_arm[pairs]
        arm_alone = of_arm[:, 0] != of_arm[:, 1]
        if arm_alone.any() and self._phase != "after":
            others = np.where(of_arm[arm_alone, 0], pairs[arm_alone, 1], pairs[arm_alone, 0])
            names = cell._name_of_geom[others]
            self._was_touched |= bool((names == self._target).any())
            self.touched |= dict.fromkeys(names[names != self._target].tolist())
        if self._phase in ("lift", "carry"):
            self._look_at_carried(pairs, of_arm)

    def _look_at_carried(self, pairs: Int[np.ndarray, "c 2"], of_arm: Bool[np.ndarray, "c 2"]) -> None:
        """Notes what the carried object meets, other than the hand and, at first, what it stood at."""
        own = self._is_target[pairs]
        rows = np.flatnonzero((own[:, 0] != own[:, 1]) & ~of_arm.any(axis=1))
        if not len(rows):
            return
        data = self._world.data
        has_risen = self._phase == "carry" or self._world.centres_of_mass()[self._target, 2] - self._height > PARTED
        for row in rows.tolist():
            name = int(self._cell._name_of_geom[pairs[row, 1] if own[row, 0] else pairs[row, 0]])
            if name in self._stood_on and not has_risen:
                continue
            wrench = np.zeros(6)
            mujoco.mj_contactForce(self._world.model, data, row, wrench)
            force, depth = float(wrench[0]), -float(data.contact.dist[row])
            if force > HIT_FORCE or depth > HIT_DEPTH:
                self.hit[name] = None
                self.force, self.depth = max(self.force, force), max(self.depth, depth)

    def begin(self, phase: str) -> None:
        """From the release on, the object falls where it shall; a hand that goes back carries nothing."""
        if phase == "release":
            self._phase = "after"
        elif phase == "back":
            self._phase = phase

    def end_of(self, phase: str) -> None:
        """Asks, where it matters, whether the target is still held, and goes on to the next phase."""
        if self._target == NO_TARGET:
            return
        if phase == "close":
            self.cause = PickCause.SLIPPED_LIFTING if self._holds() else self._not_closed
            self._stood_on = self._neighbours()
            self._height = float(self._world.centres_of_mass()[self._target, 2])
            self._phase = "lift"
        elif phase == "lift":
            self._carried = self._holds()
            if self._carried:
                self.cause = PickCause.LOST_CARRYING
            self._phase = "carry" if self._carried else "after"
        elif phase in ("carry", "lower") and self._carried and self._holds():
            self.cause = PickCause.BESIDE_BOX
        elif phase == "release" and self.cause is PickCause.BESIDE_BOX and self._is_touched():
            self.cause = PickCause.STUCK

    @property
    def _not_closed(self) -> PickCause:
        return PickCause.SLIPPED_CLOSING if self._was_touched else PickCause.MISSED

    def _neighbours(self) -> set[int]:
        """What the target touches, other than the hand, where it stands."""
        pairs = self._world.data.contact.geom
        own = self._is_target[pairs]
        rows = (own[:, 0] != own[:, 1]) & ~self._cell._is_arm[pairs].any(axis=1)
        return set(self._cell._name_of_geom[np.where(own[rows, 0], pairs[rows, 1], pairs[rows, 0])].tolist())

    def _is_touched(self) -> bool:
        return self._target in self._world.objects_touched_by_hand()

    def _holds(self) -> bool:
        for _ in range(HELD_STEPS):
            if self._world.is_held(self._target):
                return True
            self._cell._step(self)
        return False

    def outcome(
        self, cause: PickCause, removed: tuple[int, ...], lost: tuple[int, ...], displaced: tuple[int, ...]
    ) -> Carried:
        """What came of it all."""
        return Carried(
            cause=cause,
            removed=removed,
            lost=lost,
            touched=tuple(self.touched),
            displaced=displaced,
            hit=tuple(self.hit),
            hit_force=self.force,
            hit_depth=self.depth,
            carried=self._carried,
            seconds=self.seconds,
            tracking=self.tracking,
        )
