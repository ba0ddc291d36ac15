"""Reliability diagrams: what share of the grasps with a score really succeeds, and how many grasps have it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from icgnet.errors import InputError
from icgnet.viewer.palette import INK, QUIET_INK

PANEL_INCHES = (5.2, 6.6)
HEIGHTS = (4, 1)
"""Of the shares and of the counts below them, relative to each other."""
BAR = (0.70, 0.80, 0.90)
DOT = (0.16, 0.38, 0.62)
BEST = (0.86, 0.42, 0.12)


@dataclass(frozen=True, eq=False)
class ReliabilityPanel:
    """One diagram; the bins are of equal width from 0 to 1.

    Attributes:
        caption: what stands above it.
        scores: [b] mean score in each bin, NaN in an empty one.
        shares: [b] share of successes in each bin, NaN in an empty one.
        counts: [b] grasps in each bin.
        best_score: mean score of each scene's best grasp; None leaves the mark out.
        best_success: share of scenes in which that grasp succeeds.
    """

    caption: str
    scores: Float[np.ndarray, "b"]
    shares: Float[np.ndarray, "b"]
    counts: Int[np.ndarray, "b"]
    best_score: float | None = None
    best_success: float | None = None


def draw_reliability(panels: Sequence[ReliabilityPanel], path: str | Path) -> None:
    """Writes a PNG with the diagrams side by side.

    Above, bars reach to the share of successes and dots stand at the mean score; true scores lie on the diagonal.
    Below, the number of grasps in each bin, on a logarithmic scale.

    Raises:
        InputError: no diagrams, or one without grasps.
    """
    if not panels or not all(panel.counts.sum() for panel in panels):
        raise InputError(f"a reliability diagram needs grasps, got {[int(panel.counts.sum()) for panel in panels]}")
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    reliability_figure(panels).savefig(path, dpi=100)


def reliability_figure(panels: Sequence[ReliabilityPanel]) -> Figure:
    """The diagrams side by side, shares above counts: axes 0 to n - 1, and n to 2n - 1."""
    figure = Figure((PANEL_INCHES[0] * len(panels), PANEL_INCHES[1]), layout="constrained")
    rows = figure.subplots(2, len(panels), squeeze=False, sharex="col", height_ratios=HEIGHTS)
    for panel, shares, counts in zip(panels, *rows, strict=True):
        _draw_shares(shares, panel)
        _draw_counts(counts, panel)
    return figure


def _draw_shares(axes: Axes, panel: ReliabilityPanel) -> None:
    used = np.flatnonzero(panel.counts)
    axes.set(title=panel.caption, ylabel="share of successes", xlim=(0, 1), ylim=(0, 1))
    axes.grid(alpha=0.3)
    axes.bar(_middles(panel)[used], panel.shares[used], 0.9 / len(panel.counts), color=BAR)
    axes.plot([0, 1], [0, 1], color=QUIET_INK)
    axes.plot(panel.scores[used], panel.shares[used], marker="o", color=DOT, clip_on=False)
    if panel.best_score is not None and panel.best_success is not None:
        text = f"best seen grasp of each scene:\nscore {panel.best_score:.2f}, success {panel.best_success:.2f}"
        axes.plot(panel.best_score, panel.best_success, "D", color=BEST, markersize=10, label=text, clip_on=False)
        axes.legend(loc="upper left")


def _draw_counts(axes: Axes, panel: ReliabilityPanel) -> None:
    used = np.flatnonzero(panel.counts)
    axes.set(xlabel="score", ylabel="grasps", yscale="log", ylim=(0.5, 10.0 * panel.counts.max()))
    bars = axes.bar(_middles(panel)[used], panel.counts[used], 0.9 / len(panel.counts), color=BAR)
    axes.bar_label(bars, [short_count(int(count)) for count in panel.counts[used]], color=INK, fontsize="small")


def _middles(panel: ReliabilityPanel) -> Float[np.ndarray, "b"]:
    return (np.arange(len(panel.counts)) + 0.5) / len(panel.counts)


def short_count(count: int) -> str:
    """The number in at most four characters: 987, 1.2k, 45k."""
    if count < 1000:
        return str(count)
    return f"{count / 1000:.1f}k" if count < 9950 else f"{count / 1000:.0f}k"
