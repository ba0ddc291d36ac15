"""How good can scores be? The same trials again and again, since a label is one draw of what the hand gets wrong.

A trial is jittered, and mass and friction are unknown to the camera, so grasps at the edge of what holds succeed once
and fail once. No network can know which; this is the best that one could do that knew every chance.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from icgnet.benchmark.tables import Table
from icgnet.datagen.config import LabelSettings
from icgnet.datagen.label_scene import scene_rng
from icgnet.errors import InputError
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.kinds import KINDS, Kind, Split
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.simulation.contacts import sample_contacts
from icgnet.simulation.physics import Body
from icgnet.simulation.scene import world_mesh
from icgnet.simulation.scenes import spawn_scene
from icgnet.simulation.trials import Trials
from icgnet.studies.config import LabelCeilingConfig
from icgnet.training.metrics import best_f1


@dataclass(frozen=True)
class LabelCeiling:
    """What scores can reach that are the success rates of the other repeats.

    Attributes:
        kind: "packed" or "pile".
        scenes: with at least one object.
        trials: contacts times angles, over the scenes.
        repeats: of each trial.
        success: share of successes.
        undecided: share of the trials with both outcomes, of those that ever succeeded.
        f1: of one repeat, at the best threshold on the success rates of the others; mean over the repeats.
        top1: success, in one repeat, of the scene's grasp that the others rank first; equal ones count in equal parts.
    """

    kind: Kind
    scenes: int
    trials: int
    repeats: int
    success: float
    undecided: float
    f1: float
    top1: float


@dataclass(frozen=True)
class LabelCeilingNumbers:
    """The ceilings of both kinds of scenes."""

    ceilings: tuple[LabelCeiling, ...]


def measure(config: LabelCeilingConfig) -> LabelCeilingNumbers:
    """Labels the contacts of random scenes several times, with new jitter, mass and friction each time.

    Raises:
        IcgnetError: unusable objects or gripper, or nothing of a kind and split in the object set.
    """
    object_set, gripper = load_object_set(config.objects), load_gripper(config.gripper)
    return LabelCeilingNumbers(tuple(ceiling(kind, outcomes(config, kind, object_set, gripper)) for kind in KINDS))


def outcomes(
    config: LabelCeilingConfig, kind: Kind, object_set: ObjectSet, gripper: Gripper
) -> list[Bool[np.ndarray, "r n"]]:
    """Outcomes of the repeated trials of every scene of a kind in which anything stayed.

    Raises:
        InputError: there is no such scene.
    """
    labels = LabelSettings(contacts=config.contacts)
    labelled = [
        _label_often(kind, object_set, config.split, gripper, labels, config.repeats, scene_rng(config.seed, number))
        for number in range(config.scenes)
    ]
    found = [each for each in labelled if each is not None]
    if not found:
        raise InputError(f"object set {object_set.name!r}: nothing stayed in any of {config.scenes} {kind} scenes")
    return found


def tables(numbers: LabelCeilingNumbers) -> list[Table]:
    """What is printed."""
    rows = [
        (
            f"{each.kind} {each.scenes}",
            str(each.trials),
            *(f"{share:.3f}" for share in (each.success, each.undecided, each.f1, each.top1)),
        )
        for each in numbers.ceilings
    ]
    headers = ("scenes", "trials", "success", "both outcomes", "F1 at best", "top 1")
    return [Table(headers, rows, title="ceiling of scores")]


def ceiling(kind: Kind, scenes: list[Bool[np.ndarray, "r n"]]) -> LabelCeiling:
    """The numbers, from the outcomes of `r` repeats of the `n` trials of every scene."""
    together = np.concatenate(scenes, axis=1)
    ever = together.any(axis=0)
    scores = _rates_of_the_others(together)
    return LabelCeiling(
        kind,
        scenes=len(scenes),
        trials=together.shape[1],
        repeats=len(together),
        success=float(together.mean()),
        undecided=float((ever & ~together.all(axis=0)).sum() / max(ever.sum(), 1)),
        f1=float(np.mean([best_f1(score, label)[0] for score, label in zip(scores, together, strict=True)])),
        top1=float(np.mean([_success_of_best(scene) for scene in scenes])),
    )


def _rates_of_the_others(outcomes: Bool[np.ndarray, "r n"]) -> Float[np.ndarray, "r n"]:
    """For every repeat the success rates of the trials in all other repeats."""
    return (outcomes.sum(axis=0) - outcomes) / (len(outcomes) - 1)


def _success_of_best(outcomes: Bool[np.ndarray, "r n"]) -> float:
    scores = _rates_of_the_others(outcomes)
    best = scores == scores.max(axis=1, keepdims=True)
    return float(np.mean([label[first].mean() for label, first in zip(outcomes, best, strict=True)]))


def _label_often(
    kind: Kind,
    object_set: ObjectSet,
    split: Split,
    gripper: Gripper,
    settings: LabelSettings,
    repeats: int,
    rng: np.random.Generator,
) -> Bool[np.ndarray, "r n"] | None:
    """Outcomes of all trials of a scene, None for a scene in which nothing stayed."""
    scene = spawn_scene(kind, object_set, split, rng, settings.object_count, settings.physics)
    if not scene.objects:
        return None
    contacts = sample_contacts([world_mesh(placed, object_set) for placed in scene.objects], settings.contacts, rng)
    bodies = [Body(object_set.model(placed.name), placed.scale, placed.T_world_object) for placed in scene.objects]
    rows = []
    for _ in range(repeats):
        physics = replace(
            settings.physics,
            object_mass=rng.uniform(*settings.variation.mass),
            pad_friction=rng.uniform(*settings.variation.pad_friction),
        )
        rows.append(Trials(bodies, gripper, physics).label(contacts, rng, settings.jitter).success.ravel())
    return np.stack(rows)
