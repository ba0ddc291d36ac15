"""What training reports now and then: means over the scenes of all processes, speed, and waiting."""

import time

import torch
from lightning_fabric import Fabric
from torch import Tensor

from icgnet.training.losses import TERMS
from icgnet.training.processes import total

REPORTED = ("loss", *TERMS)
"""What is reported of a scene."""


class TrainingLog:
    """What happened since the last report."""

    def __init__(self) -> None:
        self.waiting = Stopwatch()
        self._terms: dict[str, list[Tensor]] = {name: [] for name in REPORTED}
        self._norms: list[float] = []
        self._skipped: list[bool] = []
        self._scenes = 0

    def add(self, scenes: list[dict[str, Tensor]], gradient_norm: float, skipped: bool) -> None:
        """Adds a step.

        Args:
            scenes: loss and terms of each of the step's scenes in this process.
            gradient_norm: of the whole step.
            skipped: whether the step could not be used.
        """
        for scene in scenes:
            for name, value in scene.items():
                self._terms[name].append(value)
        self._scenes += len(scenes)
        self._norms.append(gradient_norm)
        self._skipped.append(skipped)

    def summary(self, seconds: float, fabric: Fabric) -> dict[str, float]:
        """Means over the scenes of all processes, scenes per second and the share of time spent waiting for samples.

        All processes have to ask for it together.
        """
        own = torch.zeros(2, len(REPORTED) + 1, dtype=torch.float64)
        for index, values in enumerate(self._terms.values()):
            if values:
                own[0, index], own[1, index] = torch.stack(values).sum(), len(values)
        own[0, -1], own[1, -1] = self.waiting.seconds / seconds, 1.0
        sums, counts = total(fabric, own)
        means = {
            name: float(value / count)
            for name, value, count in zip((*REPORTED, "waiting_share"), sums, counts, strict=True)
            if count
        }
        return means | {
            "gradient_norm": sum(self._norms) / len(self._norms),
            "skipped": sum(self._skipped) / len(self._skipped),
            "scenes_per_s": self._scenes * fabric.world_size / seconds,
        }


class Clock:
    """Training time including that of earlier legs [s]."""

    def __init__(self, before: float) -> None:
        self._start = time.perf_counter() - before

    @property
    def elapsed(self) -> float:
        """Time since the run began [s]."""
        return time.perf_counter() - self._start


class Stopwatch:
    """Adds up the time spent inside `with` [s]."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __enter__(self) -> None:
        self._start = time.perf_counter()

    def __exit__(self, *exception: object) -> None:
        self.seconds += time.perf_counter() - self._start
