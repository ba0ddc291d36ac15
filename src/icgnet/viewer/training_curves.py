"""Curves of training runs, from the logs that they leave: what validation and the loss said over the visits."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from icgnet.errors import DataError, InputError

Abscissa = Literal["visits", "minutes"]
PANELS = (
    ("train", "loss", "loss (running mean)"),
    ("val", "grasp_best_f1", "grasps: best F1"),
    ("val", "grasp_top1_precision", "grasps: precision of the best"),
    ("val", "occupancy_scene_iou", "shapes: IoU of the scene"),
    ("val", "instance_ap50", "instances: AP50"),
    ("val", "class_accuracy", "class accuracy"),
)
"""What is drawn: kind of line in the log, name of the value, and title."""
COLUMNS = 3
PANEL_INCHES = (4.2, 3.0)
SMOOTHED = 15
"""Lines of the log that a point of the running mean of the loss covers."""


@dataclass(frozen=True, eq=False)
class RunLog:
    """The log of one run.

    Attributes:
        name: of the run.
        lines: as the run wrote them, each with `kind`, `scenes` and `elapsed_s`.
    """

    name: str
    lines: tuple[dict, ...]

    def values(self, kind: str, name: str, over: Abscissa) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Where a value was logged, in visits or minutes of the run, and the values."""
        lines = [line for line in self.lines if line["kind"] == kind and name in line]
        places = np.array([line["scenes"] if over == "visits" else line["elapsed_s"] / 60 for line in lines], float)
        return places, np.array([line[name] for line in lines], float)


def read_run(path: Path) -> RunLog:
    """The log of a run folder, or a log file itself.

    Raises:
        DataError: there is none, or it is damaged.
    """
    file = path / "metrics.jsonl" if path.is_dir() else path
    try:
        lines = tuple(json.loads(line) for line in file.read_text().splitlines() if line.strip())
        complete = all({"kind", "scenes", "elapsed_s"} <= line.keys() for line in lines)
    except (OSError, ValueError, AttributeError) as error:
        raise DataError(f"{file}: not the log of a training run ({error})") from error
    if not lines or not complete:
        raise DataError(f"{file}: not the log of a training run (a line has no kind, scenes or elapsed_s)")
    return RunLog(path.name if path.is_dir() else path.stem, lines)


def draw_curves(runs: Sequence[RunLog], path: Path, over: Abscissa = "visits") -> None:
    """Writes a PNG with the curves of all runs in one picture.

    Raises:
        InputError: no runs.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    curves_figure(runs, over).savefig(path, dpi=100)


def curves_figure(runs: Sequence[RunLog], over: Abscissa = "visits") -> Figure:
    """One axes for each of `PANELS`, one line for each run."""
    if not runs:
        raise InputError("no runs to draw")
    rows = -(-len(PANELS) // COLUMNS)
    figure = Figure((PANEL_INCHES[0] * COLUMNS, PANEL_INCHES[1] * rows), layout="constrained")
    for axes, (kind, name, title) in zip(figure.subplots(rows, COLUMNS).flat, PANELS, strict=True):
        axes.set(title=title, xlabel="scenes visited" if over == "visits" else "minutes")
        axes.grid(alpha=0.3)
        for run in runs:
            places, values = run.values(kind, name, over)
            if kind == "train":
                places, values = _running_mean(places), _running_mean(values)
            axes.plot(places, values, marker="." if kind == "val" else None, label=run.name)
    figure.axes[0].legend()
    return figure


def _running_mean(values: Float[np.ndarray, "n"]) -> Float[np.ndarray, "m"]:
    width = max(1, min(SMOOTHED, len(values)))
    return np.convolve(values, np.full(width, 1 / width), mode="valid") if len(values) else values
