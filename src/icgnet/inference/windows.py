"""A table that is larger than the workspace cube, seen through several overlapping cubes, or through larger ones."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT, contains

STRIDE = SIZE / 2
"""Distance between neighbouring windows [m]: an object of up to this size is seen whole by at least one."""
MOST_WINDOWS = 100
"""More than this is no table top but a room, or a cloud in the wrong unit."""


@dataclass(frozen=True, eq=False)
class Window:
    """A cube somewhere on the table, which the network sees as its workspace; its axes are those of the table frame.

    Attributes:
        corner: x, y of the lower corner of the cube, table frame [m].
        scale: lengths in the window by lengths on the table: at 0.5 a cube of 0.6 m is seen, and all things in it at
            half their size. The table is at the same height in all windows.
    """

    corner: Float[np.ndarray, "2"]
    scale: float = 1.0

    @property
    def origin(self) -> Float[np.ndarray, "3"]:
        """What the window takes for its origin, table frame [m]."""
        return np.array([*self.corner, TABLE_HEIGHT * (1.0 - 1.0 / self.scale)])

    @property
    def size(self) -> float:
        """Edge of the cube [m]."""
        return SIZE / self.scale

    @property
    def T_table_window(self) -> Float[np.ndarray, "4 4"]:
        """From the window to the table frame; scales, too."""
        return make_transform(np.eye(3) / self.scale, self.origin)

    def to_window(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the table frame in the window [m]."""
        return self.scale * (points - self.origin)

    def inside(self, points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "m"]:
        """Indices of the points of the table frame [m] that lie in the cube."""
        return np.flatnonzero(contains(self.to_window(points)))

    @property
    def centre(self) -> Float[np.ndarray, "2"]:
        """Middle of the cube on the table, table frame [m]."""
        return self.corner + self.size / 2


def cover(points: Float[np.ndarray, "n 3"], fewest: int = 1, scale: float = 1.0) -> list[Window]:
    """Windows that together see all points: one if they fit, else a lattice with half-overlapping cubes.

    Args:
        points: what stands on the table, table frame [m].
        fewest: windows whose core (what lies nearer to it than to any other) has fewer points are left out.
        scale: of the windows.

    Raises:
        InputError: the points spread over more than `MOST_WINDOWS` windows.
    """
    if len(points) == 0:
        return []
    lower, upper = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    if scale == 1.0 and (lower >= 0).all() and (upper <= SIZE).all():
        return [Window(np.zeros(2), scale)]
    size, stride = SIZE / scale, STRIDE / scale
    counts = np.maximum(np.ceil((upper - lower - size) / stride), 0).astype(int) + 1
    if counts.prod() > MOST_WINDOWS:
        raise InputError(
            f"what stands on the table spans {upper[0] - lower[0]:.2f} x {upper[1] - lower[1]:.2f} m: "
            f"more than {MOST_WINDOWS} windows of {size} m; crop the input or give a mask"
        )
    first = (lower + upper - size - stride * (counts - 1)) / 2
    corners = np.stack(np.meshgrid(*(np.arange(count) for count in counts), indexing="ij"), -1).reshape(-1, 2)
    windows = [Window(first + stride * corner, scale) for corner in corners]
    seen = np.bincount(owners(windows, points), minlength=len(windows))
    return [window for window, count in zip(windows, seen, strict=True) if count >= min(fewest, seen.max())]


def fullest_first(windows: list[Window], points: Float[np.ndarray, "n 3"]) -> list[Window]:
    """The windows in the order of how many of the points of the table frame [m] they hold."""
    return sorted(windows, key=lambda window: -len(window.inside(points)))


def owners(windows: list[Window], points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "n"]:
    """Index of the window whose middle is nearest to each point of the table frame [m]."""
    centres = np.stack([window.centre for window in windows])
    return ((points[:, None, :2] - centres) ** 2).sum(axis=-1).argmin(axis=1)
