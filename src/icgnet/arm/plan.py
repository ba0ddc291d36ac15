"""A planned pick: what the arm does from start to end, and what was checked of it."""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from icgnet.arm.bodies import CollisionBody
from icgnet.arm.scene import Load, Meeting
from icgnet.arm.timing import Trajectory, joined
from icgnet.grasping.gripper import Gripper
from icgnet.output_folder import output_folder

FORMAT = "icgnet pick 1"
PLAN_FILE, ARRAYS_FILE = "plan.json", "plan.npz"


@dataclass(frozen=True, eq=False)
class Phase:
    """One part of a pick, between two stops of the arm.

    Attributes:
        name: reach, approach, close, lift, carry, lower, release, leave or return.
        trajectory: of the joints; it stays where it is while the fingers move.
        opening: distance between the finger tips that is commanded during this phase [m].
        load: what the hand holds, for collision checks.
        margin: distance from everything that was kept, for certain [m].
        clearance: least distance of anything that moves to anything that stands around [m], at most 0.05, and then
            nothing is near; None if it was not measured.
        nearest: between what it is; None if nothing is near or nothing was measured.
        extra: bodies that stand around in this phase beside those of the plan: the object where it was put down.
    """

    name: str
    trajectory: Trajectory
    opening: float
    load: Load
    margin: float
    clearance: float | None = None
    nearest: Meeting | None = None
    extra: tuple[CollisionBody, ...] = ()

    @property
    def moves_fingers(self) -> bool:
        """Whether the fingers move and not the arm."""
        return self.load.low != self.load.high

    @property
    def caption(self) -> str:
        """Its name, and how near what comes to what."""
        if self.clearance is None or self.nearest is None:
            return self.name
        return f"{self.name}, {1e3 * self.clearance:.0f} mm from {self.nearest.body}"


@dataclass(frozen=True)
class Refusal:
    """Why a grasp cannot be carried out.

    Attributes:
        grasp: its row among those of the prediction.
        instance: the object that it is for.
        reason: in words; counted under these.
    """

    grasp: int
    instance: int
    reason: str


@dataclass(frozen=True, eq=False)
class PickPlan:
    """How one object is picked, carried and let go of; without phases if none can be.

    Everything is in the frame of the arm's base, in metres, radians and seconds.

    Attributes:
        arm: name of the arm.
        joint_names: in the order of all joint values.
        gripper: the hand.
        grasp: row of the grasp among those of the prediction; None if none can be carried out.
        instance: the object that is picked; None if there is none.
        T_base_grasp: the grasp.
        phases: one after the other, the first from where the arm stands.
        refusals: of the grasps that were tried before.
        timings_ms: time of planning per stage [ms].
        bodies: what stands around, for pictures and checks.
    """

    arm: str
    joint_names: tuple[str, ...]
    gripper: Gripper
    grasp: int | None
    instance: int | None
    T_base_grasp: Float[np.ndarray, "4 4"] | None
    phases: tuple[Phase, ...]
    refusals: tuple[Refusal, ...]
    timings_ms: dict[str, float] = field(default_factory=dict)
    bodies: tuple[CollisionBody, ...] = ()

    @property
    def is_found(self) -> bool:
        """Whether there is a plan."""
        return bool(self.phases)

    @property
    def duration(self) -> float:
        """Time from start to end [s]."""
        return sum((phase.trajectory.duration for phase in self.phases), 0.0)

    @property
    def refused(self) -> dict[str, int]:
        """How many grasps were refused, by reason, the most frequent first."""
        reasons = [refusal.reason for refusal in self.refusals]
        return {reason: reasons.count(reason) for reason in sorted(set(reasons), key=lambda each: -reasons.count(each))}

    def joint_trajectory(self) -> Trajectory:
        """The whole pick as one trajectory.

        Raises:
            ValueError: there is no plan.
        """
        return joined([phase.trajectory for phase in self.phases])

    def messages(self) -> list[dict[str, Any]]:
        """For each phase a dictionary of the shape of `trajectory_msgs/JointTrajectory`, with plain values."""
        return [_message(self.joint_names, phase.trajectory) for phase in self.phases]

    def to_dict(self) -> dict[str, Any]:
        """Everything but the bodies as plain values, for JSON."""
        return {
            "format": FORMAT,
            "arm": self.arm,
            "joint_names": list(self.joint_names),
            "gripper": self.gripper.to_dict(),
            "grasp": self.grasp,
            "instance_id": self.instance,
            "T_base_grasp": None if self.T_base_grasp is None else self.T_base_grasp.tolist(),
            "duration": self.duration,
            "phases": [
                {
                    "name": phase.name,
                    "duration": phase.trajectory.duration,
                    "opening": phase.opening,
                    "moves_fingers": phase.moves_fingers,
                    "carries": phase.load.carried is not None,
                    "margin": phase.margin,
                    "clearance": phase.clearance,
                    "nearest": None if phase.nearest is None else [phase.nearest.part, phase.nearest.body],
                    "joint_trajectory": message,
                }
                for phase, message in zip(self.phases, self.messages(), strict=True)
            ],
            "refused": self.refused,
            "refusals": [
                {"grasp": each.grasp, "instance_id": each.instance, "reason": each.reason} for each in self.refusals
            ],
            "timings_ms": {stage: round(time, 3) for stage, time in self.timings_ms.items()},
        }

    def write(self, folder: Path) -> None:
        """Writes plan.json and, if there is a plan, plan.npz with the whole trajectory."""
        (folder / PLAN_FILE).write_text(json.dumps(self.to_dict(), indent=1) + "\n")
        if not self.is_found:
            return
        whole = self.joint_trajectory()
        ends = np.cumsum([phase.trajectory.duration for phase in self.phases])
        np.savez_compressed(
            folder / ARRAYS_FILE,
            joint_names=np.array(self.joint_names),
            times=whole.times,
            positions=whole.positions,
            velocities=whole.velocities,
            accelerations=whole.accelerations,
            phase_names=np.array([phase.name for phase in self.phases]),
            phase_ends=ends,
            openings=np.array([phase.opening for phase in self.phases]),
        )

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Writes the plan as a folder that appears whole or not at all; an earlier plan is replaced.

        Args:
            path: the folder.
            overwrite: whether a folder with other files may be replaced too.

        Raises:
            InputError: something else is in the way.
        """
        with output_folder(Path(path), PLAN_FILE, overwrite) as folder:
            self.write(folder)


def _message(joint_names: tuple[str, ...], trajectory: Trajectory) -> dict[str, Any]:
    rows = zip(
        trajectory.times.tolist(),
        trajectory.positions.tolist(),
        trajectory.velocities.tolist(),
        trajectory.accelerations.tolist(),
        strict=True,
    )
    return {
        "joint_names": list(joint_names),
        "points": [
            {
                "positions": positions,
                "velocities": velocities,
                "accelerations": accelerations,
                "time_from_start": dict(zip(("sec", "nanosec"), divmod(round(1e9 * time), 10**9), strict=True)),
            }
            for time, positions, velocities, accelerations in rows
        ],
    }
