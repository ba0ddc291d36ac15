"""Joint positions for a pose of the hand, and along a straight line."""

# The compiled modules of pinocchio carry no types.
# pyright: reportAttributeAccessIssue=false

import math
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.libraries import frankik, pin
from icgnet.errors import DataError
from icgnet.geometry.transforms import invert_transform

POSITION_ERROR, ROTATION_ERROR = 1e-5, 1e-4
"""How far a solution may be from the pose that was asked for [m], [rad]."""
LAST_JOINT_STEPS = 24
"""So many positions of the last joint of an arm with seven are tried; each gives up to four solutions."""
STARTS, ITERATIONS, ENOUGH = 24, 60, 6
"""Of the numerical solver: it starts from so many positions at most, until it has found so many solutions."""
DAMPING = 1e-3
SAME = 0.1
"""Solutions whose joints are all nearer than this are one [rad]."""
LINE_STEP = 0.01
"""A straight line is followed in steps of this [m], at most."""
LARGEST_JUMP = 0.2
"""Joints that move farther than this within one step of a line have changed over to another solution [rad]."""


@runtime_checkable
class Solver(Protocol):
    """Inverse kinematics of the link that the hand is mounted on."""

    def solutions(self, T_base_mount: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "s j"]:
        """Joint positions within the limits that lead to a pose, nearest to the home position first."""
        ...


def make_solver(arm: Arm) -> Solver:
    """The solver that the arm's file asks for.

    Raises:
        DataError: closed formulas for an arm that they do not fit.
    """
    return FrankaSolver(arm) if arm.description.solver == "franka" else NumericalSolver(arm)


class FrankaSolver:
    """Closed formulas for the arms of Franka: all branches, over a grid of positions of the last joint.

    Raises:
        DataError: the arm is not built like those.
    """

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        if len(arm.joint_names) != 7:
            raise DataError(f"arm {arm.name}: the solver franka is for arms of 7 joints, not {len(arm.joint_names)}")
        solutions = frankik.ik_full(arm.mount_pose(arm.home), arm.home, arm.home[6])
        if not any(np.allclose(each, arm.home, atol=1e-4) for each in solutions):
            raise DataError(
                f"arm {arm.name}: the solver franka is for the flange of an arm of Franka, which this is not"
            )
        self._last = np.linspace(arm.lower[6], arm.upper[6], LAST_JOINT_STEPS + 2)[1:-1]

    def solutions(self, T_base_mount: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "s j"]:
        """See `Solver`."""
        # The library knows the limits of two arms, both narrower somewhere than those of the URDF.
        tried = [(last, is_fr3) for last in self._last for is_fr3 in (True, False)]
        found = np.concatenate([frankik.ik_full(T_base_mount, self.arm.home, last, is_fr3) for last, is_fr3 in tried])
        return _nearest_first(self.arm, np.unique(found[np.isfinite(found).all(axis=1)].round(9), axis=0))


class NumericalSolver:
    """Damped Gauss-Newton steps from home and from several other positions, for any arm."""

    def __init__(self, arm: Arm) -> None:
        self.arm = arm
        drawn = np.random.default_rng(0).uniform(arm.lower, arm.upper, (STARTS - 1, len(arm.home)))
        self._starts = np.concatenate([arm.home[None], drawn])

    def solutions(self, T_base_mount: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "s j"]:
        """See `Solver`."""
        found: list[Float[np.ndarray, "j"]] = []
        for start in self._starts:
            joints = follow(self.arm, start, T_base_mount, ITERATIONS)
            if joints is not None and all(np.abs(joints - other).max() > SAME for other in found):
                found.append(joints)
            if len(found) == ENOUGH:
                break
        return _nearest_first(self.arm, np.array(found).reshape(-1, len(self.arm.home)))


def _nearest_first(arm: Arm, found: Float[np.ndarray, "n j"]) -> Float[np.ndarray, "s j"]:
    inside = found[((found >= arm.lower) & (found <= arm.upper)).all(axis=1)]
    return inside[np.argsort(((inside - arm.home) ** 2).sum(axis=1), kind="stable")]


def follow(
    arm: Arm, start: Float[np.ndarray, "j"], T_base_mount: Float[np.ndarray, "4 4"], iterations: int = 8
) -> Float[np.ndarray, "j"] | None:
    """Joint positions that lead to a pose, found from a start by Gauss-Newton steps within the limits; None if not.

    Args:
        arm: the arm.
        start: where to begin [rad].
        T_base_mount: wanted pose of the mount's link.
        iterations: at most.
    """
    joints = start
    for _ in range(iterations):
        error = _pose_error(arm.mount_pose(joints), T_base_mount)
        if np.linalg.norm(error[:3]) < POSITION_ERROR and np.linalg.norm(error[3:]) < ROTATION_ERROR:
            return joints
        jacobian = arm.mount_jacobian(joints)
        square = jacobian @ jacobian.T
        # Far from the goal steps are damped; near it they are Newton's.
        damping = DAMPING * min(1.0, float(error @ error))
        step = jacobian.T @ np.linalg.solve(square + damping * np.eye(6) + 1e-10 * np.eye(6), error)
        joints = np.clip(joints + step / max(1.0, np.abs(step).max() / 0.5), arm.lower, arm.upper)
    return None


def _pose_error(
    T_base_now: Float[np.ndarray, "4 4"], T_base_wanted: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "6"]:
    """The way to a pose in the frame of the present one: translation [m], rotation vector [rad]."""
    T_now_wanted = invert_transform(T_base_now) @ T_base_wanted
    return np.concatenate([T_now_wanted[:3, 3], pin.log3(T_now_wanted[:3, :3])])


def line_steps(length: float) -> int:
    """In how many steps a straight line of this length [m] is followed."""
    return math.ceil(length / LINE_STEP - 1e-9)


def straight_line(arm: Arm, start: Float[np.ndarray, "j"], way: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n j"]:
    """Joint positions along a straight line, the hand keeping its orientation, as far as the arm can follow.

    Args:
        arm: the arm.
        start: where the line begins [rad].
        way: where it leads, from there, in the frame of the base [m].

    Returns:
        The start, then the ends of `line_steps` equal steps. The joints follow without jumps and within their limits;
        the line ends early where they cannot.
    """
    wanted = arm.mount_pose(start)
    steps = line_steps(float(np.linalg.norm(way)))
    line = [start]
    for _ in range(steps):
        wanted[:3, 3] += way / steps
        joints = follow(arm, line[-1], wanted)
        if joints is None or np.abs(joints - line[-1]).max() > LARGEST_JUMP:
            break
        line.append(joints)
    return np.array(line)
