"""Reliability diagrams: what share of the grasps with a score really succeeds, and how many grasps have it."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from PIL import Image, ImageDraw

from icgnet.errors import InputError
from icgnet.viewer.annotate import Colour, Length, Pixel, text_width, write
from icgnet.viewer.palette import INK, PAPER, QUIET_INK, to_bytes

PLOT = 450
"""Side of the plotted square [pixels]."""
COUNTS = 110
"""Height of the bars that say how many grasps a bin holds [pixels]."""
LEFT, TOP, RIGHT, GAP, BOTTOM = 62, 62, 22, 56, 58
PANEL_SIZE = (LEFT + PLOT + RIGHT, TOP + PLOT + GAP + COUNTS + BOTTOM)
FINER = 3
"""Lines are drawn so many times larger and then made smaller, which smooths them."""
TEXT_SIZE, SMALL_SIZE, TITLE_SIZE = 15, 11, 18
TICKS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)

BAR = (0.70, 0.80, 0.90)
DOT = (0.16, 0.38, 0.62)
BEST = (0.86, 0.42, 0.12)
GRID = (0.90, 0.91, 0.92)


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
    width, height = PANEL_SIZE
    picture = Image.new("RGB", (width * len(panels), height), to_bytes(PAPER))
    for number, panel in enumerate(panels):
        picture.paste(_draw_panel(panel), (number * width, 0))
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    picture.save(path)


def _draw_panel(panel: ReliabilityPanel) -> Image.Image:
    large = Image.new("RGB", (FINER * PANEL_SIZE[0], FINER * PANEL_SIZE[1]), to_bytes(PAPER))
    pen = _Pen(ImageDraw.Draw(large))
    _draw_shares(pen, panel)
    heights = _draw_counts(pen, panel)
    image = large.resize(PANEL_SIZE, Image.Resampling.LANCZOS)
    _write_axes(image, panel)
    for middle, top, count in zip(_middles(panel), heights, panel.counts, strict=True):
        if count:
            _write_centred(image, short_count(int(count)), (middle, top - SMALL_SIZE - 4), SMALL_SIZE, INK)
    return image


def short_count(count: int) -> str:
    """The number in at most four characters: 987, 1.2k, 45k."""
    if count < 1000:
        return str(count)
    return f"{count / 1000:.1f}k" if count < 9950 else f"{count / 1000:.0f}k"


class _Pen:
    """Draws on the larger picture in pixels of the final one."""

    def __init__(self, draw: ImageDraw.ImageDraw) -> None:
        self.draw = draw

    def box(self, left: Length, top: Length, right: Length, bottom: Length, colour: Colour) -> None:
        self.draw.rectangle([FINER * left, FINER * top, FINER * right, FINER * bottom], fill=to_bytes(colour))

    def line(self, points: Sequence[Pixel], colour: Colour, width: Length = 1) -> None:
        scaled = [(FINER * x, FINER * y) for x, y in points]
        self.draw.line(scaled, fill=to_bytes(colour), width=round(FINER * width))

    def dot(self, x: Length, y: Length, radius: Length, colour: Colour, corners: int = 24) -> None:
        turn = np.linspace(0, 2 * np.pi, corners, endpoint=False)
        points = [(FINER * (x + radius * np.cos(a)), FINER * (y + radius * np.sin(a))) for a in turn]
        self.draw.polygon(points, fill=to_bytes(colour), outline=to_bytes(PAPER))


def _x(share: float) -> float:
    return LEFT + PLOT * share


def _y(share: float) -> float:
    return TOP + PLOT * (1.0 - share)


def _middles(panel: ReliabilityPanel) -> list[float]:
    bins = len(panel.counts)
    return [_x((k + 0.5) / bins) for k in range(bins)]


def _draw_shares(pen: _Pen, panel: ReliabilityPanel) -> None:
    bins, used = len(panel.counts), np.flatnonzero(panel.counts)
    for tick in TICKS:
        pen.line([(_x(tick), _y(0.0)), (_x(tick), _y(1.0))], GRID)
        pen.line([(_x(0.0), _y(tick)), (_x(1.0), _y(tick))], GRID)
    for k in used:
        pen.box(_x(k / bins) + 1.5, _y(panel.shares[k]), _x((k + 1) / bins) - 1.5, _y(0.0), BAR)
    pen.line([(_x(0.0), _y(0.0)), (_x(1.0), _y(1.0))], QUIET_INK, 1.5)
    pen.line([(_x(panel.scores[k]), _y(panel.shares[k])) for k in used], DOT, 1.5)
    for k in used:
        pen.dot(_x(panel.scores[k]), _y(panel.shares[k]), 5.0, DOT)
    pen.line([(_x(0.0), _y(1.0)), (_x(0.0), _y(0.0)), (_x(1.0), _y(0.0))], INK)
    if panel.best_score is not None and panel.best_success is not None:
        pen.dot(_x(panel.best_score), _y(panel.best_success), 9.0, BEST, corners=4)
        pen.dot(_x(0.04), _y(0.95), 7.0, BEST, corners=4)


def _draw_counts(pen: _Pen, panel: ReliabilityPanel) -> list[float]:
    """Draws the bars and returns where each ends."""
    bins, floor = len(panel.counts), TOP + PLOT + GAP + COUNTS
    # A single grasp must show, hence the logarithm of one more.
    share = np.log1p(panel.counts) / np.log1p(panel.counts.max())
    tops = [float(floor - COUNTS * 0.85 * each) for each in share]
    for k, top in enumerate(tops):
        if panel.counts[k]:
            pen.box(_x(k / bins) + 1.5, top, _x((k + 1) / bins) - 1.5, floor, BAR)
    pen.line([(_x(0.0), floor), (_x(1.0), floor)], INK)
    return tops


def _write_axes(image: Image.Image, panel: ReliabilityPanel) -> None:
    floor = TOP + PLOT + GAP + COUNTS
    write(image, panel.caption, (LEFT, 12), TITLE_SIZE, bold=True)
    write(image, "share of successes", (LEFT - 48, TOP - 24), TEXT_SIZE, QUIET_INK)
    for tick in TICKS:
        text = f"{tick:.1f}"
        _write_centred(image, text, (_x(tick), _y(0.0) + 6), TEXT_SIZE, QUIET_INK)
        _write_centred(image, text, (_x(tick), floor + 6), TEXT_SIZE, QUIET_INK)
        write(
            image, text, (LEFT - 10 - text_width(text, TEXT_SIZE), _y(tick) - TEXT_SIZE / 2 - 2), TEXT_SIZE, QUIET_INK
        )
    write(image, f"grasps in each bin, {int(panel.counts.sum())} in all", (LEFT, _y(0.0) + 28), TEXT_SIZE, QUIET_INK)
    _write_centred(image, "score", (_x(0.5), floor + 28), TEXT_SIZE, QUIET_INK)
    if panel.best_score is not None and panel.best_success is not None:
        text = f"best seen grasp of each scene: score {panel.best_score:.2f}, success {panel.best_success:.2f}"
        write(image, text, (_x(0.06), _y(0.95) - TEXT_SIZE / 2 - 2), TEXT_SIZE, INK)


def _write_centred(image: Image.Image, text: str, place: Pixel, size: int, colour: Colour) -> None:
    write(image, text, (place[0] - text_width(text, size) / 2, place[1]), size, colour)
