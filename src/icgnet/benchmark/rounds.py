"""One round of clutter removal: grasp everything away, with a new picture after each attempt.

Paper: "Experiments". The rules are those of the published benchmark code; docs/benchmark.md says where ours differ.
"""

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from icgnet.benchmark.config import WIDE, ClutterConfig, PlannerConfig, SceneConfig
from icgnet.benchmark.observation import Observation, observe
from icgnet.benchmark.planner import Plan, Planner
from icgnet.benchmark.planners.oracle import can_hold
from icgnet.benchmark.planners.registry import load_planner
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.grasping.gripper import Gripper
from icgnet.objects.kinds import WIDE_KINDS
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.config import WideScenes
from icgnet.simulation.scene import Scene
from icgnet.simulation.scenes import spawn_scene
from icgnet.simulation.workcell import PROTOCOLS, TABLE, Workcell

OBJECTS = 5  # tried for in every scene of the cube
WIDE_ATTEMPTS = 12  # that a round on a table or in a bin has at most
FAILURES_IN_A_ROW, SKIPS = 2, 3  # a round ends with so many failed attempts, or so many pictures without a grasp
SCENE, CAMERA, PLANNER, TARGET, HOLDABLE = range(5)  # what a random stream is for; each has its own


@dataclass(frozen=True)
class Shot:
    """One picture of a round: what stood there, and where the camera was; poses row by row, lengths in [m].

    Attributes:
        run: number of the run.
        round: number of the round in the run.
        attempt: number of the picture in the round; pictures in which nothing was found are counted, too.
        scene: names of the objects on the table.
        scales: factors on their meshes.
        object_poses: their T_world_object.
        camera: T_world_camera.
        stretches: further factors along the axes of the meshes; empty for none. The surroundings are those that the
            round's own random stream draws again, see `round_scene`.
    """

    run: int
    round: int
    attempt: int
    scene: list[str]
    scales: list[float]
    object_poses: list[list[list[float]]]
    camera: list[list[float]]
    stretches: list[list[float]] = field(default_factory=list, kw_only=True)


@dataclass(frozen=True)
class Attempt(Shot):
    """One grasp that was executed, and the picture that it was planned on.

    Attributes:
        pose: T_world_grasp.
        opening: of the hand while it approached.
        score: the planner's.
        success: by the protocol.
        cause: how it ended.
        target: name of the object that the grasp was for.
        target_class: its class.
        held: names of what the hand touched at the end.
        touched: names of what it touched other than the target, before it closed.
        lost: names of what left the workspace because of it.
        plan_seconds: time that the planner took.
    """

    pose: list[list[float]]
    opening: float
    score: float
    success: bool
    cause: str
    target: str
    target_class: str
    held: list[str]
    touched: list[str]
    lost: list[str]
    plan_seconds: float


@dataclass(frozen=True)
class Round:
    """What happened to one scene.

    Attributes:
        run: number of the run.
        round: number of the round in the run.
        placed: objects at the start.
        left: objects on the table at the end.
        attempts: the grasps, in their order.
        skipped: pictures in which the planner found nothing.
        commit: the source that played it; None if no commit is known to hold it.
        holdable: of the objects on a table or in a bin, those that the hand could hold if each stood alone where it is
            at the start; None where this was not asked.
        holdable_grasped: of these, those that were grasped away.
    """

    run: int
    round: int
    placed: int
    left: int
    attempts: list[Attempt]
    skipped: list[Shot]
    commit: str | None = None
    holdable: int | None = None
    holdable_grasped: int | None = None

    @property
    def successes(self) -> int:
        """Attempts that succeeded."""
        return sum(attempt.success for attempt in self.attempts)


@dataclass(frozen=True)
class ClutterJob:
    """Everything that a worker must know to play any round; the planner is made in the worker."""

    config: ClutterConfig
    object_set: ObjectSet
    gripper: Gripper
    commit: str | None = None

    def make(self, number: int) -> Round:
        """The round of this number; those of all runs are counted through."""
        run, index = divmod(number, self.config.rounds)
        return play_round(self, run, index, planner_of(self.config))

    def name(self, number: int) -> str:
        """How messages call a round."""
        run, index = divmod(number, self.config.rounds)
        return f"round {index} of run {run} (seed {self.config.seed})"

    def look(self, run: int, index: int, number: int, scene: Scene, with_truth: bool) -> Observation:
        """The picture of this number in a round, of what is on the table now."""
        config = self.config
        camera, draws = (random_stream(config, run, index, purpose, number) for purpose in (CAMERA, PLANNER))
        seen = observe(scene, self.object_set, config.view, config.noise, self.gripper, config.full_opening, camera)
        return replace(seen, rng=draws, truth=TrueShapes(scene, self.object_set) if with_truth else None)


_planners: dict[PlannerConfig, Planner] = {}


def planner_of(config: PlannerConfig, anew: bool = False) -> Planner:
    """The planner of a benchmark, which a process keeps, so that weights are read once and not for every round.

    Raises:
        IcgnetError: no such planner, or one that cannot be made.
    """
    if anew or config not in _planners:
        _planners[config] = load_planner(config)
    return _planners[config]


def random_stream(config: SceneConfig, run: int, index: int, *purpose: int) -> np.random.Generator:
    """The random stream of a purpose in a round; scenes, cameras and planners do not share any."""
    return np.random.default_rng(np.random.SeedSequence(config.seed, spawn_key=(run, index, *purpose)))


def round_scene(config: SceneConfig, run: int, index: int, object_set: ObjectSet, wide: WideScenes = WIDE) -> Scene:
    """The scene that a round begins with, whatever planner is tested; `wide` says what tables and bins are like."""
    rng = random_stream(config, run, index, SCENE)
    count = None if config.scene in WIDE_KINDS else OBJECTS
    return spawn_scene(config.scene, object_set, config.split, rng, count, wide=wide)


def is_holdable(
    config: SceneConfig, run: int, index: int, scene: Scene, target: int, object_set: ObjectSet, gripper: Gripper
) -> bool:
    """Whether the hand can hold an object of a round's first scene, see `can_hold`; the same for every planner."""
    return can_hold(scene, target, object_set, gripper, random_stream(config, run, index, HOLDABLE, target))


def play_round(job: ClutterJob, run: int, index: int, planner: Planner) -> Round:
    """Lets a planner grasp until nothing is left, it fails twice in a row, or finds nothing in three pictures."""
    scene = round_scene(job.config, run, index, job.object_set)
    cell = Workcell(scene, job.object_set, job.gripper)

    def take(number: int) -> Shot:
        now = cell.scene()
        observation = job.look(run, index, number, now, planner.needs_truth)
        start = time.perf_counter()
        plan = planner.plan(observation)
        seconds = time.perf_counter() - start
        shot = Shot(
            run=run,
            round=index,
            attempt=number,
            scene=[placed.name for placed in now.objects],
            scales=[placed.scale for placed in now.objects],
            object_poses=[placed.T_world_object.tolist() for placed in now.objects],
            camera=observation.T_world_camera.tolist(),
            stretches=[list(placed.stretch) for placed in now.objects] if observation.is_wide else [],
        )
        return carry_out(job, cell, shot, plan, scene, seconds) if len(plan) else shot

    is_wide = scene.kind in WIDE_KINDS
    attempts, skipped = until_over(take, lambda: len(cell.remaining), WIDE_ATTEMPTS if is_wide else None)
    played = Round(run, index, len(scene.objects), len(cell.remaining), attempts, skipped, job.commit)
    if not is_wide:
        return played
    every = range(len(scene.objects))
    holdable = {i for i in every if is_holdable(job.config, run, index, scene, i, job.object_set, job.gripper)}
    return replace(played, holdable=len(holdable), holdable_grasped=len(holdable & set(cell.grasped)))


def until_over(
    take: Callable[[int], Shot], remaining: Callable[[], int], most: int | None = None
) -> tuple[list[Attempt], list[Shot]]:
    """Attempts and skipped pictures of a round, to its end.

    Args:
        take: the next picture, by its number in the round, and the attempt that came of it, if any.
        remaining: how many objects are left on the table.
        most: attempts after which it ends; None for no limit.
    """
    attempts: list[Attempt] = []
    skipped: list[Shot] = []
    failures = 0
    while remaining() and failures < FAILURES_IN_A_ROW and len(skipped) < SKIPS and len(attempts) != most:
        shot = take(len(attempts) + len(skipped))
        if isinstance(shot, Attempt):
            attempts.append(shot)
            failures = 0 if shot.success else failures + 1
        else:
            skipped.append(shot)
    return attempts, skipped


def carry_out(job: ClutterJob, cell: Workcell, shot: Shot, plan: Plan, scene: Scene, plan_seconds: float) -> Attempt:
    """Executes the first grasp of a plan in a workcell that began with a scene."""
    opening = job.gripper.max_opening if job.config.full_opening else float(plan.openings[0])
    execution = cell.execute(plan.poses[0], opening, PROTOCOLS[job.config.protocol])
    names = {i: placed.name for i, placed in enumerate(scene.objects)} | {TABLE: "table"}
    return Attempt(
        **asdict(shot),
        pose=plan.poses[0].tolist(),
        opening=opening,
        score=float(plan.scores[0]),
        success=execution.success,
        cause=execution.cause.value,
        target=names[execution.target],
        target_class=job.object_set.class_name(names[execution.target]),
        held=[names[i] for i in execution.held],
        touched=[names[i] for i in execution.touched if i != execution.target],
        lost=[names[i] for i in execution.lost],
        plan_seconds=plan_seconds,
    )
