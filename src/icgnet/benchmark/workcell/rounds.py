"""One round in the workcell: look, plan, pick, until the table is empty or nothing more comes of it.

Paper: "Real World Experiments".
"""

import time
from collections import Counter
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.fetch import FetchPlan, plan_fetch
from icgnet.arm.hand_eye import HandEye
from icgnet.arm.pick import plan_pick
from icgnet.arm.plan import PickPlan
from icgnet.arm.replay import Replay, replay
from icgnet.arm.settings import PickSettings
from icgnet.benchmark.config import NOTHING_FOUND, WorkcellConfig
from icgnet.benchmark.planners.oracle import held_grasps
from icgnet.benchmark.target import occlusions
from icgnet.benchmark.workcell.eyes import TRIED, Eyes, Look, instance_under, open_eyes, take_look, true_object
from icgnet.benchmark.workcell.station import BOX, CAMERA, Station, command_of, misplaced, standing_arm
from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import NO_INSTANCE, Prediction
from icgnet.objects.kinds import WIDE_KINDS
from icgnet.objects.object_set import ObjectSet
from icgnet.objects.pool import ObjectPool
from icgnet.sensors.wide import Picture
from icgnet.simulation.config import WideScenes
from icgnet.simulation.furniture import EDGE, FLOOR
from icgnet.simulation.robot_cell import NO_TARGET, PHASE_OF, TIMESTEP, Carried, PickCause, RobotCell
from icgnet.simulation.scene import BACKGROUND, TABLE, Scene
from icgnet.simulation.scenes import spawn_scene
from icgnet.simulation.surroundings import BIN_WALL, ENDLESS

COUNTS = (3, 6)
"""Objects of a scene, as on the paper's robot."""
WIDE = WideScenes(
    objects=COUNTS,
    table_edge=(0.36, 0.5),
    bin_edge=(0.28, 0.4),
    bin_height=(0.05, 0.12),
    longest=(0.02, 0.2),
    stored=0.0,
)
"""Tables and bins that the arm can reach all over."""
KEPT = (BIN_WALL, EDGE, FLOOR)
"""What is left of the things around tables and bins: where the others might stand, there is the arm."""
FAILURES_IN_A_ROW, EMPTY_IN_A_ROW = 2, 5
"""A round ends with so many failed picks, or so many pictures without a pick, one after the other."""
SCENE, HAND_EYE, CAMERA_DRAWS, PLANNER, POOL, TARGET = range(6)
"""What a random stream is for."""
DRAWS = 20
"""Scenes that are drawn until one has enough objects."""


@dataclass(frozen=True)
class Sight:
    """One picture, and what it led to.

    Attributes:
        view: number of the place that it was taken from.
        objects: objects that were there.
        found: objects that were found; None if nothing could be made of the picture.
        grasps: grasps to plan with.
        see_seconds: time from the picture to objects and grasps.
        plan_seconds: time of planning for the arm.
        refused: grasps that cannot be carried out, by reason.
    """

    view: int
    objects: int
    found: int | None
    grasps: int
    see_seconds: float
    plan_seconds: float
    refused: dict[str, int]


@dataclass(frozen=True)
class PickAttempt(Sight):
    """One pick that was carried out, and the picture that it was planned on. Lengths in [m], forces in [N].

    Attributes:
        target: name of the object that it was for; table or structure if it was for none.
        target_class: its class.
        wanted: whether it is the object that is to be fetched; always False where any will do.
        score: of the grasp.
        pose: T_world_grasp as it was planned.
        success: the object is in the box.
        cause: how it ended.
        phase: in which it failed; empty if it did not.
        removed: names of what came into the box.
        lost: names of what left the workspace otherwise.
        touched: names of what arm and hand touched other than the target.
        displaced: names of other objects that were moved.
        carried: whether the target was lifted.
        hit: names of what it met on its way.
        hit_force: how hard, at most.
        hit_depth: how deep, at most.
        cycle_seconds: time of the motion, simulated.
        tracking: largest error of a joint [rad].
        kept: whether the plan keeps its promises when it is played back at 1 ms.
        replay_depth: how deep anything is in something else then.
    """

    target: str
    target_class: str
    wanted: bool
    score: float
    pose: list[list[float]]
    success: bool
    cause: str
    phase: str
    removed: list[str]
    lost: list[str]
    touched: list[str]
    displaced: list[str]
    carried: bool
    hit: list[str]
    hit_force: float
    hit_depth: float
    cycle_seconds: float
    tracking: float
    kept: bool
    replay_depth: float


@dataclass(frozen=True)
class WorkcellRound:
    """What happened to one scene.

    Attributes:
        round: its number.
        strategy: "clear"; or of a fetch, "order" or "highest".
        placed: objects at the start.
        left: objects at the end.
        attempts: the picks.
        empty: pictures without one.
        move_seconds: time of the movements between places to look from, simulated.
        target: name of the object to fetch; None where any will do.
        fetched: whether it came into the box.
        blocked: how many objects the first plan says are in its way; None if it was not found, or had no order.
        reasons: what each of them is in the way of.
        commit: the source that played it.
    """

    round: int
    strategy: str
    placed: int
    left: int
    attempts: list[PickAttempt]
    empty: list[Sight]
    move_seconds: float
    target: str | None = None
    fetched: bool = False
    blocked: int | None = None
    reasons: list[str] | None = None
    commit: str | None = None


@dataclass(frozen=True)
class WorkcellJob:
    """Everything that a worker must know to play any round; arm and network are made in the worker."""

    config: WorkcellConfig
    pool: ObjectSet
    gripper: Gripper
    commit: str | None = None

    def make(self, number: int) -> list[WorkcellRound]:
        """What is played with the scene of this number: once, or a fetch by both strategies."""
        arm, eyes = tools_of(self.config, self.gripper)
        strategies = ("order", "highest") if self.config.fetch else ("clear",)
        return [_Game(self, number, arm, eyes, strategy).play() for strategy in strategies]

    def name(self, number: int) -> str:
        """How messages call a round."""
        return f"round {number} (seed {self.config.seed})"

    def stream(self, *purpose: int) -> np.random.Generator:
        """The random stream of a purpose; scenes, cameras and planners do not share any."""
        return np.random.default_rng(np.random.SeedSequence(self.config.seed, spawn_key=purpose))


_tools: dict[WorkcellConfig, tuple[Arm, Eyes]] = {}


def tools_of(config: WorkcellConfig, gripper: Gripper) -> tuple[Arm, Eyes]:
    """Arm and eyes of a benchmark, which a process keeps.

    Raises:
        IcgnetError: an arm or weights that cannot be used.
    """
    if config not in _tools:
        _tools[config] = standing_arm(config.arm), open_eyes(config, gripper)
    return _tools[config]


def draw_pool(config: WorkcellConfig, objects: ObjectSet) -> ObjectSet:
    """The set with so many of its objects for these scenes as the pool shall have, drawn once for all rounds.

    Raises:
        InputError: it has none for these scenes.
    """
    names = objects.names(config.scene, config.split)
    if not names:
        raise InputError(f"object set {objects.name!r} has no objects for {config.scene} in split {config.split!r}")
    rng = np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(POOL,)))
    return ObjectPool(objects, [names[i] for i in rng.permutation(len(names))[: config.pool]])


def workcell_scene(job: WorkcellJob, number: int) -> Scene:
    """The scene of a round, with at least as many objects as the fewest; the same for every planner.

    Raises:
        InputError: none of many draws has.
    """
    config, rng = job.config, job.stream(number, SCENE)
    for _ in range(DRAWS):
        count = int(rng.integers(COUNTS[0], COUNTS[1] + 1))
        scene = spawn_scene(config.scene, job.pool, config.split, rng, count, wide=WIDE)
        if len(scene.objects) >= COUNTS[0]:
            structures = tuple(each for each in scene.surroundings.structures if each.name in KEPT)
            kept = replace(scene.surroundings, structures=structures) if config.scene in WIDE_KINDS else ENDLESS
            return replace(scene, surroundings=kept)
    raise InputError(f"{job.name(number)}: none of {DRAWS} scenes has {COUNTS[0]} objects that stay on the support")


class _Game:
    """One round by one strategy."""

    def __init__(self, job: WorkcellJob, number: int, arm: Arm, eyes: Eyes, strategy: str) -> None:
        self.job, self.number, self.eyes, self.strategy = job, number, eyes, strategy
        self.scene = workcell_scene(job, number)
        self.station = Station(arm, job.gripper, self.scene.surroundings)
        self.view, self.pictures, self.moving = 0, 0, 0.0
        self.in_box: set[int] = set()
        start = self.station.views[0]
        self.cell = RobotCell(self.scene, job.pool, job.gripper, self.station.model, BOX, start)
        config = job.config
        believed = misplaced(self.station.T_mount_camera, job.stream(number, HAND_EYE))
        self.T_mount_believed = believed if config.hand_eye_error else self.station.T_mount_camera
        self.settings = PickSettings(obstacles=config.obstacles, check_carried=config.attached_check)
        self.fixtures = (self.station.box, *(self.station.walls if eyes.knows_walls else ()))
        self.target = self._draw_target() if strategy != "clear" else NO_TARGET
        self.names = [placed.name for placed in self.scene.objects]
        self.first_plan: FetchPlan | None = None

    def play(self) -> WorkcellRound:
        """Everything from the first picture on."""
        cell, target = self.cell, self.target
        placed = len(cell.remaining)
        attempts: list[PickAttempt] = []
        empty: list[Sight] = []
        failures = nothing = 0
        while len(cell.remaining) and failures < FAILURES_IN_A_ROW and nothing < EMPTY_IN_A_ROW:
            seen = self._take_turn()
            if isinstance(seen, PickAttempt):
                attempts.append(seen)
                failures, nothing = (0 if seen.success else failures + 1), 0
            else:
                empty.append(seen)
                nothing += 1
                self._look_elsewhere()
            if target != NO_TARGET and target not in cell.remaining:
                break
        first = self.first_plan
        reasons = None if first is None else [f"{key}: {why}" for key, why in first.reasons.items()]
        return WorkcellRound(
            round=self.number,
            strategy=self.strategy,
            placed=placed,
            left=len(cell.remaining),
            attempts=attempts,
            empty=empty,
            move_seconds=self.moving,
            target=None if target == NO_TARGET else self.names[target],
            fetched=target in self.in_box,
            blocked=None if first is None or not first.order else len(first.order) - 1,
            reasons=reasons,
            commit=self.job.commit,
        )

    def _draw_target(self) -> int:
        """Of the objects that the hand can hold alone but not among the others, the one of which they hide most.

        Hidden in the picture from the first place; of all objects, if there is none such. It does not depend on who
        looks.
        """
        scene, pool, gripper, rng = self.scene, self.job.pool, self.job.gripper, self.job.stream(self.number, TARGET)
        look = self._look(rng)
        hidden = occlusions(Picture(look.image, CAMERA.intrinsics, look.T_world_camera), scene, pool)
        order = np.argsort(-np.nan_to_num(hidden, nan=-1.0), kind="stable").tolist()
        among_others = held_grasps(scene, pool, gripper, rng, 1, TRIED).objects
        for index in order:
            alone = replace(scene, objects=(scene.objects[index],))
            if index not in among_others and len(held_grasps(alone, pool, gripper, rng, 1, TRIED).objects):
                return index
        return order[0]

    def _look(self, rng: np.random.Generator) -> Look:
        """A picture from where the arm is now."""
        station, cell = self.station, self.cell
        T_world_mount = cell.hand_pose() @ invert_transform(station.arm.T_mount_grasp(station.gripper))
        believed = HandEye(T_tool_camera=self.T_mount_believed, joints=cell.joints()).pose(station.arm)
        T_world_camera = T_world_mount @ station.T_mount_camera
        noise = self.job.config.noise
        return take_look(cell.scene(), self.job.pool, T_world_camera, station.T_world_base @ believed, noise, rng)

    def _take_turn(self) -> Sight:
        """One picture, and the pick that comes of it, if any."""
        camera, draws = (self.job.stream(self.number, each, self.pictures) for each in (CAMERA_DRAWS, PLANNER))
        self.pictures += 1
        look = replace(self._look(camera), rng=draws)
        start = time.perf_counter()
        prediction = self.eyes.see(look, with_blocked=self.strategy == "order")
        if prediction is not None and self.job.config.obstacles == "shapes":
            for item in prediction.objects:
                item.mesh()  # shapes belong to seeing, whenever they are extracted
        seen = time.perf_counter()
        wanted = self._wanted(prediction, look)
        plan, refused = self._plan(prediction, wanted) if prediction is not None else (None, {})
        done = time.perf_counter()
        sight = {
            "view": self.view,
            "objects": len(look.scene.objects),
            "found": None if prediction is None else len(prediction.objects),
            "grasps": 0 if prediction is None else len(prediction.grasps),
            "see_seconds": seen - start,
            "plan_seconds": done - seen,
            "refused": refused,
        }
        if prediction is None or plan is None or plan.instance is None:
            return Sight(**sight)
        return self._carry_out(prediction, plan, look, sight)

    def _wanted(self, prediction: Prediction | None, look: Look) -> int:
        """The instance that is to be fetched: that with most of the pixels of the target in the true picture."""
        if prediction is None or self.target == NO_TARGET:
            return NO_INSTANCE
        return instance_under(prediction, look.image.ids == self.cell.remaining.tolist().index(self.target))

    def _plan(self, prediction: Prediction, wanted: int) -> tuple[PickPlan | None, dict[str, int]]:
        """The pick that the strategy chooses, None if there is none, and why grasps were refused."""
        place = (self.station.arm, self.station.T_base_world, self.station.drop)
        more: dict[str, Any] = {"start": self.station.views[self.view], "fixtures": self.fixtures}
        refused: Counter[str] = Counter()
        plan = None
        try:
            if wanted != NO_INSTANCE and self.strategy == "order":
                fetch = plan_fetch(prediction, *place, wanted, self.settings, **more)
                self.first_plan = self.first_plan or fetch
                plan = fetch.pick
            elif wanted != NO_INSTANCE:
                plan = plan_pick(prediction.of_instance(wanted), *place, self.settings, **more)
            if plan is not None:
                refused.update(plan.refused)
            if plan is None or not plan.is_found:
                plan = plan_pick(prediction, *place, self.settings, **more)
                refused.update(plan.refused)
        except InputError as error:  # the arm stands in what it believes to see
            refused[str(error)] += 1
        return plan, dict(refused)

    def _carry_out(self, prediction: Prediction, plan: PickPlan, look: Look, sight: dict[str, Any]) -> PickAttempt:
        """Plays the plan back, carries it out, and writes down what came of it."""
        assert plan.instance is not None
        assert plan.T_base_grasp is not None
        played = replay(plan, self.station.arm)
        owner = true_object(prediction, plan.instance, look.image.ids)
        target = int(self.cell.remaining[owner]) if owner >= 0 else NO_TARGET
        carried = self.cell.pick([command_of(phase, TIMESTEP) for phase in plan.phases], target)
        self.in_box |= set(carried.removed)
        grasps = prediction.of_instance(plan.instance).grasps
        poses = self.station.T_base_world @ grasps.poses
        # Turned by half a turn about its approach it is the same grasp.
        nearest = int(np.abs(poses[:, :3, 2:] - plan.T_base_grasp[:3, 2:]).sum(axis=(1, 2)).argmin())
        return self._attempt(sight, plan, carried, target, owner, float(grasps.scores[nearest]), played)

    def _attempt(
        self,
        sight: dict[str, Any],
        plan: PickPlan,
        carried: Carried,
        target: int,
        owner: int,
        score: float,
        played: Replay,
    ) -> PickAttempt:
        """What is written down of a pick."""
        names = {**dict(enumerate(self.names)), TABLE: "table", BACKGROUND: "structure", NO_TARGET: "nothing"}
        told = names[target if target != NO_TARGET else owner]
        T_world_grasp: Float[np.ndarray, "4 4"] = self.station.T_world_base @ plan.T_base_grasp

        def named(which: tuple[int, ...]) -> list[str]:
            return [names[each] for each in which]

        return PickAttempt(
            **sight,
            target=told,
            target_class=self.job.pool.class_name(told) if target != NO_TARGET else "",
            wanted=target != NO_TARGET and target == self.target,
            score=score,
            pose=T_world_grasp.tolist(),
            success=carried.success,
            cause=carried.cause.value,
            phase="" if carried.success or carried.cause is PickCause.UNSTABLE else PHASE_OF[carried.cause],
            removed=named(carried.removed),
            lost=named(carried.lost),
            touched=named(carried.touched),
            displaced=named(carried.displaced),
            carried=carried.carried,
            hit=named(carried.hit),
            hit_force=carried.hit_force,
            hit_depth=carried.hit_depth,
            cycle_seconds=carried.seconds,
            tracking=carried.tracking,
            kept=played.is_kept,
            replay_depth=played.depth,
        )

    def _look_elsewhere(self) -> None:
        """Goes to the next place to look from that can be reached from here."""
        views = self.station.views
        for step in range(1, len(views)):
            number = (self.view + step) % len(views)
            phase = self.station.move(views[self.view], views[number])
            if phase is not None:
                self.moving += self.cell.move(command_of(phase, TIMESTEP))
                self.view = number
                return


def nothing_found(sight: Sight) -> str:
    """Why a picture led to no pick, in a few words."""
    if sight.found is None or sight.found == 0:
        return f"{NOTHING_FOUND}: no object"
    if sight.grasps == 0:
        return f"{NOTHING_FOUND}: no grasp"
    return f"{NOTHING_FOUND}: no grasp that the arm can carry out"
