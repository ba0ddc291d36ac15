"""Grasp *this* object: one attempt at one named object, by how much of it the others hide.

Occlusion is that of TARGO ("Benchmarking Target-driven Object Grasping under Occlusions"): 1 - pixels of the target
seen in the clutter / seen alone, by the same camera.
"""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from icgnet.benchmark.config import NOTHING_FOUND, OCCLUSION_GROUPS, TargetConfig
from icgnet.benchmark.observation import Observation, sense, take_picture
from icgnet.benchmark.pictures import progress_bar
from icgnet.benchmark.planner import Planner
from icgnet.benchmark.rounds import (
    CAMERA,
    PLANNER,
    TARGET,
    is_holdable,
    planner_of,
    random_stream,
    round_scene,
)
from icgnet.benchmark.statistics import Spread, causes_told, cell, success_rate
from icgnet.benchmark.tables import Table
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.kinds import WIDE_KINDS
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.parallel.pool import local_pool
from icgnet.sensors.wide import Picture
from icgnet.simulation.camera import SceneRenderer
from icgnet.simulation.scene import Scene, world_mesh
from icgnet.simulation.workcell import PROTOCOLS, Cause, Workcell

BINS, WIDTH = 9, 0.1
"""Targets are sorted by occlusion into so many bins of this width."""
FEWEST_PIXELS = 50
"""An object that has fewer pixels alone is no target."""


@dataclass(frozen=True)
class TargetAttempt:
    """One attempt at one object.

    Attributes:
        scene: number of the scene.
        name: of the target.
        occlusion: share of it that is hidden.
        success: the target is held, and nothing else.
        cause: how it ended.
        plan_seconds: time that the planner took [s].
    """

    scene: int
    name: str
    occlusion: float
    success: bool
    cause: str
    plan_seconds: float


@dataclass(frozen=True)
class Group:
    """Attempts that are counted together.

    Attributes:
        targets: attempts.
        successes: of them.
        rate: successes by attempts in percent with Wilson's 95 % interval; None without attempts.
        failures: number of failed attempts by cause; "nothing found" is one.
    """

    targets: int
    successes: int
    rate: Spread | None
    failures: dict[str, int]


@dataclass(frozen=True)
class TargetNumbers:
    """The result of a benchmark.

    Attributes:
        bins: attempts by tenths of occlusion.
        groups: by less and more than one half, and all.
        scenes: that were drawn.
        not_holdable: objects that were drawn and left out, since the hand could not hold them if they stood alone.
        plan_seconds: median time of the planner for one picture [s].
        rows: every attempt.
    """

    bins: dict[str, Group]
    groups: dict[str, Group]
    scenes: int
    not_holdable: int
    plan_seconds: float
    rows: tuple[TargetAttempt, ...]


@dataclass(frozen=True)
class TargetJob:
    """Everything that a worker must know to try the targets of any scene; the planner is made in the worker."""

    config: TargetConfig
    object_set: ObjectSet
    gripper: Gripper

    def make(self, number: int) -> tuple[list[TargetAttempt], int]:
        """The attempts in the scene of this number, and how many objects that the hand cannot hold were left out."""
        config, objects, gripper = self.config, self.object_set, self.gripper
        scene = round_scene(config, 0, number, objects)
        picture = take_picture(scene, objects, config.view, random_stream(config, 0, number, CAMERA))
        hidden = occlusions(picture, scene, objects)
        left_out: list[int] = []

        def is_target(index: int) -> bool:
            if is_holdable(config, 0, number, scene, index, objects, gripper):
                return True
            left_out.append(index)
            return False

        planner, attempts = planner_of(config), []
        for target in draw_targets(hidden, is_target, random_stream(config, 0, number, TARGET)):
            seen = look(config, number, scene, objects, gripper, picture, target)
            attempts.append(_attempt(planner, seen, scene, objects, target, number, float(hidden[target])))
        return attempts, len(left_out)

    def name(self, number: int) -> str:
        """How messages call a scene."""
        return f"scene {number} (seed {self.config.seed})"


def measure(config: TargetConfig, workers: int = 1) -> TargetNumbers:
    """Lets the planner try one object of each tenth of occlusion that a scene has, in every scene.

    Args:
        config: of the benchmark.
        workers: processes; every scene draws the same whatever their number is.

    Raises:
        InputError: unknown planner, objects or hand.
        DataError: unusable weights or objects.
    """
    job = TargetJob(config, load_object_set(config.objects), load_gripper(config.gripper))
    planner_of(config, anew=True)  # what is wrong with it shows here, and not in a worker
    with closing(local_pool(job, workers)) as pool:
        scenes = list(progress_bar(pool.make(range(config.scenes)), "scenes", config.scenes))
    rows = sorted((row for attempts, _ in scenes for row in attempts), key=lambda row: (row.scene, row.occlusion))
    return summarise(rows, len(scenes), sum(left_out for _, left_out in scenes))


def occlusions(picture: Picture, scene: Scene, object_set: ObjectSet) -> Float[np.ndarray, "o"]:
    """Share of each object's pixels that others, or structures, hide; nan for objects too small in the picture."""
    seen = np.bincount(picture.image.ids[picture.image.ids >= 0], minlength=len(scene.objects))
    hidden = np.full(len(scene.objects), np.nan)
    for index, placed in enumerate(scene.objects):
        triangles = np.asarray(world_mesh(placed, object_set).triangles)
        # Without the table as well: it hides nothing of what stands on it from a camera above it.
        renderer = SceneRenderer(triangles, np.zeros(len(triangles), int), table_height=None)
        alone = renderer.render(picture.intrinsics, picture.image.ids.shape, picture.T_world_camera)
        pixels = int((alone.ids == 0).sum())
        if pixels >= FEWEST_PIXELS:
            hidden[index] = max(1.0 - seen[index] / pixels, 0.0)
    return hidden


def draw_targets(
    hidden: Float[np.ndarray, "o"], is_target: Callable[[int], bool], rng: np.random.Generator
) -> list[int]:
    """Indices of one object in each tenth of occlusion: of those there in random order, the first that may be one."""
    bins = np.array([_bin_of(each) for each in hidden], int)
    orders = [rng.permutation(np.flatnonzero(bins == number)).tolist() for number in range(BINS)]
    drawn = [next(filter(is_target, order), None) for order in orders]
    return [index for index in drawn if index is not None]


def _bin_of(occlusion: float) -> int:
    """Number of the bin; -1 for none. Of two bins that meet there, the upper one."""
    number = -1 if np.isnan(occlusion) else int(occlusion / WIDTH + 1e-9)
    return number if number < BINS else -1


def look(
    config: TargetConfig,
    number: int,
    scene: Scene,
    object_set: ObjectSet,
    gripper: Gripper,
    picture: Picture,
    target: int,
) -> Observation:
    """The noisy picture of a scene, with the mask of the target; for each target of a scene the noise is the same."""
    noise = random_stream(config, 0, number, CAMERA, 1)
    seen = sense(picture, scene.kind in WIDE_KINDS, config.noise, gripper, config.full_opening, noise)
    draws, truth = random_stream(config, 0, number, PLANNER, target), TrueShapes(scene, object_set, target)
    return replace(seen, rng=draws, truth=truth, target=picture.image.ids == target)


def _attempt(
    planner: Planner,
    seen: Observation,
    scene: Scene,
    object_set: ObjectSet,
    target: int,
    number: int,
    occlusion: float,
) -> TargetAttempt:
    """Plans and carries out one grasp of the target."""
    observation = seen if planner.needs_truth else replace(seen, truth=None)
    start = time.perf_counter()
    plan = planner.plan(observation)
    seconds = time.perf_counter() - start
    cause = NOTHING_FOUND
    if len(plan):
        opening = seen.gripper.max_opening if seen.full_opening else float(plan.openings[0])
        cell = Workcell(scene, object_set, seen.gripper)
        cause = cell.execute(plan.poses[0], opening, PROTOCOLS["strict"], target).cause.value
    return TargetAttempt(number, scene.objects[target].name, occlusion, cause == Cause.HELD.value, cause, seconds)


def summarise(rows: Sequence[TargetAttempt], scenes: int, not_holdable: int) -> TargetNumbers:
    """The statistics of attempts in so many scenes, in which so many objects were drawn and left out."""
    bins: Int[np.ndarray, "n"] = np.array([_bin_of(row.occlusion) for row in rows], int)

    def group(first: int, end: int) -> Group:
        own = [row for row, number in zip(rows, bins, strict=True) if first <= number < end]
        successes = sum(row.success for row in own)
        failures = Counter(row.cause for row in own if not row.success)
        return Group(len(own), successes, success_rate(successes, len(own)), dict(failures))

    return TargetNumbers(
        bins={f"{each / 10:g} to {(each + 1) / 10:g}": group(each, each + 1) for each in range(BINS)},
        groups={name: group(*limits) for name, limits in OCCLUSION_GROUPS.items()},
        scenes=scenes,
        not_holdable=not_holdable,
        plan_seconds=float(np.median([row.plan_seconds for row in rows])) if rows else float("nan"),
        rows=tuple(rows),
    )


def tables(numbers: TargetNumbers) -> list[Table]:
    """What is printed."""
    rows = [
        (name, str(group.targets), cell(group.rate, ".1f"), causes_told(group.failures))
        for name, group in (numbers.bins | numbers.groups).items()
    ]
    notes = (
        f"{numbers.scenes} scenes; {numbers.not_holdable} objects left out, which the hand could not hold if alone; "
        f"planning takes {numbers.plan_seconds:.2f} s (median)",
    )
    return [Table(("occlusion", "targets", "held, % [95 %]", "failures"), rows, notes=notes)]
