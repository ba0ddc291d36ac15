"""Meshes from an occupancy field: coarse to fine, closed."""

from collections.abc import Callable

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float
from scipy import ndimage
from skimage import measure
from torch import Tensor

from icgnet.errors import InputError

_COARSEST = 16
_BATCH = 1 << 14


@torch.no_grad()
def extract_mesh(
    occupancy: Callable[[Tensor], Tensor],
    lower: Float[np.ndarray, "3"],
    upper: Float[np.ndarray, "3"],
    resolution: int = 64,
    seen: Float[np.ndarray, "n 3"] | None = None,
) -> trimesh.Trimesh:
    """Closed surface where an occupancy field crosses 0, inside a box; an empty mesh if it crosses nowhere.

    Starts with a coarse grid and halves only the cells near the surface (as MISE does) and around points that were seen
    on it: away from these, a thing thinner than a cell of the coarse grid can be missed. A shape that reaches the
    border of the box is cut off and closed there.

    Args:
        occupancy: from points `[n, 3]` (float32 [m]) to logits `[n]`, above 0 inside.
        lower: lower corner of the box [m].
        upper: upper corner of the box [m].
        resolution: cells along the longest edge of the box; rounded up to a multiple of the coarse grid's.
        seen: points near the surface [m], if any are known.

    Raises:
        InputError: for an empty box or a resolution below 2.
    """
    lower, upper = np.asarray(lower, np.float64), np.asarray(upper, np.float64)
    if resolution < 2 or not (upper > lower).all():
        raise InputError(f"no box to extract from: {lower} to {upper} at resolution {resolution}")
    halvings = max(0, int(np.ceil(np.log2(resolution / _COARSEST))))
    pitch = (upper - lower).max() / resolution
    coarse_pitch = pitch * 2**halvings
    cells = np.maximum(1, np.ceil((upper - lower) / coarse_pitch - 1e-6)).astype(int)

    values = _evaluate(occupancy, np.argwhere(np.ones(cells + 1, bool)), lower, coarse_pitch).reshape(cells + 1)
    for halving in range(halvings):
        crossed = _cells_crossed(values)
        if seen is not None:
            crossed |= cells_with(seen, lower, coarse_pitch / 2**halving, crossed.shape)
        active = _double_cells(ndimage.binary_dilation(crossed, np.ones((3, 3, 3))))
        values = _double_vertices(values)
        wanted = np.argwhere(_vertices_of(active))
        wanted = wanted[(wanted % 2 != 0).any(1)]
        values[tuple(wanted.T)] = _evaluate(occupancy, wanted, lower, coarse_pitch / 2 ** (halving + 1))
    return _marching_cubes(values, lower, pitch)


def _evaluate(
    occupancy: Callable[[Tensor], Tensor], vertices: np.ndarray, lower: np.ndarray, pitch: float
) -> np.ndarray:
    points = torch.from_numpy((lower + vertices * pitch).astype(np.float32))
    parts = [occupancy(part).float().cpu() for part in points.split(_BATCH)]
    return torch.cat(parts).numpy() if parts else np.zeros(0, np.float32)


def _cells_crossed(values: np.ndarray) -> np.ndarray:
    """Cells with corners of both signs."""
    corners = np.stack([values[_shift(x), _shift(y), _shift(z)] for x in (0, 1) for y in (0, 1) for z in (0, 1)])
    return (corners.min(0) <= 0) & (corners.max(0) > 0)


def cells_with(
    points: Float[np.ndarray, "n 3"], lower: Float[np.ndarray, "3"], pitch: float, shape: tuple[int, ...]
) -> Bool[np.ndarray, "x y z"]:
    """Which cells of a grid of this shape hold a point; points outside of the grid are in none.

    Args:
        points: positions [m].
        lower: corner of the first cell [m].
        pitch: size of a cell [m].
        shape: number of cells along each axis.
    """
    cells = np.floor((points - lower) / pitch).astype(np.int64)
    cells = cells[((cells >= 0) & (cells < shape)).all(axis=1)]
    held = np.zeros(shape, bool)
    held[tuple(cells.T)] = True
    return held


def _shift(side: int) -> slice:
    return slice(1, None) if side else slice(None, -1)


def _double_cells(cells: np.ndarray) -> np.ndarray:
    return cells.repeat(2, 0).repeat(2, 1).repeat(2, 2)


def _double_vertices(values: np.ndarray) -> np.ndarray:
    """Values at twice the resolution, the new ones by linear interpolation."""
    for axis in range(3):
        values = np.moveaxis(values, axis, 0)
        doubled = np.empty((2 * len(values) - 1, *values.shape[1:]), values.dtype)
        doubled[::2] = values
        doubled[1::2] = (values[1:] + values[:-1]) / 2
        values = np.moveaxis(doubled, 0, axis)
    return values


def _vertices_of(cells: np.ndarray) -> np.ndarray:
    vertices = np.zeros(np.array(cells.shape) + 1, bool)
    for x in (0, 1):
        for y in (0, 1):
            for z in (0, 1):
                vertices[_shift(x), _shift(y), _shift(z)] |= cells
    return vertices


def _marching_cubes(values: np.ndarray, lower: np.ndarray, pitch: float) -> trimesh.Trimesh:
    largest = max(float(np.abs(values).max()), 1e-6)
    padded = np.pad(values, 1, constant_values=-largest)
    if padded.max() <= 0:
        return trimesh.Trimesh()
    # a surface exactly through a grid point would have triangles without area: keep it a little away on either side
    away = 1e-4 * largest
    padded = np.where(padded > 0, np.maximum(padded, away), np.minimum(padded, -away))
    vertices, faces, _, _ = measure.marching_cubes(padded, 0.0, gradient_direction="ascent")
    return trimesh.Trimesh(lower + (vertices - 1) * pitch, faces, process=False)
