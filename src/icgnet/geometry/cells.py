"""Grids of cubic cells in the table's frame: which part of space a dense network sees."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.geometry.workspace import SIZE

PITCH = 0.010
"""Edge of a cell [m]."""
ALIGNMENT = 8
"""Grids that are laid around points begin and end at multiples of so many cells: the coarsest cells of the dense part
then lie at the same places for all of them."""
ROOM = 0.09
"""How far such a grid reaches beyond the points at least [m]: one cell more than the dense part looks."""


@dataclass(frozen=True)
class CellGrid:
    """A box of cells; cell `(0, 0, 0)` of it begins at `lower` cells from the origin of the table's frame."""

    lower: tuple[int, int, int]
    shape: tuple[int, int, int]

    @property
    def origin(self) -> tuple[float, float, float]:
        """Where the grid begins [m, table frame]."""
        x, y, z = self.lower
        return (x * PITCH, y * PITCH, z * PITCH)

    @property
    def end(self) -> tuple[float, float, float]:
        """Where the grid ends [m, table frame]."""
        (x, y, z), (width, depth, height) = self.lower, self.shape
        return ((x + width) * PITCH, (y + depth) * PITCH, (z + height) * PITCH)

    def holds(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
        """Which points [m, table frame] lie in it, its faces included."""
        return np.all((points >= np.array(self.origin)) & (points <= np.array(self.end)), axis=1)

    def cells(self, points: Float[np.ndarray, "n 3"]) -> tuple[Int[np.ndarray, "n 3"], Bool[np.ndarray, "n"]]:
        """The cell of each point [m, table frame], and whether it belongs to the grid."""
        cells = np.floor(points / PITCH).astype(np.int64) - np.array(self.lower)
        return cells, np.all((cells >= 0) & (cells < np.array(self.shape)), axis=1)


_EDGE = round(SIZE / PITCH)
WORKSPACE_CELLS = CellGrid((0, 0, 0), (_EDGE, _EDGE, _EDGE))
"""The cells of the workspace."""


def cube_of_cells(edge: float) -> CellGrid:
    """The cube on the table about the middle of the workspace's, with this edge [m], to the next even cell."""
    cells = 2 * round(edge / PITCH / 2)
    first = (_EDGE - cells) // 2
    return CellGrid((first, first, 0), (cells, cells, cells))


def grid_around(points: Float[np.ndarray, "n 3"]) -> CellGrid:
    """The grid for a scene of any extent: all that is within `ROOM` of a point [m, table frame], from the table's foot.

    It begins and ends at multiples of `ALIGNMENT` cells, below at z = 0.
    """
    step = ALIGNMENT * PITCH
    lower = np.floor((points.min(axis=0) - ROOM) / step).astype(int)
    upper = np.ceil((points.max(axis=0) + ROOM) / step).astype(int)
    lower[2] = 0
    x, y, z = (ALIGNMENT * lower).tolist()
    width, depth, height = (ALIGNMENT * np.maximum(upper - lower, 1)).tolist()
    return CellGrid((x, y, z), (width, depth, height))
