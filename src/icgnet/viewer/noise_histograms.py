"""Pairs of histograms of what real and simulated depth images measure, a row for each camera."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from icgnet.errors import InputError

PANEL_INCHES = (2.9, 2.0)
BINS = 24
REAL = (0.86, 0.42, 0.12)
OURS = (0.16, 0.38, 0.62)


@dataclass(frozen=True, eq=False)
class HistogramRow:
    """The histograms of one camera.

    Attributes:
        caption: what stands beside it.
        real: values of real images, by what is measured; may be empty.
        ours: values of simulated images, by the same.
    """

    caption: str
    real: Mapping[str, Float[np.ndarray, "_"]]
    ours: Mapping[str, Float[np.ndarray, "_"]]


def draw_histograms(rows: Sequence[HistogramRow], path: str | Path) -> None:
    """Writes a PNG with a row for each camera and a column for each measure; areas are one.

    Raises:
        InputError: no rows.
    """
    if not rows:
        raise InputError("histograms need at least one camera, got none")
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    histogram_figure(rows).savefig(path, dpi=80)


def histogram_figure(rows: Sequence[HistogramRow]) -> Figure:
    """The pairs of histograms, row by row."""
    columns = list(rows[0].ours)
    figure = Figure((PANEL_INCHES[0] * len(columns), PANEL_INCHES[1] * len(rows) + 0.4), layout="constrained")
    panels = figure.subplots(len(rows), len(columns), squeeze=False)
    for row, axes in zip(rows, panels, strict=True):
        for name, panel in zip(columns, axes, strict=True):
            both = [np.asarray(values.get(name, [])) for values in (row.real, row.ours)]
            together = np.concatenate(both)
            panel.set_yticks([])
            if len(together):
                edges = np.linspace(min(0.0, together.min()), max(np.percentile(together, 99), 1e-6), BINS + 1)
                for values, colour, label in zip(both, (REAL, OURS), ("real", "simulated"), strict=True):
                    if len(values):
                        shown = np.clip(values, edges[0], edges[-1])
                        panel.hist(shown, edges, density=True, alpha=0.55, color=colour, label=label)
        axes[0].set_ylabel(row.caption)
    for name, panel in zip(columns, panels[0], strict=True):
        panel.set_title(name, fontsize="medium")
    panels[0, 0].legend(fontsize="small")
    return figure
