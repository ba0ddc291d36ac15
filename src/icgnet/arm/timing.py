"""From a path through joint positions to a trajectory: TOPP-RA, within the arm's speeds and accelerations."""

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import yaml
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.libraries import roboplan, toppra
from icgnet.errors import InputError

SAMPLE_TIME = 0.01
"""Time between the points of a trajectory [s]."""
GROUP = "arm"
SAME_POINT = 1e-6
"""Waypoints nearer to each other than this are one [rad]."""


class NoTrajectoryError(Exception):
    """TOPP-RA finds none along a path with corners rounded as asked for."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Joint positions over time, at rest at both ends.

    Attributes:
        times: from 0 [s].
        positions: [rad].
        velocities: [rad/s].
        accelerations: [rad/s^2].
    """

    times: Float[np.ndarray, "n"]
    positions: Float[np.ndarray, "n j"]
    velocities: Float[np.ndarray, "n j"]
    accelerations: Float[np.ndarray, "n j"]

    @property
    def duration(self) -> float:
        """How long it takes [s]."""
        return float(self.times[-1])

    @property
    def all_velocities(self) -> Float[np.ndarray, "_ j"]:
        """The velocities at all points, and those that the positions between them mean [rad/s]."""
        between = np.diff(self.positions, axis=0) / np.diff(self.times)[:, None]
        return np.concatenate([self.velocities, between])

    @property
    def all_accelerations(self) -> Float[np.ndarray, "_ j"]:
        """The accelerations at all points, and those that the velocities between them mean [rad/s^2]."""
        between = np.diff(self.velocities, axis=0) / np.diff(self.times)[:, None]
        return np.concatenate([self.accelerations, between])

    def at(self, times: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m j"]:
        """Joint positions at these times [rad]: between its points, cubic curves through positions and velocities."""
        cell = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        width = (self.times[cell + 1] - self.times[cell])[:, None]
        u = np.clip((times - self.times[cell])[:, None] / width, 0.0, 1.0)
        start, end = self.positions[cell], self.positions[cell + 1]
        leaving, coming = width * self.velocities[cell], width * self.velocities[cell + 1]
        return (
            (1 + 2 * u) * (1 - u) ** 2 * start
            + u * (1 - u) ** 2 * leaving
            + u**2 * (3 - 2 * u) * end
            + u**2 * (u - 1) * coming
        )

    def samples(self, reaches: Float[np.ndarray, "j"], travel: float) -> Float[np.ndarray, "m j"]:
        """Positions between which no point moves farther than this [m], both ends included.

        Args:
            reaches: how far a point can be from the axis of each joint [m].
            travel: largest way of any point from one position to the next [m].
        """
        ways = np.abs(np.diff(self.positions, axis=0)) @ reaches
        done = np.concatenate([[0.0], np.cumsum(ways)])
        count = int(np.ceil(done[-1] / travel)) + 1
        if count == 1:
            return self.positions[:1]
        return self.at(np.interp(np.linspace(0.0, done[-1], count), done, self.times))


def still(joints: Float[np.ndarray, "j"], duration: float) -> Trajectory:
    """A trajectory that stays where it is."""
    positions = np.stack([joints, joints])
    return Trajectory(np.array([0.0, duration]), positions, np.zeros_like(positions), np.zeros_like(positions))


@lru_cache(maxsize=8)
def timing_of(arm: Arm) -> "Timing":
    """What makes trajectories for an arm, made once for each."""
    return Timing(arm)


class Timing:
    """Makes trajectories for one arm.

    Args:
        arm: the arm, whose limits hold.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        self._scene = roboplan.Scene(arm.name, roboplan.loadUrdfSceneDescriptionFromXml(_limits_urdf(arm)))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "limits.yaml"
            limits = {
                name: {"max_acceleration": [float(value)]}
                for name, value in zip(arm.joint_names, arm.acceleration, strict=True)
            }
            path.write_text(yaml.safe_dump({"joint_limits": limits}))
            self._scene.importJointLimitsFromConfig(roboplan.loadJointLimitsConfig(path))
        self._scene.addGroup(GROUP, list(arm.joint_names))
        self._toppra = toppra.PathParameterizerTOPPRA(self._scene, GROUP)

    def along(self, path: Float[np.ndarray, "n j"], deviation: float, speed: float = 1.0) -> Trajectory:
        """The fastest trajectory along straight lines in joint space, their corners rounded.

        Paper: none; TOPP-RA of Pham and Pham (2018), by roboplan.

        Args:
            path: waypoints [rad].
            deviation: how far the rounded corners may be from the waypoints [rad]; with 0 the arm stops at each.
            speed: share of the largest velocities that is used; accelerations fall with its square.

        Raises:
            InputError: a path that does not move, or a speed that is not in (0, 1].
            NoTrajectoryError: none is found.
        """
        if not 0.0 < speed <= 1.0:
            raise InputError(f"speed must be above 0 and at most 1, got {speed:g}")
        moves = np.abs(np.diff(path, axis=0)).max(axis=1) > SAME_POINT
        waypoints = [path[0], *path[1:][moves]]
        if len(waypoints) < 2:
            raise InputError("a path must lead from one position to another")
        # Without rounding, the library would go around corners without stopping there.
        parts = [waypoints] if deviation > 0.0 else list(pairwise(waypoints))
        trajectory = joined([self._through(list(part), deviation) for part in parts])
        return slowed(trajectory, max(1.0 / speed, self._excess(trajectory)))

    def _through(self, waypoints: list[Float[np.ndarray, "j"]], deviation: float) -> Trajectory:
        """The fastest trajectory through waypoints, their corners rounded.

        Raises:
            NoTrajectoryError: none is found.
        """
        given = roboplan.JointPath()
        given.joint_names, given.positions = list(self.arm.joint_names), waypoints
        mode = toppra.SplineFittingMode.LinearBlend
        options = toppra.TOPPRAOptions(dt=SAMPLE_TIME, mode=mode, max_blend_deviation=deviation)
        try:
            found = self._toppra.generate(given, options)
        except RuntimeError as error:
            raise NoTrajectoryError(str(error)) from error
        return Trajectory(*map(np.array, (found.times, found.positions, found.velocities, found.accelerations)))

    def _excess(self, trajectory: Trajectory) -> float:
        """By how much a trajectory must be slowed down to keep the limits at all of its points; 1 if not at all."""
        fast = np.abs(trajectory.all_velocities / self.arm.velocity).max()
        sharp = np.abs(trajectory.all_accelerations / self.arm.acceleration).max()
        return max(1.0, float(fast), float(np.sqrt(sharp)))


def slowed(trajectory: Trajectory, factor: float) -> Trajectory:
    """The same way, taking this many times as long."""
    return replace(
        trajectory,
        times=trajectory.times * factor,
        velocities=trajectory.velocities / factor,
        accelerations=trajectory.accelerations / factor**2,
    )


def joined(parts: Sequence[Trajectory]) -> Trajectory:
    """Several trajectories one after the other, each beginning where the one before ends."""
    starts = np.cumsum([0.0, *(part.duration for part in parts[:-1])])
    firsts = [slice(0 if index == 0 else 1, None) for index in range(len(parts))]
    return Trajectory(
        np.concatenate([(start + part.times)[rows] for start, part, rows in zip(starts, parts, firsts, strict=True)]),
        np.concatenate([part.positions[rows] for part, rows in zip(parts, firsts, strict=True)]),
        np.concatenate([part.velocities[rows] for part, rows in zip(parts, firsts, strict=True)]),
        np.concatenate([part.accelerations[rows] for part, rows in zip(parts, firsts, strict=True)]),
    )


def _limits_urdf(arm: Arm) -> str:
    """A chain of joints with the arm's names and limits: all that is asked for here."""
    links = [f'<link name="link{index}"/>' for index in range(len(arm.joint_names) + 1)]
    joints = [
        f'<joint name="{name}" type="revolute"><parent link="link{index}"/><child link="link{index + 1}"/>'
        f'<origin xyz="0 0 0.1"/><axis xyz="0 0 1"/><limit lower="{low}" upper="{high}" velocity="{fast}" effort="1"/>'
        "</joint>"
        for index, (name, low, high, fast) in enumerate(
            zip(arm.joint_names, arm.lower, arm.upper, arm.velocity, strict=True)
        )
    ]
    return f'<robot name="limits">{"".join([*links, *joints])}</robot>'
