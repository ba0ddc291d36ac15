"""A table of objects and a hand that executes grasps one after the other, by the rules of a benchmark protocol."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform, make_transform, transform_points
from icgnet.grasping.gripper import Gripper
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.approach import APPROACH_LENGTH
from icgnet.simulation.config import Physics, default_physics
from icgnet.simulation.motion import line_at_constant_speed, steps_in
from icgnet.simulation.physics import Body, scene_bodies
from icgnet.simulation.scene import TABLE, Scene
from icgnet.simulation.settling import Settling
from icgnet.simulation.trials import LIFT, retreat_vector
from icgnet.simulation.world import World

AWAY = np.array([0.0, 0.0, 2.0])  # where the hand waits [m]


class Cause(Enum):
    """How an attempt ended."""

    HELD = "held"
    TOUCHED = "touched on approach"
    TOO_WIDE = "too wide"
    MISSED = "missed"
    SLIPPED_CLOSING = "slipped on closing"
    SLIPPED_LIFTING = "slipped on lifting"
    WRONG_OBJECT = "wrong object"
    TWO_OBJECTS = "two objects"
    UNSTABLE = "simulation unstable"


@dataclass(frozen=True)
class Protocol:
    """When an attempt counts as a success.

    Attributes:
        name: of the protocol.
        free_approach: fail when the hand touches anything but the target before it closes.
        named_object: in the end both fingers must hold the target, its centre of mass must have risen by 80 % of
            `rise`, and that of no other object, whether the hand touches it or it is carried along; otherwise touching
            anything will do.
        min_opening: a hand that is closed further than this holds nothing [m].
        rise: after the retreat, which may be oblique, the hand goes on straight up until it has risen by this in all
            [m]; 0 for the retreat alone.
        keep_time: how long to hold after the lift [s].
    """

    name: str
    free_approach: bool
    named_object: bool
    min_opening: float
    rise: float
    keep_time: float


PROTOCOLS = {
    "edge": Protocol("edge", free_approach=False, named_object=False, min_opening=0.008, rise=0.0, keep_time=0.0),
    "strict": Protocol("strict", free_approach=True, named_object=True, min_opening=0.004, rise=0.10, keep_time=1.0),
}
"""`edge`: the published rules, in which the hand may push its way through. `strict`: what a robot would want."""

APPROACH_TIME, CLOSE_TIME, LIFT_TIME = 0.31, 0.5, 0.61  # of the published benchmark [s]
LIFTED_SHARE = 0.8  # of the hand's rise that an object must share to be lifted
BLOCK = 5  # steps between two looks at the contacts while closing
NOT_HELD = (Cause.MISSED, Cause.SLIPPED_CLOSING, Cause.SLIPPED_LIFTING)  # too wide an object would explain them
HELD_STEPS = 5  # both fingers must touch the target in one of so many steps
LINE_REACH, LINE_SAMPLES = 0.08, 161  # how far and how finely the width of the target is measured [m]


@dataclass(frozen=True, eq=False)
class Execution:
    """What came of one grasp; objects are indices in the workcell, `TABLE` is the table or a structure.

    Attributes:
        success: by the protocol's rules.
        cause: how it ended.
        target: the object that the grasp was for: the nearest one to the middle between the pads.
        held: what the hand touched at the end; where the protocol names the object, what came up with the hand.
        touched: what the hand touched before it closed.
        removed: objects that were taken away, as grasped.
        lost: objects that left the workspace because of the attempt.
        opening: of the hand at the end [m].
        T_world_target: pose of the target before the attempt [m].
    """

    success: bool
    cause: Cause
    target: int
    held: tuple[int, ...]
    touched: tuple[int, ...]
    removed: tuple[int, ...]
    lost: tuple[int, ...]
    opening: float
    T_world_target: Float[np.ndarray, "4 4"]


class Workcell:
    """The objects of a scene, and a hand that grasps them away one after the other."""

    def __init__(self, scene: Scene, object_set: ObjectSet, gripper: Gripper, physics: Physics | None = None) -> None:
        """Compiles the world; the objects are at rest, as the scene says."""
        self._scene, self._gripper = scene, gripper
        bodies = scene_bodies(scene, object_set)
        self._world = World(bodies, physics or default_physics(scene.kind), gripper, surroundings=scene.surroundings)
        self._settling = Settling(self._world, scene.surroundings)
        self._planes = [_planes(body) for body in bodies]
        self.grasped: list[int] = []
        """Objects that were taken away, as grasped."""

    @property
    def remaining(self) -> Int[np.ndarray, "r"]:
        """Indices of the objects that are still on the table."""
        return np.flatnonzero(self._world.present)

    def scene(self) -> Scene:
        """What is on the table now, in the order of `remaining`."""
        poses = self._world.object_poses()
        placed = [replace(self._scene.objects[i], T_world_object=poses[i]) for i in self.remaining]
        return replace(self._scene, objects=tuple(placed))

    def execute(
        self, T_world_grasp: Float[np.ndarray, "4 4"], opening: float, protocol: Protocol, wanted: int | None = None
    ) -> Execution:
        """Carries out one grasp: approach over 5 cm, close, retreat over 10 cm. What was grasped is taken away.

        Should the simulation become unstable, the attempt has failed, and everything is as it was before it.

        Args:
            T_world_grasp: the grasp [m].
            opening: of the hand while it approaches [m].
            protocol: the rules.
            wanted: index of the object that the grasp is for; the nearest one to the middle between the pads if None.

        Raises:
            InputError: the table is empty, or the opening is not one of this hand.
        """
        if not 0.0 < opening <= self._gripper.max_opening:
            raise InputError(f"opening must be in (0, {self._gripper.max_opening}] m, got {opening}")
        if len(self.remaining) == 0:
            raise InputError("there is nothing left to grasp in this workcell")
        before, snapshot = self.remaining, self._world.snapshot()
        middle = T_world_grasp[:3, 3] - self._gripper.finger_reach * T_world_grasp[:3, 2]
        target = self._nearest(middle) if wanted is None else wanted
        pose, width = self._world.object_poses()[target], self._width(target, middle, T_world_grasp[:3, 1])
        touched = self._approach(T_world_grasp, opening)
        if protocol.free_approach and set(touched) - {target}:
            cause, held = Cause.TOUCHED, ()
        else:
            cause, held = self._close_and_lift(T_world_grasp, target, protocol)
        if cause in NOT_HELD and width > opening:
            cause = Cause.TOO_WIDE
        final_opening = self._world.hand.opening()
        removed = held[:1] if cause is Cause.HELD else ()
        for index in removed:
            self._world.park(index)
        self._clear()
        if self._world.is_unstable():
            self._world.restore(snapshot)
            return Execution(False, Cause.UNSTABLE, target, (), touched, (), (), final_opening, pose)
        self.grasped += removed
        left = set(before.tolist()) - set(self.remaining.tolist()) - set(removed)
        return Execution(
            cause is Cause.HELD, cause, target, held, touched, removed, tuple(sorted(left)), final_opening, pose
        )

    def _approach(self, T_world_grasp: Float[np.ndarray, "4 4"], opening: float) -> tuple[int, ...]:
        """Brings the open hand from 5 cm behind to the grasp; returns what it touched."""
        world, hand = self._world, self._world.hand
        way = APPROACH_LENGTH * T_world_grasp[:3, 2]
        start = T_world_grasp[:3, 3] - way
        hand.place(make_transform(T_world_grasp[:3, :3], start), opening)
        hand.squeeze(0.0)
        touched: dict[int, None] = {}
        for position in line_at_constant_speed(start, way, APPROACH_TIME, world.physics):
            hand.move_to(position)
            world.step()
            touched |= dict.fromkeys(self._touched())
        return tuple(touched)

    def _close_and_lift(
        self, T_world_grasp: Float[np.ndarray, "4 4"], target: int, protocol: Protocol
    ) -> tuple[Cause, tuple[int, ...]]:
        """Closes the hand where it is and retreats; returns how that ended, and the objects that are held then."""
        world, hand = self._world, self._world.hand
        heights = world.centres_of_mass()[:, 2]
        hand.squeeze(self._gripper.finger_force)
        was_touched = False
        for _ in range(steps_in(CLOSE_TIME, world.physics) // BLOCK):
            world.step(BLOCK)
            was_touched |= target in world.objects_touched_by_hand()
        was_held = self._holds(target)
        self._lift(T_world_grasp, protocol)
        held = tuple(world.objects_touched_by_hand().tolist()) if hand.opening() > protocol.min_opening else ()
        if protocol.named_object:
            risen = world.present & (world.centres_of_mass()[:, 2] - heights > LIFTED_SHARE * protocol.rise)
            held = self._lifted(held, risen, target)
        if held:
            return _judge_held(held, target, protocol), held
        if was_held:
            return Cause.SLIPPED_LIFTING, ()
        return Cause.SLIPPED_CLOSING if was_touched else Cause.MISSED, ()

    def _lift(self, T_world_grasp: Float[np.ndarray, "4 4"], protocol: Protocol) -> None:
        """Retreats, goes on straight up as far as the protocol asks for, and keeps still."""
        world, start, retreat = self._world, T_world_grasp[:3, 3], retreat_vector(T_world_grasp)
        rest = max(protocol.rise - float(retreat[2]), 0.0)
        up = np.array([0.0, 0.0, rest])
        ways = [
            line_at_constant_speed(start, retreat, LIFT_TIME, world.physics),
            line_at_constant_speed(start + retreat, up, LIFT_TIME * rest / LIFT, world.physics),
        ]
        world.follow(np.concatenate(ways))
        world.step(steps_in(protocol.keep_time, world.physics))

    def _lifted(self, touched: tuple[int, ...], risen: Bool[np.ndarray, "o"], target: int) -> tuple[int, ...]:
        """What came up with the hand: what it holds, then what that carries; nothing if the hand holds nothing.

        The target counts as held only by both fingers.
        """
        held = [index for index in touched if risen[index] and (index != target or self._holds(target))]
        carried = [index for index in np.flatnonzero(risen).tolist() if index not in held]
        return (*held, *carried) if held else ()

    def _holds(self, index: int) -> bool:
        """Whether both fingers touch an object in one of the next steps; contacts may be missing for a moment."""
        for _ in range(HELD_STEPS):
            if self._world.is_held(index):
                return True
            self._world.step()
        return False

    def _touched(self) -> list[int]:
        """What the hand touches now."""
        objects = self._world.objects_touched_by_hand().tolist()
        return [*objects, TABLE] if self._world.hand_touches_surroundings() else objects

    def _clear(self) -> None:
        """Takes the hand away, waits for rest, and removes what has left the workspace."""
        hand = self._world.hand
        hand.place(make_transform(np.eye(3), AWAY), self._gripper.max_opening)
        hand.squeeze(0.0)
        self._settling.remove_outside()

    def _nearest(self, point: Float[np.ndarray, "3"]) -> int:
        """The object whose surface is nearest to a point [m], or that contains it."""
        distances = [self._distances(index, point[None])[0] for index in self.remaining.tolist()]
        return int(self.remaining[int(np.argmin(distances))])

    def _width(self, index: int, point: Float[np.ndarray, "3"], direction: Float[np.ndarray, "3"]) -> float:
        """How much of a line [m] through a point, along a direction, lies between an object's outermost surfaces."""
        offsets = np.linspace(-LINE_REACH, LINE_REACH, LINE_SAMPLES)
        inside = offsets[self._distances(index, point + offsets[:, None] * direction) < 0.0]
        return float(np.ptp(inside)) if len(inside) else 0.0

    def _distances(self, index: int, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Signed distances [m] of world points from what the hand touches of an object; too small around its edges."""
        local = transform_points(invert_transform(self._world.object_poses()[index]), points)
        distances = np.full(len(points), np.inf)
        for normals, offsets in self._planes[index]:
            np.minimum(distances, (local @ normals.T - offsets).max(axis=1), out=distances)
        return distances


def _planes(body: Body) -> list[tuple[Float[np.ndarray, "f 3"], Float[np.ndarray, "f"]]]:
    """The sides of an object's convex parts, in its own frame: normals n and offsets d [m] with n x = d on them."""
    planes = []
    for part in body.model.parts:
        normals, offsets = part.face_normals, np.einsum("fk,fk->f", part.face_normals, part.triangles[:, 0])
        if body.stretch != (1.0, 1.0, 1.0):
            normals = normals / np.array(body.stretch)
            length = np.linalg.norm(normals, axis=1)
            proper = length > 0.0  # a face without area has no normal
            normals, offsets = normals[proper] / length[proper, None], offsets[proper] / length[proper]
        planes.append((normals, offsets * body.scale))
    return planes


def _judge_held(held: tuple[int, ...], target: int, protocol: Protocol) -> Cause:
    if not protocol.named_object or held == (target,):
        return Cause.HELD
    return Cause.TWO_OBJECTS if target in held else Cause.WRONG_OBJECT
