"""A table that is larger than the workspace cube, seen through several overlapping cubes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from icgnet.errors import InputError
from icgnet.geometry.workspace import SIZE, contains

STRIDE = SIZE / 2
"""Distance between neighbouring windows [m]: an object of up to this size is seen whole by at least one."""
MOST_WINDOWS = 100
"""More than this is no table top but a room, or a cloud in the wrong unit."""


@dataclass(frozen=True, eq=False)
class Window:
    """A workspace cube somewhere on the table; its axes are those of the table frame.

    Attributes:
        origin: corner of the cube, table frame [m]; z is 0, since the table is at the same height in all windows.
    """

    origin: Float[np.ndarray, "3"]

    def to_window(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the table frame in the window [m]."""
        return points - self.origin

    def inside(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "m"]:
        """Indices of the points of the table frame [m] that lie in the cube."""
        return np.flatnonzero(contains(self.to_window(points)))

    @property
    def centre(self) -> Float[np.ndarray, "2"]:
        """Middle of the cube on the table, table frame [m]."""
        return self.origin[:2] + SIZE / 2


def cover(points: Float[np.ndarray, "n 3"], fewest: int = 1) -> list[Window]:
    """Windows that together see all points: one if they fit, else a lattice with half-overlapping cubes.

    Args:
        points: what stands on the table, table frame [m].
        fewest: windows whose core (what lies nearer to it than to any other) has fewer points are left out.

    Raises:
        InputError: the points spread over more than `MOST_WINDOWS` windows.
    """
    if len(points) == 0:
        return []
    lower, upper = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    if (lower >= 0).all() and (upper <= SIZE).all():
        return [Window(np.zeros(3))]
    counts = np.maximum(np.ceil((upper - lower - SIZE) / STRIDE), 0).astype(int) + 1
    if counts.prod() > MOST_WINDOWS:
        raise InputError(
            f"what stands on the table spans {upper[0] - lower[0]:.2f} x {upper[1] - lower[1]:.2f} m: "
            f"more than {MOST_WINDOWS} windows of {SIZE} m; crop the input or give a mask"
        )
    first = (lower + upper - SIZE - STRIDE * (counts - 1)) / 2
    corners = np.stack(np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"), -1).reshape(-1, 2)
    windows = [Window(np.array([*(first + STRIDE * corner), 0.0])) for corner in corners]
    seen = np.bincount(owners(windows, points), minlength=len(windows))
    return [window for window, count in zip(windows, seen, strict=True) if count >= min(fewest, seen.max())]


def owners(windows: list[Window], points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n"]:
    """Index of the window whose middle is nearest to each point of the table frame [m]."""
    centres = np.stack([window.centre for window in windows])
    return ((points[:, None, :2] - centres) ** 2).sum(axis=-1).argmin(axis=1)
