"""How good can scores be? The same trials again and again, since a label is one draw of what the hand gets wrong.

A trial is jittered, and mass and friction are unknown to the camera, so grasps at the edge of what holds succeed once
and fail once. No network can know which; this is the best that one could do that knew every chance.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from icgnet.benchmark.statistics import Metric, evaluate, mean, table
from icgnet.benchmark.tables import Table
from icgnet.datagen.config import LabelSettings
from icgnet.datagen.label_scene import scene_rng
from icgnet.errors import InputError
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.kinds import CUBE_KINDS, Kind
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.simulation.contacts import sample_contacts
from icgnet.simulation.physics import scene_bodies
from icgnet.simulation.scene import world_mesh
from icgnet.simulation.scenes import spawn_scene
from icgnet.simulation.trials import Trials
from icgnet.studies.config import LabelCeilingConfig
from icgnet.training.metrics import best_f1

Outcomes = Bool[np.ndarray, "r n"]
"""Successes of `r` repeats of the `n` trials of a scene: contacts times angles."""


@dataclass(frozen=True)
class CeilingNumbers:
    """Each of `NUMBERS` for both kinds of scenes."""

    ceilings: dict[Kind, dict[str, Any]]


def measure(config: LabelCeilingConfig) -> CeilingNumbers:
    """Labels the contacts of random scenes several times, with new jitter, mass and friction each time.

    Raises:
        IcgnetError: unusable objects or gripper, or nothing of a kind and split in the object set.
    """
    object_set, gripper = load_object_set(config.objects), load_gripper(config.gripper)
    return CeilingNumbers({kind: evaluate(NUMBERS, outcomes(config, kind, object_set, gripper)) for kind in CUBE_KINDS})


def tables(numbers: CeilingNumbers) -> list[Table]:
    """What is printed."""
    return [table(("ceiling of scores", *numbers.ceilings), NUMBERS, *numbers.ceilings.values())]


def outcomes(config: LabelCeilingConfig, kind: Kind, object_set: ObjectSet, gripper: Gripper) -> list[Outcomes]:
    """Outcomes of the repeated trials of every scene of a kind in which anything stayed.

    Raises:
        InputError: there is no such scene.
    """
    labelled = [
        _label_often(config, kind, object_set, gripper, scene_rng(config.seed, number))
        for number in range(config.scenes)
    ]
    found = [each for each in labelled if each is not None]
    if not found:
        raise InputError(f"object set {object_set.name!r}: nothing stayed in any of {config.scenes} {kind} scenes")
    return found


def _label_often(
    config: LabelCeilingConfig, kind: Kind, object_set: ObjectSet, gripper: Gripper, rng: np.random.Generator
) -> Outcomes | None:
    """Outcomes of all trials of a scene, None for a scene in which nothing stayed."""
    settings = LabelSettings(contacts=config.contacts)
    scene = spawn_scene(kind, object_set, config.split, rng, settings.object_count, settings.physics)
    if not scene.objects:
        return None
    contacts = sample_contacts([world_mesh(placed, object_set) for placed in scene.objects], settings.contacts, rng)
    bodies = scene_bodies(scene, object_set)
    rows = []
    for _ in range(config.repeats):
        physics = replace(
            settings.physics,
            object_mass=rng.uniform(*settings.variation.mass),
            pad_friction=rng.uniform(*settings.variation.pad_friction),
        )
        rows.append(Trials(bodies, gripper, physics).label(contacts, rng, settings.jitter).success.ravel())
    return np.stack(rows)


def _undecided(scenes: Sequence[Outcomes]) -> float:
    """Share of the trials with both outcomes, of those that ever succeeded."""
    together = np.concatenate(scenes, axis=1)
    ever = together.any(axis=0)
    return float((ever & ~together.all(axis=0)).sum() / max(ever.sum(), 1))


def _f1(scenes: Sequence[Outcomes]) -> float | None:
    """Of one repeat, at the best threshold on the success rates of the others; mean over the repeats."""
    together = np.concatenate(scenes, axis=1)
    return mean(best_f1(*each)[0] for each in zip(_rates_of_the_others(together), together, strict=True))


def _success_of_best(scene: Outcomes) -> float | None:
    """Success, in one repeat, of the grasp that the others rank first; equal ones count in equal parts."""
    scores = _rates_of_the_others(scene)
    best = scores == scores.max(axis=1, keepdims=True)
    return mean(label[first].mean() for label, first in zip(scene, best, strict=True))


def _rates_of_the_others(scene: Outcomes) -> Float[np.ndarray, "r n"]:
    """For every repeat the success rates of the trials in all other repeats."""
    return (scene.sum(axis=0) - scene) / (len(scene) - 1)


NUMBERS: dict[str, Metric[Sequence[Outcomes]]] = {
    "scenes": Metric("scenes with any object", len, "d"),
    "trials": Metric("trials", lambda scenes: sum(each.shape[1] for each in scenes), "d"),
    "repeats": Metric("repeats of each", lambda scenes: len(scenes[0]), "d"),
    "success": Metric("share of successes", lambda scenes: float(np.concatenate(scenes, axis=1).mean()), ".3f"),
    "undecided": Metric("both outcomes, of those that ever succeed", _undecided, ".3f"),
    "f1": Metric("best F1", _f1, ".3f"),
    "top1": Metric("success of the best grasp of a scene", lambda scenes: mean(map(_success_of_best, scenes)), ".3f"),
}
"""What scores can reach that are the success rates of the other repeats."""
