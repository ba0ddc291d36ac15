"""From a cloud to what the network takes: sparse voxels and the dense grid."""

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from icgnet.errors import InputError
from icgnet.geometry.cells import PITCH, WORKSPACE_CELLS, CellGrid
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.network.config import NetworkConfig
from icgnet.network.sparse_conv import VoxelLevel

HEIGHT_UNIT = 0.1
MOMENT_KERNEL = 5
"""Voxels along an edge of the neighbourhood that moments are taken over; that of the first convolution, whose table
they share."""


@dataclass(frozen=True, eq=False)
class SceneInput:
    """One scene as the network takes it, in the table's frame, without the table."""

    voxels: Int[Tensor, "v 3"]
    """Indices of the occupied voxels (int64), any sign and extent."""
    positions: Float[Tensor, "v 3"]
    """Mean of the points of each voxel [m]."""
    dense: Float[Tensor, "d x y z"]
    """Occupancy of the cells of the grid; with visibility its value and a flag that it is known; with point inputs the
    mean offset of a cell's points from its centre, in cells."""
    grid: CellGrid = WORKSPACE_CELLS
    """Which cells these are."""
    viewpoint: Float[Tensor, "3"] | None = None
    """Where the camera stood [m], if it is known."""

    def to(self, device: torch.device | str) -> "SceneInput":
        """The same on another device."""
        viewpoint = None if self.viewpoint is None else self.viewpoint.to(device)
        voxels, positions, dense = (each.to(device) for each in (self.voxels, self.positions, self.dense))
        return SceneInput(voxels, positions, dense, self.grid, viewpoint)


def make_scene_input(
    points: Float[np.ndarray, "n 3"],
    config: NetworkConfig,
    visibility: Float[np.ndarray, "x y z"] | None = None,
    viewpoint: Float[np.ndarray, "3"] | None = None,
    grid: CellGrid = WORKSPACE_CELLS,
) -> tuple[SceneInput, Int[np.ndarray, " n"]]:
    """The network's input for a cloud, and for each point the row of its voxel.

    Args:
        points: surface points without the table [m, table frame]; points outside of the grid keep their voxels but do
            not appear in the dense part.
        config: of the network that will take it.
        visibility: projective signed distance of the cells of the dense grid (+1 free, -1 hidden), None if the
            viewpoint is not known. Ignored by a configuration without visibility.
        viewpoint: where the camera stood [m, table frame], None if it is not known.
        grid: the cells of the dense part.

    Raises:
        InputError: for an empty cloud, points that are not finite, or a visibility grid of another size.
    """
    points = np.asarray(points)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) == 0:
        raise InputError(f"points [n, 3] with n > 0 expected, got shape {points.shape}")
    if not np.isfinite(points).all():
        raise InputError("points contain NaN or infinity")
    voxels, point_to_voxel = _unique_rows(np.floor(points / config.voxel_size).astype(np.int64))
    counts = np.bincount(point_to_voxel, minlength=len(voxels))
    sums = np.stack([np.bincount(point_to_voxel, weights=points[:, axis]) for axis in range(3)], 1)
    dense = _dense_grid(points, config, visibility, grid)
    scene = SceneInput(
        voxels=torch.from_numpy(voxels),
        positions=torch.from_numpy((sums / counts[:, None]).astype(np.float32)),
        dense=torch.from_numpy(dense),
        grid=grid,
        viewpoint=None if viewpoint is None else torch.from_numpy(np.asarray(viewpoint, np.float32)),
    )
    return scene, point_to_voxel


def _unique_rows(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sorted unique rows and each row's place among them; by one key per row, much faster than np.unique(axis=0)."""
    lower = cells.min(0)
    extent = cells.max(0) - lower + 1
    keys = np.ravel_multi_index(tuple((cells - lower).T), tuple(extent))
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return cells[first], inverse


def _dense_grid(points: np.ndarray, config: NetworkConfig, visibility: np.ndarray | None, grid: CellGrid) -> np.ndarray:
    dense = np.zeros((config.dense_channels, *grid.shape), np.float32)
    cells, inside = grid.cells(points)
    rows = np.asarray(np.ravel_multi_index(tuple(cells[inside].T), grid.shape))
    dense[0].reshape(-1)[rows] = 1.0
    if config.visibility and visibility is not None:
        if visibility.shape != grid.shape:
            raise InputError(f"visibility {visibility.shape}: expected {grid.shape}")
        dense[1] = visibility
        dense[2] = 1.0
    if config.point_inputs:
        offsets = points[inside] / PITCH - np.array(grid.lower) - cells[inside] - 0.5
        dense[-3:] = _means(offsets, rows, dense[0].size).reshape(3, *grid.shape)
    return dense


def _means(values: np.ndarray, rows: np.ndarray, count: int) -> np.ndarray:
    """Mean of the values [n 3] in each of so many rows; 0 where there are none."""
    sums = [np.bincount(rows, weights=values[:, axis], minlength=count) for axis in range(3)]
    return np.stack(sums) / np.maximum(np.bincount(rows, minlength=count), 1)


def surface_features(level: VoxelLevel, positions: Float[Tensor, "v 3"], config: NetworkConfig) -> Float[Tensor, "v c"]:
    """What the sparse part sees of every voxel: 1, the offset of its points, its height, and what is around.

    Paper: the constant 1. Differs in preset `default`: offsets from the voxel's centre [voxels], the height above the
    table [10 cm] and `local_moments` follow.

    Args:
        level: the finest voxels of a batch.
        positions: mean of the points of each [m, workspace frame].
        config: says which of them are wanted.
    """
    parts = [positions.new_ones(len(positions), 1)]
    if config.point_inputs:
        parts.append(positions / config.voxel_size - level.coordinates[:, 1:] - 0.5)
        parts.append((positions[:, 2:] - TABLE_HEIGHT) / HEIGHT_UNIT)
    if config.local_moments:
        parts.append(local_moments(level, positions, config.voxel_size))
    return torch.cat(parts, 1)


def second_moments(positions: Float[Tensor, "v 3"]) -> Float[Tensor, "v 6"]:
    """The products xx, xy, xz, yy, yz, zz of each position's coordinates."""
    x, y, z = positions.unbind(1)
    return torch.stack([x * x, x * y, x * z, y * y, y * z, z * z], 1)


def local_moments(level: VoxelLevel, positions: Float[Tensor, "v 3"], voxel_size: float) -> Float[Tensor, "v 9"]:
    """Mean and covariance of the points of the 5^3 voxels around every voxel.

    On a plane the covariance, divided by its trace, is half of what is left of the identity without the normal's
    outer product: orientation without a sign, and no eigenvectors are needed.

    Returns:
        Mean relative to the voxel's own point [voxels], and xx, xy, xz, yy, yz, zz of the covariance over its trace.
    """
    # About the middle of all, for the precision of the squares.
    centred = positions - 0.5 * (positions.amin(0) + positions.amax(0))
    own = torch.cat([centred.new_ones(len(centred), 1), centred, second_moments(centred)], 1)
    padded = torch.cat([own, own.new_zeros(1, own.shape[1])])
    sums = nn.functional.embedding_bag(level.neighbours(MOMENT_KERNEL), padded, mode="sum")
    mean, second = sums[:, 1:4] / sums[:, :1], sums[:, 4:] / sums[:, :1]
    covariance = second - second_moments(mean)
    trace = covariance[:, [0, 3, 5]].sum(1, keepdim=True)
    # A voxel alone has none, but for what rounding leaves.
    covariance = torch.where(trace > (1e-1 * voxel_size) ** 2, covariance / trace.clamp(min=1e-12), 0.0)
    return torch.cat([(mean - centred) / voxel_size, covariance], 1)
