"""Whether scores mean what they say: of the grasps with a score of 0.9, nine in ten should succeed."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

BINS = 15

Spread = Literal["mass", "width"]
"""Bins with equally many grasps each, or bins of equal width from 0 to 1."""


@dataclass(frozen=True, eq=False)
class Reliability:
    """Grasps in bins of their scores.

    Attributes:
        scores: [b] mean score in each bin, NaN in an empty one.
        shares: [b] share of successes in each bin, NaN in an empty one.
        counts: [b] grasps in each bin.
    """

    scores: Float[np.ndarray, "b"]
    shares: Float[np.ndarray, "b"]
    counts: Int[np.ndarray, "b"]

    @property
    def error(self) -> float:
        """Expected calibration error: mean distance between score and share over the grasps; 0 without grasps."""
        used = self.counts > 0
        distances = np.abs(self.scores - self.shares)[used]
        return float(distances @ self.counts[used] / max(self.counts.sum(), 1))


def reliability(
    scores: Float[np.ndarray, "n"], labels: Bool[np.ndarray, "n"], spread: Spread = "mass", bins: int = BINS
) -> Reliability:
    """The grasps in bins of their scores.

    Grasps with the same score share a bin, so that bins of equal mass are only about equal, and some may be empty.

    Args:
        scores: from 0 to 1.
        labels: whether the grasp succeeded.
        spread: how the bins are laid.
        bins: their number.
    """
    inner = np.linspace(0.0, 1.0, bins + 1)[1:-1]
    edges = inner if spread == "width" or len(scores) == 0 else np.quantile(scores, inner)
    index = np.searchsorted(edges, scores, side="right")
    counts = np.bincount(index, minlength=bins)
    sums = [np.bincount(index, values.astype(np.float64), minlength=bins) for values in (scores, labels)]
    means = [np.divide(total, counts, out=np.full(bins, np.nan), where=counts > 0) for total in sums]
    return Reliability(means[0], means[1], counts)
