"""Fetching one object: what is in its way, why, and in which order it takes the fewest picks."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.bodies import CollisionBody, bodies_of, object_name
from icgnet.arm.kinematics import line_steps, make_solver, straight_line
from icgnet.arm.parting import pressed
from icgnet.arm.pick import HALF_TURN, apart, lift_ways, plan_pick
from icgnet.arm.plan import PickPlan
from icgnet.arm.scene import CARRIED, HAND, CollisionChecker, Load, Meeting
from icgnet.arm.settings import DEFAULT_PICK, PickSettings
from icgnet.geometry.transforms import check_pose, invert_transform
from icgnet.inference.prediction import NO_INSTANCE, Prediction

GRASPS = 12
"""So many grasps of an object are asked what is in their way, the best ones."""
REACHES = 2
"""So many joint positions of each."""
MOST_STATES = 20_000
"""So many sets of objects that are taken away are thought of at most."""


@dataclass(frozen=True)
class Way:
    """One way to take an object.

    Attributes:
        blockers: the objects that must be taken away before.
        reasons: what each of them is in the way of.
    """

    blockers: frozenset[int]
    reasons: Mapping[int, str]


@dataclass(frozen=True, eq=False)
class FetchPlan:
    """How to fetch an object.

    Attributes:
        target: the object.
        order: the objects to take one after the other, the target last; empty if no order leads to it.
        reasons: of each object that is taken before the target, what it is in the way of.
        pick: the plan for the first of them; without phases if there is none.
    """

    target: int
    order: tuple[int, ...]
    reasons: Mapping[int, str]
    pick: PickPlan


def plan_fetch(
    prediction: Prediction,
    arm: Arm,
    T_base_frame: Any,
    drop: Any,
    target: int,
    settings: PickSettings = DEFAULT_PICK,
    start: Any = None,
    fixtures: Sequence[CollisionBody] = (),
) -> FetchPlan:
    """The order of the fewest picks that leads to an object, and the plan of the first pick.

    A target that can be picked is picked. Where the first pick of an order has no plan though nothing is in its way (no
    path), the next best order is taken.

    Args:
        prediction: what was found. Its grasps should be all that are believed in, not only those that are free now:
            see `Predictor.only_free`.
        arm: the arm.
        T_base_frame: pose of the prediction's frame in that of the arm's base.
        drop: where objects are let go of, see `plan_pick`.
        target: id of the object.
        settings: how to plan.
        start: joint positions at start and end [rad]; home if None.
        fixtures: what always stands there.

    Raises:
        InputError: see `plan_pick`; or there is no such object.
    """
    prediction.class_of(target)
    pose = check_pose(T_base_frame, "T_base_frame")
    alone = plan_pick(prediction.of_instance(target), arm, pose, drop, settings, start, fixtures)
    if alone.is_found:
        return FetchPlan(target, (target,), {}, alone)
    ways = ways_to_take(prediction, arm, pose, settings, fixtures)
    first = target
    while True:
        ways[first] = tuple(way for way in ways[first] if way.blockers)
        order = shortest_order({key: [way.blockers for way in each] for key, each in ways.items()}, target)
        if not order:
            return FetchPlan(target, (), {}, alone)
        first = order[0]
        pick = plan_pick(prediction.of_instance(first), arm, pose, drop, settings, start, fixtures)
        if pick.is_found:
            return FetchPlan(target, order, _reasons(ways, order), pick)


def shortest_order(ways: Mapping[int, Iterable[frozenset[int]]], target: int) -> tuple[int, ...]:
    """The fewest objects to take one after the other, the target last; empty if there is no such order.

    Args:
        ways: for each object sets of others: it can be taken once all of one set are gone.
        target: the object that is wanted.
    """
    known = {key: list(dict.fromkeys(each)) for key, each in ways.items()}
    relevant, waiting = {target}, [target]
    while waiting:
        new = {other for blockers in known.get(waiting.pop(), []) for other in blockers} - relevant
        relevant |= new
        waiting += sorted(new)
    orders: deque[tuple[int, ...]] = deque([()])
    seen = {frozenset[int]()}
    while orders and len(seen) < MOST_STATES:
        order = orders.popleft()
        gone = frozenset(order)
        free = [key for key in sorted(relevant - gone) if any(each <= gone for each in known.get(key, []))]
        if target in free:
            return (*order, target)
        for key in free:
            if gone | {key} not in seen:
                seen.add(gone | {key})
                orders.append((*order, key))
    return ()


def ways_to_take(
    prediction: Prediction,
    arm: Arm,
    T_base_frame: Float[np.ndarray, "4 4"],
    settings: PickSettings = DEFAULT_PICK,
    fixtures: Sequence[CollisionBody] = (),
) -> dict[int, tuple[Way, ...]]:
    """For each object the ways in which it can be taken: what hand, arm and the object itself meet in some grasps.

    A grasp that meets what can not be taken away is no way. Of an object that can be taken at once only that is told.

    Args:
        prediction: what was found, with grasps.
        arm: the arm.
        T_base_frame: pose of the prediction's frame in that of the arm's base.
        settings: length of the straight lines, and what objects are for the arm.
        fixtures: what always stands there, in the frame of the base.
    """
    bodies = (*bodies_of(prediction, T_base_frame, settings.obstacles), *fixtures)
    grasps = prediction.grasps.transformed(T_base_frame)
    solver, found = make_solver(arm), {}
    for item in prediction.objects:
        target = next((body for body in bodies if body.name == object_name(item.instance_id)), None)
        if target is None:  # with neither shape nor points
            found[item.instance_id] = ()
            continue
        ways: dict[frozenset[int], Way] = {}
        rows = np.flatnonzero(grasps.instances == item.instance_id)[:GRASPS]
        for row in rows.tolist():
            opening = min(float(grasps.openings[row]), prediction.gripper.max_opening)
            width = min(float(grasps.widths[row]), opening)
            for pose in (grasps.poses[row], grasps.poses[row] @ HALF_TURN):
                asked = _Asked(arm, prediction, bodies, settings, target, pose, opening, width)
                T_base_mount = pose @ invert_transform(arm.T_mount_grasp(prediction.gripper))
                for joints in apart(solver.solutions(T_base_mount), REACHES):
                    way = asked.way(joints)
                    if way is not None:
                        ways.setdefault(way.blockers, way)
            if frozenset() in ways:
                break
        free = ways.get(frozenset())
        found[item.instance_id] = (free,) if free else _least(ways.values())
    return found


def _least(ways: Iterable[Way]) -> tuple[Way, ...]:
    """Those whose blockers are not more than those of another."""
    every = list(ways)
    return tuple(way for way in every if not any(other.blockers < way.blockers for other in every))


def _reasons(ways: Mapping[int, tuple[Way, ...]], order: tuple[int, ...]) -> dict[int, str]:
    """What each object of an order but the last is in the way of."""
    found: dict[int, str] = {}
    for position, key in reversed(list(enumerate(order))):
        way = next(way for way in ways[key] if way.blockers <= set(order[:position]))
        for blocker, reason in way.reasons.items():
            found.setdefault(blocker, f"{reason} {object_name(key)}")
    return found


class _Asked:
    """What one grasp meets."""

    def __init__(
        self,
        arm: Arm,
        prediction: Prediction,
        bodies: Sequence[CollisionBody],
        settings: PickSettings,
        target: CollisionBody,
        pose: Float[np.ndarray, "4 4"],
        opening: float,
        width: float,
    ) -> None:
        self._arm, self._gripper, self._bodies = arm, prediction.gripper, bodies
        self._settings, self._pose = settings, pose
        self._instances = {body.name: body.instance for body in bodies if body.instance != NO_INSTANCE}
        beside = frozenset({Meeting(HAND, target.name)}) if target.from_points else frozenset()
        self._open = CollisionChecker(arm, prediction.gripper, bodies, Load(opening, opening, untested=beside))
        carried = target if settings.check_carried else None
        self._load = Load(
            width,
            width,
            carried=carried,
            T_base_gripped=pose,
            absent=frozenset({target.name}),
            padding=settings.carried_margin,
        )
        self._holding = CollisionChecker(arm, prediction.gripper, bodies, self._load)

    def way(self, joints: Float[np.ndarray, "j"]) -> Way | None:
        """What must be taken away for these joint positions at the grasp; None if that does not help."""
        reasons: dict[int, str] = {}
        back = straight_line(self._arm, joints, -self._settings.approach * self._pose[:3, 2])
        if len(back) <= line_steps(self._settings.approach):
            return None
        for position in back:
            if not self._note(self._open.meetings(position) if self._open.collides(position) else (), reasons):
                return None
        best: dict[int, str] | None = None
        for direction in lift_ways(self._arm, self._pose):
            lifted = straight_line(self._arm, joints, self._settings.lift * direction)
            if len(lifted) <= line_steps(self._settings.lift):
                continue
            own = dict(reasons)
            if self._lift(lifted, own) and (best is None or len(own) < len(best)):
                best = own
        return None if best is None else Way(frozenset(best), best)

    def _lift(self, line: Float[np.ndarray, "n j"], reasons: dict[int, str]) -> bool:
        """Notes what is in the way of lifting; False if that cannot be taken away."""
        at_first = {each for each in self._holding.meetings(line[0]) if each.part == CARRIED}
        for position in line[1:-1]:
            if self._holding.collides(position):
                met = [each for each in self._holding.meetings(position) if each not in at_first]
                if not self._note(met, reasons):
                    return False
        if not self._note(pressed(self._arm, self._gripper, self._bodies, self._load, line, at_first), reasons):
            return False
        # What it still touches when it has been lifted lies on it, or holds it.
        return self._note(self._holding.meetings(line[-1]) if self._holding.collides(line[-1]) else (), reasons)

    def _note(self, meetings: Iterable[Meeting], reasons: dict[int, str]) -> bool:
        """Notes which objects are met; False if anything else is."""
        for each in meetings:
            instance = self._instances.get(each.body)
            if instance is None:
                return False
            if each.part == CARRIED:
                reasons.setdefault(instance, "lies on or over")
            else:
                reasons.setdefault(instance, f"is in the way of the {each.part} at")
        return True
