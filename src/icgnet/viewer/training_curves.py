"""Curves of training runs, from the logs that they leave: what validation and the loss said over the visits."""

import json
import math
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
LOG_FILE = "metrics.jsonl"
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
    """The log of a run folder, or a log file itself, whose name is the run's.

    What a run logged after the checkpoint that it later went on from is left out: it was done again.

    Raises:
        DataError: there is none, or it is damaged.
    """
    path = path.resolve()
    file = path / LOG_FILE if path.is_dir() else path
    try:
        texts = [text for text in file.read_text().splitlines() if text.strip()]
    except (OSError, ValueError) as error:
        raise DataError(f"{file}: cannot be read ({error})") from error
    if not texts:
        raise DataError(f"{file}: the log of a training run has lines, this file has none")
    lines: list[dict] = []
    for number, text in enumerate(texts, 1):
        line = _checked(text, f"{file}, line {number}")
        while lines and _is_after(lines[-1], line):
            lines.pop()
        lines.append(line)
    return RunLog(file.parent.name if file.name == LOG_FILE else file.stem, tuple(lines))


def _is_after(line: dict, other: dict) -> bool:
    same = line["scenes"] == other["scenes"] and line["kind"] == other["kind"]
    return same or line["scenes"] > other["scenes"]


def _checked(text: str, place: str) -> dict:
    try:
        line = json.loads(text)
    except ValueError as error:
        raise DataError(f"{place}: not JSON ({error})") from error
    if not isinstance(line, dict) or not {"kind", "scenes", "elapsed_s"} <= line.keys():
        raise DataError(f"{place}: a training run logs kind, scenes and elapsed_s, got {text[:80]}")
    line = {name: math.nan if value is None else value for name, value in line.items()}  # JSON has no NaN
    wrong = [name for name, value in line.items() if name != "kind" and not isinstance(value, int | float)]
    if wrong:
        raise DataError(f"{place}: {wrong[0]} must be a number, got {line[wrong[0]]!r}")
    return line


def draw_curves(runs: Sequence[RunLog], path: Path, over: Abscissa = "visits") -> None:
    """Writes a PNG with the curves of all runs in one picture.

    Raises:
        InputError: no runs.
    """
    figure = curves_figure(runs, over)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=100)


def curves_figure(runs: Sequence[RunLog], over: Abscissa = "visits") -> Figure:
    """One axes for each of `PANELS`, one line for each run.

    Raises:
        InputError: no runs.
    """
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
