"""A movement of the empty arm from one place to another, for example to look from elsewhere."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.bodies import CollisionBody
from icgnet.arm.paths import PathFinder
from icgnet.arm.pick import DEVIATIONS, timed_phase
from icgnet.arm.plan import Phase
from icgnet.arm.scene import CollisionChecker, Load
from icgnet.arm.settings import DEFAULT_PICK, PickSettings
from icgnet.arm.timing import timing_of
from icgnet.grasping.gripper import Gripper


def plan_move(
    arm: Arm,
    gripper: Gripper,
    start: Float[np.ndarray, "j"],
    goal: Float[np.ndarray, "j"],
    bodies: Sequence[CollisionBody],
    settings: PickSettings = DEFAULT_PICK,
) -> Phase | None:
    """A tested movement with the open hand; None if none was found.

    Args:
        arm: the arm.
        gripper: its hand.
        start: joint positions where it begins [rad].
        goal: where it ends [rad].
        bodies: what stands around, in the frame of the base.
        settings: margin, speed and seed.
    """
    load = Load(gripper.max_opening, gripper.max_opening)
    checker = CollisionChecker(arm, gripper, bodies, load)
    way = PathFinder(checker, settings.margin, np.random.default_rng(settings.seed)).find(start, goal)
    if way is None:
        return None
    return timed_phase("move", timing_of(arm), way, DEVIATIONS, settings.speed, load, checker, settings.margin)
