"""Grasp labels by simulated trials ("strict"): free approach, close, lift, and the named object must be held."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.collision import draw_back
from icgnet.grasping.frame import APPROACH_ANGLES, grasp_poses
from icgnet.grasping.gripper import Gripper
from icgnet.simulation.approach import APPROACH_LENGTH, ApproachChecker
from icgnet.simulation.config import Jitter, Physics
from icgnet.simulation.contacts import Contacts
from icgnet.simulation.hand import closing_time
from icgnet.simulation.motion import smooth_line, steps_in
from icgnet.simulation.physics import Body
from icgnet.simulation.surroundings import ENDLESS, Surroundings
from icgnet.simulation.world import World

ANGLES = len(APPROACH_ANGLES)
MIN_OPENING = 0.004  # a hand closed further than this holds nothing [m]
SIDE_GRASP = np.pi / 3  # beyond this angle from straight down, the hand retreats upwards [rad]
DISTURBED_SHIFT = 0.05  # a neighbour that moved this far was disturbed [m]
DISTURBED_TURN = 0.1  # ... or whose quaternion changed by this norm
LIFT = 0.10  # length of the retreat [m]
APPROACH_TIME, LIFT_TIME, SETTLE_TIME = 0.3, 0.24, 0.06  # [s]
CLOSE_MARGIN = 0.4  # time that the fingers have beyond the way from fully open to closed [s]
LIFT_CHECK = 15  # steps between two looks at the object while lifting
LOST_SHIFT = 0.04  # an object that moved this far in the hand will not be lifted [m]
HELD_STEPS = 5  # both fingers must touch the object in one of the last steps
CLOSED_SPEED = 0.002  # fingers slower than this have closed [m/s]


@dataclass(frozen=True, eq=False)
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
    collided: bool = False


class Trials:
    """Grasp trials in one scene: every trial starts from the same state."""

    def __init__(
        self, bodies: Sequence[Body], gripper: Gripper, physics: Physics, surroundings: Surroundings = ENDLESS
    ) -> None:
        """Compiles the worlds for the approach check and for the physics.

        Args:
            bodies: the objects, at rest.
            gripper: the hand.
            physics: engine and material settings.
            surroundings: the table or bin and what stands around it.
        """
        self.gripper = gripper
        self.checker = ApproachChecker(bodies, gripper, physics, ANGLES, surroundings)
        self.world = World(bodies, physics, gripper, asleep=True, surroundings=surroundings)
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
        positions, normals = jitter.apply(
            np.repeat(contacts.positions[:, None], ANGLES, axis=1),
            np.repeat(contacts.normals[:, None], ANGLES, axis=1),
            rng,
        )
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
        openings = self.gripper.opening(widths)
        poses = grasp_poses(positions, normals, widths, self.gripper.finger_reach)[every, every]
        poses = draw_back(poses, openings, self.gripper, TABLE_HEIGHT)
        collided = self.checker.collides(poses, openings)
        success, disturbed = np.zeros(ANGLES, bool), np.zeros(ANGLES, bool)
        # What is thinner than the smallest opening that counts as holding cannot succeed.
        for angle in np.flatnonzero(~collided) if width > MIN_OPENING else ():
            outcome = self.run(poses[angle], float(openings[angle]), target)
            success[angle], disturbed[angle] = outcome.success, outcome.disturbed
        return Labels(success[None], collided[None], disturbed[None], widths[:1])

    def run(self, T_world_grasp: Float[np.ndarray, "4 4"], opening: float, target: int) -> Outcome:
        """Closes the hand at a pose that it has reached, lifts, and reports; the approach is not checked here."""
        self.world.restore(self._start)
        self.world.hand.place(T_world_grasp, opening)
        return self._close_and_lift(T_world_grasp, target)

    def run_with_approach(self, T_world_grasp: Float[np.ndarray, "4 4"], opening: float, target: int) -> Outcome:
        """The whole trial in physics: the open hand moves in, and fails when it touches anything on its way.

        Slow: what `label` decides by a collision check is simulated here, to measure how often both agree.
        """
        world, hand = self.world, self.world.hand
        way = APPROACH_LENGTH * T_world_grasp[:3, 2]
        world.restore(self._start)
        hand.place(make_transform(T_world_grasp[:3, :3], T_world_grasp[:3, 3] - way), opening)
        for position in smooth_line(T_world_grasp[:3, 3] - way, way, APPROACH_TIME, world.physics):
            hand.move_to(position)
            world.step()
            if world.hand_touches_anything():
                return Outcome(False, self._disturbs(target), collided=True)
        return self._close_and_lift(T_world_grasp, target)

    def _close_and_lift(self, T_world_grasp: Float[np.ndarray, "4 4"], target: int) -> Outcome:
        world = self.world
        world.hand.squeeze(self.gripper.finger_force)
        self._close()
        before = self._place_in_hand(target)
        height = world.centres_of_mass()[target, 2]
        if not self._lift(T_world_grasp[:3, 3], retreat_vector(T_world_grasp), target, before):
            return Outcome(False, self._disturbs(target))
        held = self._settle(target)
        risen = world.centres_of_mass()[target, 2] - height
        lifted = risen > 0.5 * retreat_vector(T_world_grasp)[2]
        return Outcome(bool(lifted and held and not world.is_unstable()), self._disturbs(target))

    def _close(self) -> None:
        """Steps until the fingers stand still on something, or on each other."""
        world, block = self.world, 5
        timeout = closing_time(self.gripper) + CLOSE_MARGIN
        for _ in range(steps_in(timeout, world.physics) // block):
            world.step(block)
            if world.hand.finger_speed() < CLOSED_SPEED:
                return

    def _lift(
        self,
        start: Float[np.ndarray, "3"],
        path: Float[np.ndarray, "3"],
        target: int,
        place: Float[np.ndarray, "3"],
    ) -> bool:
        """Moves the hand along `path` [m], smoothly; gives up, with False, once the object has left its place in it."""
        for step, position in enumerate(smooth_line(start, path, LIFT_TIME, self.world.physics), start=1):
            self.world.hand.move_to(position)
            self.world.step()
            if step % LIFT_CHECK == 0 and self._has_lost(target, place):
                return False
        return True

    def _settle(self, target: int) -> bool:
        """Waits, and says whether both fingers held the object at the end of it."""
        self.world.step(steps_in(SETTLE_TIME, self.world.physics))
        for _ in range(HELD_STEPS):
            self.world.step()
            # A contact may be missing for one step while the object rocks between the pads.
            if self.world.is_held(target) and self.world.hand.opening() > MIN_OPENING:
                return True
        return False

    def _place_in_hand(self, target: int) -> Float[np.ndarray, "3"]:
        """Where the object's centre of mass is, seen from the hand but along the world's axes [m]."""
        return self.world.centres_of_mass()[target] - self.world.hand.position()

    def _has_lost(self, target: int, place: Float[np.ndarray, "3"]) -> bool:
        """Whether the fingers are closed, or the object is far from the place in the hand that it had."""
        if self.world.hand.opening() <= MIN_OPENING:
            return True
        return bool(np.linalg.norm(self._place_in_hand(target) - place) > LOST_SHIFT)

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
