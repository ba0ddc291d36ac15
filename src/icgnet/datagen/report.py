"""What a run of `icgnet generate` did, in numbers."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import UInt16

from icgnet.datagen.recipe import ANGLES, Recipe
from icgnet.objects.kinds import Kind


@dataclass(frozen=True, kw_only=True)
class Counts:
    """What some labelled scenes hold.

    Attributes:
        scenes: how many.
        objects: in all of them.
        labels: contacts times angles.
        positives: labels that are a success.
        collided: labels that the collision check decided, without physics.
        disturbed_positives: successes that moved another object.
        positive_share: positives among the labels.
        collided_share: collided among the labels.
    """

    scenes: int
    objects: int
    labels: int
    positives: int
    collided: int
    disturbed_positives: int
    positive_share: float
    collided_share: float


@dataclass(frozen=True, kw_only=True)
class GenerationReport(Counts):
    """What a run did; scenes that an earlier run had finished count in `scenes_found` and `bytes_per_scene` only.

    Attributes:
        kinds: the same counts for each kind of scenes.
        scenes_found: scenes that were there before.
        seconds: from the first scene's start to the last file, building and settling of scenes included.
        workers: processes, or processors of the cluster.
        labels_per_second_per_core: labels / (seconds * workers).
        bytes_per_scene: size of the Parquet files, those found included.
    """

    kinds: dict[str, Counts]
    scenes_found: int
    seconds: float
    workers: int
    labels_per_second_per_core: float
    bytes_per_scene: float


@dataclass
class GenerationTally:
    """Counts while scenes come in."""

    scenes: int = 0
    objects: int = 0
    labels: int = 0
    positives: int = 0
    collided: int = 0
    disturbed_positives: int = 0

    def add(self, recipe: Recipe) -> None:
        """Counts one more scene."""
        contacts = recipe.contacts
        self.scenes += 1
        self.objects += len(recipe.objects)
        self.labels += ANGLES * len(contacts)
        self.positives += _count_bits(contacts.success)
        self.collided += _count_bits(contacts.collided)
        self.disturbed_positives += _count_bits(contacts.success & contacts.disturbed)

    def add_counts(self, other: "GenerationTally") -> None:
        """Adds what another tally has counted."""
        for name, count in vars(other).items():
            setattr(self, name, getattr(self, name) + count)

    def counts(self) -> Counts:
        """The counts so far."""
        labels = max(1, self.labels)
        return Counts(**asdict(self), positive_share=self.positives / labels, collided_share=self.collided / labels)


def make_report(
    tallies: Mapping[Kind, GenerationTally], found: int, seconds: float, workers: int, bytes_per_scene: float
) -> GenerationReport:
    """The report of a run from its counts.

    Args:
        tallies: what was counted for each kind of scenes.
        found: scenes that were there before.
        seconds: that the run took.
        workers: processes.
        bytes_per_scene: see `GenerationReport`.
    """
    total = GenerationTally()
    for tally in tallies.values():
        total.add_counts(tally)
    return GenerationReport(
        **vars(total.counts()),
        kinds={kind: tally.counts() for kind, tally in tallies.items()},
        scenes_found=found,
        seconds=seconds,
        workers=workers,
        labels_per_second_per_core=total.labels / (seconds * workers),
        bytes_per_scene=bytes_per_scene,
    )


def _count_bits(bits: UInt16[np.ndarray, "g"]) -> int:
    return int(np.bitwise_count(bits).sum())
