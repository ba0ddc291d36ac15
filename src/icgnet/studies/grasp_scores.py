"""What scores are worth where they are used: grasps of whole pictures are tried one by one, each in the same scene.

Labels ask whether a contact on a known object holds. A robot asks of a picture: of what was found there, and is free as
far as can be told, what should be tried first? So here everything counts: things that are no objects, wrong shapes,
what nobody saw.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.rounds import PLANNER, ClutterJob, planner_of, random_stream, round_scene
from icgnet.benchmark.statistics import Metric, mean, spreads, table
from icgnet.benchmark.tables import Table
from icgnet.errors import InputError
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.prediction import Prediction
from icgnet.objects.object_set import load_object_set
from icgnet.simulation.workcell import PROTOCOLS, Workcell
from icgnet.studies.config import GraspScoresConfig
from icgnet.training.metrics import ranking_precision
from icgnet.training.reliability import reliability

FIRST, SURE = 3, 0.5


@dataclass(frozen=True, eq=False)
class Tried:
    """Grasps of one picture that were tried, the best score first.

    Attributes:
        scores: of the grasps.
        objects: scores of the objects that they are for.
        held: whether the right object was lifted and nothing else touched, by the rules of the protocol strict.
        causes: how each trial ended.
    """

    scores: Float[np.ndarray, "g"]
    objects: Float[np.ndarray, "g"]
    held: Bool[np.ndarray, "g"]
    causes: tuple[str, ...]

    @property
    def alone(self) -> Float[np.ndarray, "g"]:
        """What the scores were if all that was found were objects."""
        return self.scores / self.objects


@dataclass(frozen=True)
class GraspScoresNumbers:
    """Each of `NUMBERS` with its spread over the pictures, and how the trials ended."""

    pictures: int
    tried: int
    scores: dict[str, Any]
    causes: dict[str, int]


def measure(config: GraspScoresConfig) -> GraspScoresNumbers:
    """Tries grasps of the first pictures of the scenes of a clutter benchmark.

    Raises:
        IcgnetError: unusable objects, weights or gripper, or nothing to grasp in any picture.
    """
    clutter = ClutterConfig(
        objects=config.objects,
        scene=config.scene,
        split=config.split,
        noise=config.noise,
        seed=config.seed,
        gripper=config.gripper,
        weights=config.weights,
        threads=config.threads,
        search=replace(config.search, most=None),
        protocol="strict",
        rounds=config.pictures,
    )
    job = ClutterJob(clutter, load_object_set(config.objects), load_gripper(config.gripper))
    found = [each for number in range(config.pictures) if (each := try_grasps(job, number, config.grasps)) is not None]
    if not found:
        raise InputError(f"no grasp was found in any of {config.pictures} {config.scene} pictures")
    causes = [cause for each in found for cause in each.causes]
    return GraspScoresNumbers(
        len(found), len(causes), spreads(NUMBERS, found), {name: causes.count(name) for name in sorted(set(causes))}
    )


def tables(numbers: GraspScoresNumbers) -> list[Table]:
    """What is printed."""
    ends = [[name, str(count)] for name, count in sorted(numbers.causes.items(), key=lambda pair: -pair[1])]
    title = f"scores of {numbers.tried} grasps of {numbers.pictures} pictures"
    return [table((title, "[95 %]"), NUMBERS, numbers.scores), Table(("how trials ended", "grasps"), ends)]


def try_grasps(job: ClutterJob, number: int, count: int) -> Tried | None:
    """Some grasps of the first picture of a round, tried one by one in the same scene; None where none was found."""
    scene = round_scene(job.config, 0, number, job.object_set)
    plan = planner_of(job.config).plan(job.look(0, number, 0, scene, False))
    if not len(plan):
        return None
    assert isinstance(plan.details, Prediction)
    instances = plan.details.grasps.instances
    chosen = some_of(instances, count, random_stream(job.config, 0, number, PLANNER, 0))
    ends = [
        Workcell(scene, job.object_set, job.gripper).execute(
            plan.poses[row], float(plan.openings[row]), PROTOCOLS[job.config.protocol]
        )
        for row in chosen
    ]
    objects = np.array([item.score for item in plan.details.objects])
    held = np.array([end.success for end in ends])
    return Tried(plan.scores[chosen], objects[instances[chosen]], held, tuple(end.cause.value for end in ends))


def some_of(instances: Int[np.ndarray, "g"], count: int, rng: np.random.Generator) -> Int[np.ndarray, "k"]:
    """Rows of grasps that stand for all of a picture: the best, the best of each object, and others by lot.

    Args:
        instances: object of each grasp, the best grasp first.
        count: so many of the best, and so many others.
        rng: draws the others.
    """
    best = np.arange(min(count, len(instances)))
    of_each = np.unique(instances, return_index=True)[1]
    others = rng.permutation(len(instances))[:count]
    return np.unique(np.concatenate([best, of_each, others]))


def _together(number: Callable[[Any, Any], Any], values: Callable[[Tried], Any]) -> Callable[[Sequence[Tried]], Any]:
    """A number of the scores and outcomes of all pictures together."""

    def of(pictures: Sequence[Tried]) -> float | None:
        scores = np.concatenate([values(each) for each in pictures])
        return number(scores, np.concatenate([each.held for each in pictures]))

    return of


def _first(values: Callable[[Tried], Any], count: int) -> Callable[[Sequence[Tried]], float | None]:
    """Success of the first grasps of each picture, ranked by these values."""
    return lambda pictures: mean(
        each.held[np.argsort(-values(each), kind="stable")[:count]].mean() for each in pictures
    )


def _calibration(scores: Float[np.ndarray, "n"], held: Bool[np.ndarray, "n"]) -> float | None:
    sure = scores >= SURE
    return reliability(scores[sure], held[sure]).error if sure.any() else None


NUMBERS: dict[str, Metric[Sequence[Tried]]] = {
    "success": Metric("share that held", _together(lambda scores, held: float(held.mean()), lambda each: each.scores)),
    "first": Metric("success of the first grasp of a picture", _first(lambda each: each.scores, 1)),
    "first_alone": Metric("the same, ranked as if all were objects", _first(lambda each: each.alone, 1)),
    "first_three": Metric("success of the first three", _first(lambda each: each.scores, FIRST)),
    "first_three_alone": Metric("the same, ranked as if all were objects", _first(lambda each: each.alone, FIRST)),
    "possible": Metric("pictures with a grasp that held", lambda pictures: mean(each.held.any() for each in pictures)),
    "precision": Metric("average precision", _together(ranking_precision, lambda each: each.scores), ".3f"),
    "precision_alone": Metric(
        "the same, as if all were objects", _together(ranking_precision, lambda each: each.alone), ".3f"
    ),
    "error": Metric(
        f"calibration error, scores from {SURE:g}", _together(_calibration, lambda each: each.scores), ".3f"
    ),
    "error_alone": Metric("the same, as if all were objects", _together(_calibration, lambda each: each.alone), ".3f"),
}
"""What the scores of grasps are worth, each also for scores that take everything that was found for an object."""
