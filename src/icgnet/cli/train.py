"""`icgnet train`: weights from labelled scenes."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console
from rich.table import Table

from icgnet.errors import DataError
from icgnet.training.config import TRAININGS, TrainingConfig


@dataclass(frozen=True)
class Train:
    """Train a network on generated scenes. Run it again with the same settings to go on after an interruption.

    Started by torchrun, all processes train one network together.
    """

    data: tuple[Path, ...]
    """Folders that `icgnet generate` wrote; those of split val are validated on."""
    out: Path
    """Folder of the run: config.json, metrics.jsonl, checkpoint.pt and the weights."""
    config: Annotated[TrainingConfig, tyro.conf.arg(name="")] = field(default_factory=TrainingConfig)
    """Settings of the run."""
    objects: tuple[str, ...] = ("procedural",)
    """The object sets that the scenes were made of."""
    gripper: str | None = None
    """Name of a gripper or a gripper file: the hand that the scenes must be labelled with; any if not given."""
    start: Path | None = None
    """Weights to begin with, of the same network, instead of random ones."""
    accelerator: Literal["auto", "cpu", "gpu"] = "auto"
    """What to compute on; auto takes a GPU where there is one."""

    def run(self) -> None:
        """Trains, with a line of text now and then.

        Raises:
            IcgnetError: no usable scenes, settings out of range, or a run with other settings in `out`.
        """
        from icgnet.grasping.gripper import load_gripper

        gripper = None if self.gripper is None else load_gripper(self.gripper)
        for folder in self.data:
            if not folder.is_dir():
                raise DataError(f"no such folder: {folder}")
        from icgnet.training.loop import train

        console = Console()

        def say(line: str) -> None:
            console.print(line, markup=False, highlight=False, soft_wrap=True)

        metrics = train(
            self.config,
            self.data,
            self.out,
            self.objects,
            report=say,
            start=self.start,
            accelerator=self.accelerator,
            gripper=gripper,
        )
        if not metrics:
            return
        table = Table("metric", "value", title=f"validation of {self.out}")
        for name, value in metrics.items():
            table.add_row(name, f"{value:.4g}")
        console.print(table)


@dataclass(frozen=True)
class TrainTiny(Train):
    """Train a small network for a few steps, to see that everything works."""

    config: Annotated[TrainingConfig, tyro.conf.arg(name="")] = TRAININGS["tiny"]


@dataclass(frozen=True)
class TrainCpu(Train):
    """Train a network on a processor with a few cores, in an evening."""

    config: Annotated[TrainingConfig, tyro.conf.arg(name="")] = TRAININGS["cpu"]


@dataclass(frozen=True)
class TrainPaper(Train):
    """Train the network of the paper as published. A processor is too slow for that."""

    config: Annotated[TrainingConfig, tyro.conf.arg(name="")] = TRAININGS["paper"]
