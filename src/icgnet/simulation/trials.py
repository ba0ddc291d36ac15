"""Grasp labels by simulated trials ("strict"): free approach, close, lift, and the named object must be held."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from icgnet.errors import InputError
from icgnet.grasping.frame import APPROACH_ANGLES, grasp_poses
from icgnet.grasping.gripper import Gripper
from icgnet.simulation.approach import ApproachChecker
from icgnet.simulation.contacts import Contacts
from icgnet.simulation.physics import Body, Physics
from icgnet.simulation.world import World

ANGLES = len(APPROACH_ANGLES)
MIN_OPENING = 0.004  # a hand closed further than this holds nothing [m]
SIDE_GRASP = np.pi / 3  # beyond this angle from straight down, the hand retreats upwards [rad]
DISTURBED_SHIFT = 0.05  # a neighbour that moved this far was disturbed [m]
DISTURBED_TURN = 0.1  # ... or whose quaternion changed by this norm
LIFT = 0.10  # length of the retreat [m]
CLOSE_TIMEOUT, LIFT_TIME, SETTLE_TIME = 0.6, 0.3, 0.08  # [s]
CLOSED_SPEED = 0.002  # fingers slower than this have closed [m/s]


@dataclass(frozen=True)
class Jitter:
    """What a grasp must survive, drawn anew for every trial.

    Attributes:
        contact: standard deviation of the contact position along each axis [m].
        normal: standard deviation of the normal about each tangent [rad].
    """

    contact: float = 0.0015
    normal: float = float(np.deg2rad(4.0))

    def __post_init__(self) -> None:
        if self.contact < 0.0 or self.normal < 0.0:
            raise InputError(f"jitter must not be negative, got contact {self.contact} m, normal {self.normal} rad")


@dataclass(frozen=True)
class Labels:
    """Outcomes of the trials at n contacts and all approach angles.

    Attributes:
        success: the object was held by both fingers after the lift.
        collided: the open hand touched something on its way, or no opening fits over the object there.
        disturbed: another object was moved or turned by the trial.
        widths: [n] distance between the fingers that was tried [m]; where no exit of the object fits the hand, the
            first one; 0 where the mesh has none.
    """

    success: Bool[np.ndarray, "n a"]
    collided: Bool[np.ndarray, "n a"]
    disturbed: Bool[np.ndarray, "n a"]
    widths: Float[np.ndarray, "n"]

    @staticmethod
    def concatenate(parts: Sequence["Labels"]) -> "Labels":
        """The labels of several sets of contacts, one after the other."""
        return Labels(
            np.concatenate([part.success for part in parts]),
            np.concatenate([part.collided for part in parts]),
            np.concatenate([part.disturbed for part in parts]),
            np.concatenate([part.widths for part in parts]),
        )


@dataclass(frozen=True)
class Outcome:
    """Of one trial."""

    success: bool
    disturbed: bool


class Trials:
    """Grasp trials in one scene: every trial starts from the same state."""

    def __init__(self, bodies: Sequence[Body], gripper: Gripper, physics: Physics) -> None:
        """Compiles the worlds for the approach check and for the physics.

        Args:
            bodies: the objects, at rest.
            gripper: the hand.
            physics: engine and material settings.
        """
        self.gripper = gripper
        self.checker = ApproachChecker(bodies, gripper, physics, hands=ANGLES)
        self.world = World(bodies, physics, gripper, asleep=True)
        self._start = self.world.snapshot()
        self._start_positions = self.world.object_positions()
        self._start_quaternions = self.world.object_quaternions()

    def label(self, contacts: Contacts, rng: np.random.Generator, jitter: Jitter) -> Labels:
        """Tries every contact at every approach angle.

        Where the object is hollow, every width that fits is tried, and the one that succeeds at most angles is kept.

        Args:
            contacts: where to grasp; needs at least one.
            rng: source of the jitter.
            jitter: how far the executed grasps are off.
        """
        shape = (len(contacts), ANGLES, 3)
        positions = contacts.positions[:, None] + rng.normal(scale=jitter.contact, size=shape)
        normals = np.repeat(contacts.normals[:, None], ANGLES, axis=1)
        normals = _tilt(normals, rng.normal(scale=jitter.normal, size=shape))
        return Labels.concatenate(
            [
                self._label_contact(int(target), positions[i], normals[i], contacts.widths[i])
                for i, target in enumerate(contacts.objects)
            ]
        )

    def _label_contact(
        self,
        target: int,
        positions: Float[np.ndarray, "a 3"],
        normals: Float[np.ndarray, "a 3"],
        exits: Float[np.ndarray, "e"],
    ) -> Labels:
        """The labels of one contact, whose jittered positions and normals are given for each angle."""
        fitting = exits[exits < self.gripper.max_opening]
        if len(fitting) == 0:
            nothing = np.zeros((1, ANGLES), bool)
            width = exits[0] if np.isfinite(exits[0]) else 0.0
            return Labels(nothing, ~nothing, nothing, np.array([width]))
        tries = [self._try_width(target, positions, normals, width) for width in fitting]
        return max(tries, key=lambda labels: int(labels.success.sum()))

    def _try_width(
        self, target: int, positions: Float[np.ndarray, "a 3"], normals: Float[np.ndarray, "a 3"], width: float
    ) -> Labels:
        every = np.arange(ANGLES)
        widths = np.full(ANGLES, width)
        poses = grasp_poses(positions, normals, widths, self.gripper.finger_reach)[every, every]
        openings = self.gripper.opening(widths)
        collided = self.checker.collides(poses, openings)
        success, disturbed = np.zeros(ANGLES, bool), np.zeros(ANGLES, bool)
        # What is thinner than the smallest opening that counts as holding cannot succeed.
        for angle in np.flatnonzero(~collided) if width > MIN_OPENING else ():
            outcome = self.run(poses[angle], float(openings[angle]), target)
            success[angle], disturbed[angle] = outcome.success, outcome.disturbed
        return Labels(success[None], collided[None], disturbed[None], widths[:1])

    def run(self, T_world_grasp: Float[np.ndarray, "4 4"], opening: float, target: int) -> Outcome:
        """Closes the hand at a pose that it has reached, lifts, and reports; the approach is not checked here."""
        world, hand = self.world, self.world.hand
        world.restore(self._start)
        hand.place(T_world_grasp, opening)
        hand.squeeze(self.gripper.finger_force)
        self._close()
        if not self._holds(target):
            return Outcome(False, self._disturbs(target))
        before = world.centres_of_mass()[target]
        if not self._lift(T_world_grasp[:3, 3], retreat_vector(T_world_grasp), target):
            return Outcome(False, self._disturbs(target))
        world.step(self._steps(SETTLE_TIME))
        risen = world.centres_of_mass()[target, 2] - before[2]
        lifted = risen > 0.5 * retreat_vector(T_world_grasp)[2]
        return Outcome(bool(lifted and self._holds(target)), self._disturbs(target))

    def _steps(self, duration: float) -> int:
        return round(duration / self.world.physics.timestep)

    def _close(self) -> None:
        """Steps until the fingers stand still on something, or on each other."""
        world, block = self.world, 5
        for _ in range(self._steps(CLOSE_TIMEOUT) // block):
            world.step(block)
            if world.hand.finger_speed() < CLOSED_SPEED:
                return

    def _lift(self, start: Float[np.ndarray, "3"], path: Float[np.ndarray, "3"], target: int) -> bool:
        """Moves the hand along `path` [m], smoothly; gives up, with False, once the object is no longer held."""
        steps = self._steps(LIFT_TIME)
        for step in range(1, steps + 1):
            progress = step / steps
            self.world.hand.move_to(start + path * progress**2 * (3.0 - 2.0 * progress))
            self.world.step()
            if step % 15 == 0 and not self._holds(target):
                return False
        return True

    def _holds(self, target: int) -> bool:
        """Whether both fingers touch the object and are not closed on each other."""
        world = self.world
        return world.hand.opening() > MIN_OPENING and world.is_held(target)

    def _disturbs(self, target: int) -> bool:
        """Whether any other object is not where it was before the trial."""
        before, after = self._start_quaternions, self.world.object_quaternions()
        # q and -q are the same rotation.
        turn = np.minimum(np.linalg.norm(after - before, axis=1), np.linalg.norm(after + before, axis=1))
        shift = np.linalg.norm(self.world.object_positions() - self._start_positions, axis=1)
        disturbed = (shift > DISTURBED_SHIFT) | (turn > DISTURBED_TURN)
        disturbed[target] = False
        return bool(disturbed.any())


def retreat_vector(T_world_grasp: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"]:
    """Where the hand goes with the object [m]: straight up after a grasp from the side, else back as it came."""
    approach = T_world_grasp[:3, 2]
    is_from_side = np.arccos(np.clip(-approach[2], -1.0, 1.0)) > SIDE_GRASP
    return LIFT * np.array([0.0, 0.0, 1.0]) if is_from_side else -LIFT * approach


def _tilt(normals: Float[np.ndarray, "*n 3"], tilts: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """Unit normals, turned a little: the tangential part of `tilts` [rad] is added to them."""
    tangent = tilts - (tilts * normals).sum(axis=-1, keepdims=True) * normals
    tilted = normals + tangent
    return tilted / np.linalg.norm(tilted, axis=-1, keepdims=True)
