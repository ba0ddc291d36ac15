"""From a prediction to a plan: the best grasp that the arm can reach, carry away and let go of, meeting nothing.

Grasps are tried in their order. For each, cheap questions come first: joint positions, straight lines, a place to let
go; then ways between them; then the trajectories, which are tested once more, finely enough that nothing is missed.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.bodies import CollisionBody, bodies_of, is_over_support, object_name
from icgnet.arm.kinematics import Solver, line_steps, make_solver, straight_line
from icgnet.arm.parting import pressed
from icgnet.arm.paths import PathFinder
from icgnet.arm.plan import Phase, PickPlan, Refusal
from icgnet.arm.scene import CARRIED, HAND, CollisionChecker, Load, Meeting
from icgnet.arm.settings import DEFAULT_PICK, FARTHEST_BACK, HIGHEST_LIFT, PickSettings
from icgnet.arm.timing import NoTrajectoryError, Timing, Trajectory, still, timing_of
from icgnet.errors import InputError
from icgnet.geometry.arrays import position
from icgnet.geometry.transforms import check_pose, invert_transform, make_transform, rotation_z, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.budget import Budget, Clock
from icgnet.inference.prediction import Prediction

HALF_TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
"""A parallel-jaw hand turned by this about its approach takes the same grasp."""
MOST_REACHES, MOST_DROPS, MOST_WAYS = 6, 24, 2
"""So many joint positions are asked for collisions for a grasp and for a place to let go, and so many ways are looked
for."""
DROP_TURNS = 8
"""In so many directions about the vertical an object may be let go of."""
DEVIATIONS = (0.1, 0.02, 0.0)
"""How far rounded corners may be from the waypoints of a way [rad]: the next one where the first meets something."""
LINE_DEVIATION = 0.002
CLEARANCE_TRAVEL = 0.005
"""Clearances are those at positions between which no point moves farther than this [m]."""
SAME_WAY = 0.9999
"""Cosine from which on two directions are one: 0.8 degrees."""
UNSEEN = 0.0005
"""How deep things may meet between two positions that were tested [m], at most."""
FINGER_SPEED = 0.1
"""Of the finger tips, against each other [m/s]."""
STAND_OFF = 0.002
"""Height at which an object is let go of above what it shall stand on [m]."""

NO_BODY, NO_IK = "neither shape nor points", "no joint positions"
NO_REACH, NO_LINE, NO_LIFT = "no way to the object", "no straight way in", "no straight way up"
NO_DROP, NO_CARRY, NO_LOWER = "drop-off out of reach", "no way to the drop-off", "no straight way down"
NO_LEAVE, NO_RETURN = "no straight way out", "no way back"
NO_TIME = "no time left to try it"


def plan_pick(
    prediction: Prediction,
    arm: Arm,
    T_base_frame: Any,
    drop: Any,
    settings: PickSettings = DEFAULT_PICK,
    start: Any = None,
    fixtures: Sequence[CollisionBody] = (),
) -> PickPlan:
    """A plan for the first grasp of a prediction that can be carried out.

    Args:
        prediction: what was found; its grasps are tried in their order.
        arm: the arm; its hand is that of the prediction.
        T_base_frame: pose of the prediction's frame in that of the arm's base.
        drop: [3] where the object is let go of, in the frame of the base [m]: its lowest point is then at this height,
            or above it (`PickSettings.drop_above`), and its middle above this place.
        settings: how to plan.
        start: joint positions from which the arm starts and to which it returns [rad]; home if None.
        fixtures: what always stands there whether it is seen or not, in the frame of the base: the drop-off box.

    Returns:
        The plan, with the reasons for which better grasps were refused; without phases if all were.

    Raises:
        InputError: a pose or a place that is none, a drop-off inside of the support, or an arm that meets something
            where it starts.
    """
    planner = _Planner(
        prediction,
        arm,
        check_pose(T_base_frame, "T_base_frame"),
        position(drop, "drop"),
        settings,
        arm.home if start is None else arm.check_joints(start, "start"),
        tuple(fixtures),
    )
    return planner.plan()


class _RefusedError(Exception):
    """A grasp cannot be carried out; the argument says why.

    Attributes:
        anyhow: whether other joint positions at the same grasp would be refused as well: hand and carried object go
            the same way with all of them.
    """

    def __init__(self, reason: str, anyhow: bool = False) -> None:
        super().__init__(reason)
        self.anyhow = anyhow

    @staticmethod
    def by(meeting: Meeting) -> "_RefusedError":
        """The refusal for what meets what."""
        return _RefusedError(_told(meeting), meeting.part in (HAND, CARRIED))


@dataclass(frozen=True, eq=False)
class _Reach:
    """How a grasp is reached and left: joint positions at the grasp, on the line before it and on the line after it.

    Both lines begin at the grasp. `lifting` is what the hand holds on the second one, which may still touch what the
    object stands at.
    """

    joints: Float[np.ndarray, "j"]
    back: Float[np.ndarray, "n j"]
    lift: Float[np.ndarray, "m j"]
    lifting: Load


class _Planner:
    """Everything that is the same for all grasps of one pick."""

    def __init__(
        self,
        prediction: Prediction,
        arm: Arm,
        T_base_frame: Float[np.ndarray, "4 4"],
        drop: Float[np.ndarray, "3"],
        settings: PickSettings,
        start: Float[np.ndarray, "j"],
        fixtures: tuple[CollisionBody, ...],
    ) -> None:
        self.clock, self.budget = Clock(), Budget(settings.budget_ms)
        self.arm, self.gripper, self.settings = arm, prediction.gripper, settings
        self.grasps = prediction.grasps.transformed(T_base_frame)
        drop = _let_go_at(drop, prediction, T_base_frame, settings.drop_above)
        self.drop, self.start = drop, start
        away = float(np.linalg.norm(drop - arm.shoulder))
        reach = float(arm.reaches[0] + np.linalg.norm(arm.T_mount_grasp(self.gripper)[:3, 3]))
        if away > reach:
            raise InputError(
                f"drop is {away:.2f} m from the first joint of the arm, which reaches {reach:.2f} m at most"
            )
        self.bodies = (*bodies_of(prediction, T_base_frame, settings.obstacles), *fixtures)
        self.solver: Solver = make_solver(arm)
        self.timing = timing_of(arm)
        self.checkers: dict[tuple[object, ...], CollisionChecker] = {}
        self.rng = np.random.default_rng(settings.seed)
        self.clock.lap("bodies")

    def plan(self) -> PickPlan:
        """The plan, see `plan_pick`.

        Raises:
            InputError: the arm meets something where it starts.
        """
        opened = Load(self.gripper.max_opening, self.gripper.max_opening)
        meetings = self._checker(opened).meetings(self.start, self.settings.margin)
        if meetings:
            raise InputError(
                f"start: the arm must be at least {self.settings.margin:g} m from everything, but its "
                f"{meetings[0].part} meets {meetings[0].body}"
            )
        refusals: list[Refusal] = []
        for index in range(min(len(self.grasps), self.settings.most_grasps)):
            instance = int(self.grasps.instances[index])
            if index > 0 and self.budget.is_spent():
                refusals.append(Refusal(index, instance, NO_TIME))
                continue
            try:
                T_base_grasp, phases = self._try(index, instance)
            except _RefusedError as refused:
                refusals.append(Refusal(index, instance, str(refused)))
            else:
                return self._result(index, instance, T_base_grasp, phases, refusals)
        return self._result(None, None, None, (), refusals)

    def _result(
        self,
        grasp: int | None,
        instance: int | None,
        T_base_grasp: Float[np.ndarray, "4 4"] | None,
        phases: tuple[Phase, ...],
        refusals: list[Refusal],
    ) -> PickPlan:
        return PickPlan(
            arm=self.arm.name,
            joint_names=self.arm.joint_names,
            gripper=self.gripper,
            grasp=grasp,
            instance=instance,
            T_base_grasp=T_base_grasp,
            phases=phases,
            refusals=tuple(refusals),
            timings_ms=self.clock.laps_ms,
            bodies=self.bodies,
        )

    def _checker(self, load: Load, extra: Sequence[CollisionBody] = ()) -> CollisionChecker:
        key = (load.key, *extra)
        if key not in self.checkers:
            self.checkers[key] = CollisionChecker(self.arm, self.gripper, (*self.bodies, *extra), load)
        return self.checkers[key]

    def _try(self, index: int, instance: int) -> tuple[Float[np.ndarray, "4 4"], tuple[Phase, ...]]:
        """The phases for one grasp.

        Raises:
            _RefusedError: it cannot be carried out.
        """
        pose = self.grasps.poses[index]
        opening = float(min(self.grasps.openings[index], self.gripper.max_opening))
        width = float(min(self.grasps.widths[index], opening))
        target = next((body for body in self.bodies if body.name == object_name(instance)), None)
        if target is None:
            raise _RefusedError(NO_BODY)
        # Cubes around its points reach between the fingers.
        beside = frozenset({Meeting(HAND, target.name)})
        opened = Load(opening, opening, untested=beside if target.from_points else frozenset())
        checker = self._checker(opened)
        reaches: list[tuple[Float[np.ndarray, "4 4"], Load, _Reach]] = []
        reasons: list[str] = []
        for T_base_grasp in (pose, pose @ HALF_TURN):
            holding = Load(
                width,
                width,
                carried=target if self.settings.check_carried else None,
                T_base_gripped=T_base_grasp,
                absent=frozenset({target.name}),
                padding=self.settings.carried_margin,
            )
            reach = self._reach(T_base_grasp, checker, holding, reasons)
            if reach is not None:
                reaches.append((T_base_grasp, holding, reach))
        self.clock.lap("grasp")
        for T_base_grasp, holding, reach in reaches:
            try:
                return T_base_grasp, self._phases(reach, T_base_grasp, target, opened, holding, checker)
            except _RefusedError as refused:
                reasons.append(str(refused))
        raise _RefusedError(_farthest(reasons))

    def _reach(
        self, T_base_grasp: Float[np.ndarray, "4 4"], opened: CollisionChecker, holding: Load, reasons: list[str]
    ) -> _Reach | None:
        """How a grasp is reached and left by the first joint positions that can; None, and why not, if none can."""
        for joints in self._free_joints(T_base_grasp, opened, reasons):
            try:
                return self._lines(joints, T_base_grasp, opened, holding)
            except _RefusedError as refused:
                reasons.append(str(refused))
                if refused.anyhow:
                    break
        return None

    def _free_joints(
        self, T_base_grasp: Float[np.ndarray, "4 4"], checker: CollisionChecker, reasons: list[str]
    ) -> Iterator[Float[np.ndarray, "j"]]:
        """Joint positions at a grasp that meet nothing, those nearest to home first."""
        T_base_mount = T_base_grasp @ invert_transform(self.arm.T_mount_grasp(self.gripper))
        solutions = self.solver.solutions(T_base_mount)
        if not len(solutions):
            reasons.append(NO_IK)
        for joints in apart(solutions, MOST_REACHES):
            if checker.collides(joints):
                reasons.append(_told(checker.meetings(joints)[0]))
            else:
                yield joints

    def _lines(
        self,
        joints: Float[np.ndarray, "j"],
        T_base_grasp: Float[np.ndarray, "4 4"],
        opened: CollisionChecker,
        holding: Load,
    ) -> _Reach:
        """The straight lines before and after a grasp.

        Raises:
            _RefusedError: there are none.
        """
        settings = self.settings
        back = straight_line(self.arm, joints, -FARTHEST_BACK * T_base_grasp[:3, 2])
        back = self._free_part(back, opened, settings.approach, NO_LINE)
        lifting, full = self._lifting(joints, holding), self._checker(holding)
        refused: _RefusedError | None = None
        for way in lift_ways(self.arm, T_base_grasp):
            lift = straight_line(self.arm, joints, HIGHEST_LIFT * way)
            try:
                lift = self._free_part(lift, self._checker(lifting), settings.lift, NO_LIFT, full)
                _check_parting(lift, full)
                for meeting in pressed(self.arm, self.gripper, self.bodies, holding, lift, lifting.untested):
                    raise _RefusedError.by(meeting)
            except _RefusedError as again:
                # That it cannot be lifted says more than that it cannot be drawn back.
                refused = _RefusedError(str(refused), refused.anyhow and again.anyhow) if refused else again
            else:
                return _Reach(joints, back, lift, lifting)
        raise refused or _RefusedError(NO_LIFT)

    def _free_part(
        self,
        line: Float[np.ndarray, "n j"],
        checker: CollisionChecker,
        least: float,
        reason: str,
        at_end: CollisionChecker | None = None,
    ) -> Float[np.ndarray, "m j"]:
        """The shortest beginning of a line that meets nothing and ends with room around it.

        Args:
            line: joint positions.
            checker: what must not meet on the line.
            least: length [m].
            reason: of the refusal if the line itself is too short.
            at_end: what must have room at the end; the same if None.

        Raises:
            _RefusedError: there is none.
        """
        steps = line_steps(least)
        if len(line) <= steps:
            raise _RefusedError(reason)
        met = checker.first_collision(line)
        if met is not None and met <= steps:
            raise _RefusedError.by(checker.meetings(line[met])[0])
        at_end, margin = at_end or checker, self.settings.margin
        for last in range(steps, len(line) if met is None else met):
            if not at_end.collides(line[last], margin):
                return line[: last + 1]
        raise _RefusedError.by(at_end.meetings(line[steps], margin)[0])

    def _lifting(self, joints: Float[np.ndarray, "j"], holding: Load) -> Load:
        """The load while it is lifted.

        What the object meets already where it stands (the support, neighbours that lean on it) it may touch, and from
        what it is near to there it need not keep away.
        """
        if holding.carried is None:
            return holding

        def met(load: Load) -> frozenset[Meeting]:
            return frozenset(each for each in self._checker(load).meetings(joints) if each.part == CARRIED)

        return replace(holding, untested=met(replace(holding, padding=0.0)), unpadded=met(holding))

    def _phases(
        self,
        reach: _Reach,
        T_base_grasp: Float[np.ndarray, "4 4"],
        target: CollisionBody,
        opened: Load,
        holding: Load,
        checker: CollisionChecker,
    ) -> tuple[Phase, ...]:
        """All phases from and to the start.

        Raises:
            _RefusedError: one is not possible.
        """
        carry_checker = self._checker(holding)
        drops = self._drops(reach.lift[-1], T_base_grasp, target, holding)
        self.clock.lap("drop-off")
        there = self._way(self.start, reach.back[-1], checker, NO_REACH)
        carry, lowered = self._carry(reach.lift[-1], drops, carry_checker)
        self.clock.lap("ways")
        closing = Load(holding.low, opened.high, untested=frozenset({Meeting(HAND, target.name)}))
        phases = [
            self._moving("reach", there, opened, NO_REACH),
            self._moving("approach", reach.back[::-1], opened, NO_LINE, straight=True),
            self._fingers("close", reach.joints, closing, holding.low),
            self._moving("lift", reach.lift, reach.lifting, NO_LIFT, straight=True),
            self._moving("carry", carry, holding, NO_CARRY),
        ]
        if self.settings.release == "place":
            phases.append(self._moving("lower", lowered, replace(holding, padding=0.0), NO_LOWER, straight=True))
        self.clock.lap("trajectories")
        return (*phases, *self._letting_go(lowered[-1], opened.high, holding))

    def _letting_go(self, released: Float[np.ndarray, "j"], opening: float, holding: Load) -> list[Phase]:
        """The phases from the release on: the hand opens fully, or as it came if it would meet something then.

        Args:
            released: joint positions at which the object is let go of.
            opening: between the finger tips before the grasp [m].
            holding: what the hand holds.

        Raises:
            _RefusedError: one is not possible with either opening.
        """
        placing = self.settings.release == "place"
        left = [self._placed(released, holding)] if placing and holding.carried is not None else []
        refused = _RefusedError(NO_RETURN)
        for wide in dict.fromkeys((self.gripper.max_opening, opening)):
            after = Load(wide, wide, absent=holding.absent)
            leaving = replace(after, untested=frozenset({Meeting(HAND, body.name) for body in left}))
            try:
                phases = [self._fingers("release", released, replace(leaving, low=holding.low), wide, left)]
                out = released[None]
                if placing:
                    T_base_released = self.arm.grasp_pose(released, self.gripper)
                    line = straight_line(self.arm, released, -FARTHEST_BACK * T_base_released[:3, 2])
                    free, clear = self._checker(leaving, left), self._checker(after, left)
                    out = self._free_part(line, free, self.settings.approach, NO_LEAVE, clear)
                    phases.append(self._moving("leave", out, leaving, NO_LEAVE, left, straight=True))
                home = self._way(out[-1], self.start, self._checker(after, left), NO_RETURN)
                self.clock.lap("ways")
                phases.append(self._moving("return", home, after, NO_RETURN, left))
                self.clock.lap("trajectories")
            except _RefusedError as again:
                refused = again
            else:
                return phases
        raise refused

    def _drops(
        self,
        lifted: Float[np.ndarray, "j"],
        T_base_grasp: Float[np.ndarray, "4 4"],
        target: CollisionBody,
        holding: Load,
    ) -> list[Float[np.ndarray, "_ j"]]:
        """Lines down to joint positions at which the object can be let go of, of one point where it is dropped.

        Those nearest to where the object was lifted to come first.

        Raises:
            _RefusedError: there are none.
        """
        placing = self.settings.release == "place"
        checker, lowering = self._checker(holding), self._checker(replace(holding, padding=0.0))
        T_grasp_mount = invert_transform(self.arm.T_mount_grasp(self.gripper))
        outline = transform_points(invert_transform(T_base_grasp), np.asarray(target.mesh.vertices, float))
        level = self.arm.description.T_world_base[:3, :3]
        found = []
        for angle in 2 * np.pi * np.arange(DROP_TURNS) / DROP_TURNS:
            above = make_transform(level.T @ rotation_z(angle) @ level @ T_base_grasp[:3, :3], np.zeros(3))
            points = outline @ (level @ above[:3, :3]).T
            lower, upper = points.min(axis=0), points.max(axis=0)
            offset = np.array([*(lower + upper)[:2] / 2, lower[2] - STAND_OFF * placing])
            above[:3, 3] = self.drop - level.T @ offset + placing * self.settings.lift * self.arm.up
            found.append(self.solver.solutions(above @ T_grasp_mount))
        joints = np.concatenate(found)
        if not len(joints):
            raise _RefusedError(NO_DROP)
        order = np.argsort(np.abs(joints - lifted).max(axis=1), kind="stable")
        lines, reasons = [], []
        for each in apart(joints[order], MOST_DROPS):
            line = each[None]
            if checker.collides(each, self.settings.margin):
                reasons.append(_told(checker.meetings(each, self.settings.margin)[0]))
                continue
            if placing:
                line = straight_line(self.arm, each, -self.settings.lift * self.arm.up)
                if len(line) <= line_steps(self.settings.lift):
                    reasons.append(NO_LOWER)
                    continue
                met = lowering.first_collision(line)
                if met is not None:
                    reasons.append(_told(lowering.meetings(line[met])[0]))
                    continue
            lines.append(line)
            if len(lines) == MOST_WAYS:
                break
        if not lines:
            raise _RefusedError(f"at the drop-off: {_farthest(reasons)}")
        return lines

    def _placed(self, released: Float[np.ndarray, "j"], holding: Load) -> CollisionBody:
        """The carried object where it was put down."""
        assert holding.carried is not None
        assert holding.T_base_gripped is not None
        moved = self.arm.grasp_pose(released, self.gripper) @ invert_transform(holding.T_base_gripped)
        return replace(holding.carried, name="placed object", mesh=holding.carried.mesh.copy().apply_transform(moved))

    def _way(
        self, start: Float[np.ndarray, "j"], goal: Float[np.ndarray, "j"], checker: CollisionChecker, reason: str
    ) -> Float[np.ndarray, "n j"]:
        """Waypoints between two joint positions.

        Raises:
            _RefusedError: none were found.
        """
        way = PathFinder(checker, self.settings.margin, self.rng).find(start, goal)
        if way is None:
            raise _RefusedError(reason)
        return way

    def _carry(
        self, lifted: Float[np.ndarray, "j"], drops: list[Float[np.ndarray, "_ j"]], checker: CollisionChecker
    ) -> tuple[Float[np.ndarray, "n j"], Float[np.ndarray, "m j"]]:
        """Waypoints to the first place to let go of the object that can be reached, and the line down to it.

        Raises:
            _RefusedError: none can be.
        """
        finder = PathFinder(checker, self.settings.margin, self.rng)
        for line in drops:
            way = finder.find(lifted, line[0])
            if way is not None:
                return way, line
        raise _RefusedError(NO_CARRY)

    def _moving(
        self,
        name: str,
        way: Float[np.ndarray, "n j"],
        load: Load,
        reason: str,
        left: Sequence[CollisionBody] = (),
        straight: bool = False,
    ) -> Phase:
        """A phase along waypoints: its corners rounded as far as nothing is met, or a straight line of the hand.

        Raises:
            _RefusedError: it meets something even with sharp corners, or there is no trajectory along it.
        """
        settings, checker = self.settings, self._checker(load, left)
        deviations, speed, margin = DEVIATIONS, settings.speed, settings.margin
        if straight:
            deviations, speed, margin = (LINE_DEVIATION,), settings.line_speed, 0.0
        phase = timed_phase(name, self.timing, way, deviations, speed, load, checker, margin)
        if phase is None:
            raise _RefusedError(reason)
        return self._measured(replace(phase, extra=tuple(left)))

    def _fingers(
        self, name: str, joints: Float[np.ndarray, "j"], load: Load, end: float, left: Sequence[CollisionBody] = ()
    ) -> Phase:
        """A phase in which only the fingers move.

        Raises:
            _RefusedError: they meet something.
        """
        checker = self._checker(load, left)
        standing = still(joints, (load.high - load.low) / FINGER_SPEED)
        phase = checked_phase(name, standing, load, checker, 0.0)
        if phase is None:
            raise _RefusedError(_told(checker.meetings(joints)[0]))
        return self._measured(replace(phase, opening=end, extra=tuple(left)))

    def _measured(self, phase: Phase) -> Phase:
        """The phase with its clearance, if that is wanted."""
        if not self.settings.clearances:
            return phase
        checker = self._checker(phase.load, phase.extra)
        clearance, nearest = checker.clearance(phase.trajectory.samples(checker.reaches, CLEARANCE_TRAVEL))
        return replace(phase, clearance=clearance, nearest=nearest)


def _let_go_at(
    drop: Float[np.ndarray, "3"], prediction: Prediction, T_base_frame: Float[np.ndarray, "4 4"], above: float | None
) -> Float[np.ndarray, "3"]:
    """Where the lowest point of the object is when it is let go of: at the drop-off, or over one that lies lower.

    Raises:
        InputError: the drop-off is inside of the support, or below it and nobody said how high to fall from.
    """
    T_base_table = T_base_frame @ prediction.T_frame_table
    on_table = transform_points(invert_transform(T_base_table), drop[None])[0]
    depth = TABLE_HEIGHT - float(on_table[2])
    if depth <= 0.0:
        return drop
    message = f"drop must be above the support, but it is {depth:.3f} m below it"
    if above is None:
        raise InputError(f"{message}; for a box that stands lower, beside the support, give drop_above")
    if is_over_support(prediction, on_table[:2]):
        raise InputError(f"{message}, and not beside what is seen of it")
    on_table[2] = TABLE_HEIGHT + above
    return transform_points(T_base_table, on_table[None])[0]


def timed_phase(
    name: str,
    timing: Timing,
    way: Float[np.ndarray, "n j"],
    deviations: Sequence[float],
    speed: float,
    load: Load,
    checker: CollisionChecker,
    margin: float,
) -> Phase | None:
    """The phase along waypoints with the first rounding of corners that serves, see `checked_phase`; None if none does.

    Args:
        name: of the phase.
        timing: makes trajectories for the arm.
        way: waypoints [rad].
        deviations: how far rounded corners may be from the waypoints [rad], tried in this order.
        speed: share of the arm's largest velocities.
        load: what the hand holds.
        checker: of this load.
        margin: what must be kept from everything [m].
    """
    for deviation in deviations:
        try:
            trajectory = timing.along(way, deviation, speed)
        except NoTrajectoryError:
            continue
        phase = checked_phase(name, trajectory, load, checker, margin)
        if phase is not None:
            return phase
    return None


def checked_phase(
    name: str, trajectory: Trajectory, load: Load, checker: CollisionChecker, margin: float
) -> Phase | None:
    """The phase of a trajectory that keeps the limits of the joints and meets nothing; None if it does not.

    Between two of the positions that are tested no point moves farther than twice the margin and `UNSEEN`: whatever is
    met between them is met by less than that.
    """
    step = 2.0 * (margin + UNSEEN)
    samples = trajectory.samples(checker.reaches, step)
    kept = checker.arm.within_limits(samples) and checker.arm.within_limits(trajectory.positions)
    if not kept or not checker.is_free(samples, margin, step):
        return None
    return Phase(name, trajectory, load.high, load, margin)


def _check_parting(lift: Float[np.ndarray, "n j"], checker: CollisionChecker) -> None:
    """Makes sure that what the carried object touches at first it leaves for good.

    Raises:
        _RefusedError: it comes near it once more.
    """
    meets = [checker.collides(joints) for joints in lift]
    for index in range(1, len(lift)):
        if meets[index] and not meets[index - 1]:
            raise _RefusedError(_told(checker.meetings(lift[index])[0]))


def _farthest(reasons: list[str]) -> str:
    """The reason of the attempt that came farthest, which is the last that is more than missing joint positions."""
    return next((reason for reason in reversed(reasons) if reason != NO_IK), NO_IK)


def lift_ways(arm: Arm, T_base_grasp: Float[np.ndarray, "4 4"]) -> list[Float[np.ndarray, "3"]]:
    """Directions in which an object may be lifted, in the frame of the base: up, and back as the hand came."""
    back = -T_base_grasp[:3, 2]
    return [arm.up] if arm.up @ back > SAME_WAY else [arm.up, back]


def apart(joints: Float[np.ndarray, "n j"], most: int, least: float = 0.3) -> Float[np.ndarray, "m j"]:
    """The first joint positions, in their order and so many at most, that are not near to one before [rad]."""
    kept, left = [], joints
    while len(left) and len(kept) < most:
        kept.append(left[0])
        left = left[np.abs(left - left[0]).max(axis=1) >= least]
    return np.array(kept).reshape(-1, joints.shape[1])


def _told(meeting: Meeting) -> str:
    return f"{meeting.part} meets {meeting.body}"
