"""A plan played back step by step, and held against everything that was promised of it."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from icgnet.arm.arm import Arm
from icgnet.arm.plan import PickPlan
from icgnet.arm.scene import CollisionChecker
from icgnet.errors import InputError

STEP = 0.001
"""Time between two positions that are looked at [s]."""
ALLOWED_DEPTH = 0.001
"""A body may be entered by this much [m]."""


@dataclass(frozen=True)
class Replay:
    """What came of a plan that was played back.

    Attributes:
        positions_kept: whether all joint positions are within their limits.
        speed: largest share of the allowed speed of any joint, also by differences of positions.
        acceleration: largest share of the allowed acceleration of any joint, also by differences of velocities.
        gap: largest jump of a joint from one phase to the next [rad].
        depth: how deep anything is in something else, at most [m].
        where: in which phase, and what; None if nothing meets.
        steps: positions that were looked at.
    """

    positions_kept: bool
    speed: float
    acceleration: float
    gap: float
    depth: float
    where: str | None
    steps: int

    @property
    def is_kept(self) -> bool:
        """Whether all that was promised holds; rounding is forgiven."""
        return (
            self.positions_kept
            and self.speed <= 1.0 + 1e-6
            and self.acceleration <= 1.0 + 1e-6
            and self.gap < 1e-6
            and self.depth <= ALLOWED_DEPTH
        )


def replay(plan: PickPlan, arm: Arm, step: float = STEP) -> Replay:
    """Plays a plan back.

    What the carried object touches where it is gripped is not counted while it is lifted.

    Args:
        plan: with phases.
        arm: the arm that it is for.
        step: time between two positions that are looked at [s].

    Raises:
        InputError: a plan without phases, or for another arm.
    """
    if not plan.is_found or plan.joint_names != arm.joint_names:
        raise InputError(f"replay needs a plan with phases for the arm {arm.name}, got one for {plan.arm}")
    steps, deepest, where, kept = 0, 0.0, None, True
    for phase in plan.phases:
        trajectory = phase.trajectory
        path = trajectory.at(np.arange(0.0, trajectory.duration + step, step))
        kept &= arm.within_limits(path) and arm.within_limits(trajectory.positions)
        steps += len(path)
        checker = CollisionChecker(arm, plan.gripper, (*plan.bodies, *phase.extra), phase.load)
        depths = [checker.deepest(joints) for joints in path if checker.collides(joints)]
        deep, meeting = max(depths, key=lambda each: each[0], default=(0.0, None))
        if deep > deepest:
            deepest, where = deep, None if meeting is None else f"{phase.name}: {meeting.part} in {meeting.body}"
    trajectories = [phase.trajectory for phase in plan.phases]
    return Replay(
        positions_kept=kept,
        speed=max(float(np.abs(each.all_velocities / arm.velocity).max()) for each in trajectories),
        acceleration=max(float(np.abs(each.all_accelerations / arm.acceleration).max()) for each in trajectories),
        gap=max(
            (float(np.abs(one.positions[-1] - other.positions[0]).max()) for one, other in pairwise(trajectories)),
            default=0.0,
        ),
        depth=deepest,
        where=where,
        steps=steps,
    )
