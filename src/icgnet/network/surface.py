"""Meshes from an occupancy field: coarse to fine, closed."""

from collections.abc import Callable

import numpy as np
import torch
import trimesh
from jaxtyping import Float
from skimage import measure
from torch import Tensor

from icgnet.errors import InputError
from icgnet.network.lattice import Lattice

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

    Starts with a coarse grid and halves only the cells that the surface passes through and those around points that
    were seen on it, see `Lattice`: away from these, a thing thinner than a cell of the coarse grid can be missed. A
    shape that reaches the border of the box is cut off and closed there.

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
    lattice = Lattice.over(lower, upper, pitch * 2**halvings)
    _fill(lattice, occupancy)
    for _ in range(halvings):
        lattice = lattice.halved(seen)
        _fill(lattice, occupancy)
    return _marching_cubes(lattice.values, lower, pitch)


def _fill(lattice: Lattice, occupancy: Callable[[Tensor], Tensor]) -> None:
    while len(nodes := lattice.missing()):
        points = torch.from_numpy(lattice.positions(nodes).astype(np.float32))
        lattice.fill(nodes, torch.cat([occupancy(part).float().cpu() for part in points.split(_BATCH)]).numpy())


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
