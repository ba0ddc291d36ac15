"""Colours that stay apart for colour-blind readers: one per instance, and a scale for scores.

All colours are sRGB in [0, 1].
"""

import numpy as np
from jaxtyping import Float, Int
from matplotlib import colormaps

INK = (0.13, 0.15, 0.18)
"""Text and leader lines."""
QUIET_INK = (0.42, 0.45, 0.49)
"""Captions and scale numbers."""
PAPER = (1.0, 1.0, 1.0)
"""Background."""
UNASSIGNED = (0.72, 0.73, 0.75)
"""Points that belong to no instance."""
MARK = (0.85, 0.0, 0.10)
"""Dots that mark where something is wrong."""
REASON_COLOURS = {
    "low_score": (0.55, 0.57, 0.60),
    "too_wide": (0.45, 0.20, 0.60),
    "table": (0.55, 0.35, 0.12),
    "object": (0.80, 0.05, 0.10),
    "points": (0.96, 0.50, 0.10),
}
"""Rejected grasps, by reason."""

# Blues, oranges, reds, violets and browns; greens and yellows belong to the hands with high scores.
_INSTANCE_HEX = (
    "4477AA",
    "EE8866",
    "AA4488",
    "88BBEE",
    "996633",
    "BB99DD",
    "CC3344",
    "667788",
    "FFAABB",
    "5544AA",
    "CCAA88",
    "3399CC",
)


def _from_hex(codes: tuple[str, ...]) -> Float[np.ndarray, "k 3"]:
    return np.array([[int(code[i : i + 2], 16) for i in (0, 2, 4)] for code in codes]) / 255.0


_INSTANCES = _from_hex(_INSTANCE_HEX)


def instance_colours(instances: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """The colour of each instance id; ids below 0 are grey, and colours repeat after twelve instances."""
    colours = _INSTANCES[instances % len(_INSTANCES)]
    return np.where((instances < 0)[:, None], UNASSIGNED, colours)


def instance_colour(instance: int) -> tuple[float, float, float]:
    """The colour of one instance id."""
    red, green, blue = instance_colours(np.array([instance]))[0]
    return float(red), float(green), float(blue)


def score_colours(scores: Float[np.ndarray, "g"]) -> Float[np.ndarray, "g 3"]:
    """Colours of the scale viridis, dark violet (0) over green to yellow (1); values outside are clipped."""
    return colormaps["viridis"](np.clip(np.nan_to_num(scores), 0.0, 1.0))[:, :3]


def to_bytes(colour: tuple[float, float, float]) -> tuple[int, int, int]:
    """The colour as three numbers from 0 to 255, as Pillow and the browser take it."""
    red, green, blue = (round(255 * value) for value in colour)
    return red, green, blue
