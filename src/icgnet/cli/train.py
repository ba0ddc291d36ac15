"""`icgnet train`: weights from labelled scenes."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console
from rich.table import Table

from icgnet.errors import InputError


@dataclass(frozen=True)
class Train:
    """Train a network on generated scenes. Run it again with the same settings to go on after an interruption.

    Started by torchrun, all processes train one network together.
    """

    preset: tyro.conf.Positional[Literal["tiny", "cpu", "paper"]]
    """Settings of the run: see the config.json that it writes."""
    data: tuple[Path, ...]
    """Folders that `icgnet generate` wrote; those of split val are validated on."""
    out: Path
    """Folder of the run: config.json, metrics.jsonl, checkpoint.pt and the weights."""
    objects: tuple[str, ...] = ("procedural",)
    """The object sets that the scenes were made of."""
    start: Path | None = None
    """Weights to begin with, of the same network, instead of random ones."""
    minutes: float | None = None
    """Training time in place of the preset's [min]."""
    steps: int | None = None
    """Optimiser steps in place of the preset's."""
    network: Literal["tiny", "default", "paper"] | None = None
    """Network in place of the preset's."""
    batch: int | None = None
    """Scenes per step, in each process, in place of the preset's."""
    common_statistics: bool | None = None
    """Whether processes share the statistics of their batches, in place of the preset's."""
    learning_rate: float | None = None
    """Learning rate after the warm-up in place of the preset's."""
    threads: int | None = None
    """CPU threads in place of the preset's."""
    workers: int | None = None
    """Processes that prepare samples, in place of the preset's."""
    seed: int = 0
    """Of the first weights and of every draw."""
    accelerator: Literal["auto", "cpu", "gpu"] = "auto"
    """What to compute on; auto takes a GPU where there is one."""

    def run(self) -> None:
        """Trains, with a line of text now and then.

        Raises:
            IcgnetError: no usable scenes, settings out of range, or a run with other settings in `out`.
        """
        if self.minutes is not None and self.steps is not None:
            raise InputError(f"give --minutes or --steps, not both (got {self.minutes:g} and {self.steps})")
        from icgnet.training.config import TRAININGS
        from icgnet.training.loop import train

        names = ("network", "batch", "common_statistics", "learning_rate", "threads", "workers")
        given = {name: getattr(self, name) for name in names}
        changes = {name: value for name, value in given.items() if value is not None}
        if self.minutes is not None or self.steps is not None:
            changes |= {"minutes": self.minutes, "steps": self.steps}
        config = replace(TRAININGS[self.preset], seed=self.seed, **changes)
        console = Console()

        def say(line: str) -> None:
            console.print(line, markup=False, highlight=False, soft_wrap=True)

        metrics = train(
            config, self.data, self.out, self.objects, report=say, start=self.start, accelerator=self.accelerator
        )
        if not metrics:
            return
        table = Table("metric", "value", title=f"validation of {self.out}")
        for name, value in metrics.items():
            table.add_row(name, f"{value:.4g}")
        console.print(table)
