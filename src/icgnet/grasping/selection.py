"""Which grasps to keep, and which one to try first."""

from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.geometry.clouds import crop
from icgnet.grasping.grasps import Grasps

SCORE_LADDER = (0.9, 0.8, 0.7)
"""Scores that a grasp must exceed, tried one after the other (paper)."""
Rule = Literal["best", "highest"]
UP = np.array([0.0, 0.0, 1.0])


def ranked(grasps: Grasps, rule: Rule = "best", up: Float[np.ndarray, "3"] = UP) -> Grasps:
    """The grasps in the order in which they are to be tried.

    Paper: "Grasp Selection and Reconstruction" (the best) and "Real World Experiments" (the highest above 0.9, else
    above 0.8, else above 0.7): grasps from above disturb the fewest neighbours.

    Args:
        grasps: candidates in any order.
        rule: "best": the highest score first. "highest": first those that exceed the first score of `SCORE_LADDER`, the
            highest of them first, then those that exceed the next one, and so on. Those that do not exceed the last one
            are left out: it is better to look again.
        up: direction against gravity in the frame of the grasps, for the rule "highest".
    """
    if rule == "best":
        return grasps.sorted()
    rung = (grasps.scores[:, None] > np.array(SCORE_LADDER)).sum(axis=1)
    order = np.lexsort((-grasps.poses[:, :3, 3] @ up, -rung))
    return grasps.select(order[rung[order] > 0])


def of_instances(grasps: Grasps, instances: Iterable[int]) -> Grasps:
    """The grasps of these instances."""
    return grasps.select(np.isin(grasps.instances, list(instances)))


def of_class(grasps: Grasps, class_name: str, instance_classes: Mapping[int, str]) -> Grasps:
    """The grasps of all instances of a class.

    Args:
        grasps: candidates.
        class_name: the class wanted.
        instance_classes: class of every instance, by its id.
    """
    return of_instances(grasps, [instance for instance, name in instance_classes.items() if name == class_name])


def in_region(grasps: Grasps, lower: Float[np.ndarray, "3"], upper: Float[np.ndarray, "3"]) -> Grasps:
    """The grasps whose origin, midway between the finger tips, lies in a box.

    Args:
        grasps: candidates.
        lower: least coordinates of the box, in the frame of the grasps [m].
        upper: greatest coordinates [m].

    Raises:
        InputError: a lower coordinate that is above the upper one.
    """
    lower, upper = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    if not (lower <= upper).all():
        raise InputError(f"region must have lower <= upper, got {lower.tolist()} and {upper.tolist()}")
    return grasps.select(crop(grasps.poses[:, :3, 3], lower, upper))


def in_cone(grasps: Grasps, direction: Float[np.ndarray, "3"], half_angle: float) -> Grasps:
    """The grasps that approach along a direction.

    Args:
        grasps: candidates.
        direction: wanted approach direction in the frame of the grasps, of any length; (0, 0, -1) is from above.
        half_angle: largest angle between the approach and that direction [rad].

    Raises:
        InputError: a direction of length zero, or an angle outside of 0 to pi.
    """
    direction = np.asarray(direction, dtype=np.float64)
    length = np.linalg.norm(direction)
    if not (np.isfinite(length) and length > 0):
        raise InputError(f"direction must be a vector of positive length, got {direction.tolist()}")
    if not 0 <= half_angle <= np.pi:
        raise InputError(f"half_angle must be between 0 and pi rad, got {half_angle:g}")
    # Rounding must not exclude the direction itself when the angle is zero.
    return grasps.select(grasps.poses[:, :3, 2] @ direction >= length * (np.cos(half_angle) - 1e-9))


def non_maximum_suppression(
    grasps: Grasps, distance: float = 0.02, angle: float = np.pi / 6, limit: int | None = None
) -> Grasps:
    """The best grasps, without those that hardly differ from a better one.

    Two grasps are alike when their origins are nearer than `distance` and their orientations differ by less than
    `angle`, where the hand turned by half a turn about its approach counts as the same hand.

    Args:
        grasps: candidates in any order.
        distance: distance of the origins [m].
        angle: angle between the orientations [rad].
        limit: how many to return at most; all if None.

    Returns:
        The survivors, best score first.
    """
    ordered = grasps.sorted()
    left = np.arange(len(ordered))
    kept: list[int] = []
    while len(left) and (limit is None or len(kept) < limit):
        best = left[0]
        kept.append(int(best))
        poses = ordered.poses[left]
        near = np.linalg.norm(poses[:, :3, 3] - poses[0, :3, 3], axis=1) < distance
        alike = near & (_angles_between(poses[0, :3, :3], poses[:, :3, :3]) < angle)
        alike[0] = True
        left = left[~alike]
    return ordered.select(np.array(kept, dtype=np.int64))


def _angles_between(rotation: Float[np.ndarray, "3 3"], others: Float[np.ndarray, "g 3 3"]) -> Float[np.ndarray, "g"]:
    """Angles [rad] to the other orientations, the smaller of those to the hand and to the hand turned by pi about z."""
    xx, yy, zz = np.einsum("ik,gik->kg", rotation, others)
    # Turning by pi about z flips the signs of the first two diagonal entries, so the larger trace has the absolute sum.
    trace = np.abs(xx + yy) + zz
    return np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0))
