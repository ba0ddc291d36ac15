"""Truncated signed distances from depth images, and the cloud of points on their zero crossing.

The published clutter-removal benchmarks hand their methods such a cloud instead of raw depth points. Numpy only: a grid
of 180^3 has 5.8 million voxels, but a surface passes through few of them, so only blocks of 4^3 voxels near measured
points are computed.

Source: Curless and Levoy, "A Volumetric Method for Building Complex Models from Range Images", 1996, in the form that
Open3D's uniform TSDF volume gives it.

Differs from Open3D: no colours and no normals; the outermost layer of voxels yields points as well; voxels farther from
all measured points than the truncation are left out, which changes no point.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from icgnet.errors import InputError
from icgnet.geometry.camera import check_intrinsics
from icgnet.geometry.transforms import check_transform, invert_transform
from icgnet.geometry.workspace import SIZE

TRUNCATION_VOXELS = 4.0
"""Distances are cut off at this many voxels, as in all published pipelines."""
SATURATED = 0.98
"""A voxel with a truncated distance of at least this lies too far from the surface to interpolate with."""
FARTHEST_DEPTH = 2.0
"""Depths beyond this are not used [m]."""
BLOCK = 4
"""Voxels along the edge of a block; no less than the truncation."""
CHUNK = 512
"""Blocks that are computed at a time: their numbers stay in the cache."""


@dataclass(frozen=True, eq=False)
class Tsdf:
    """Truncated signed distances near surfaces, in blocks of 4^3 voxels of a cubic grid with a corner at the origin.

    Attributes:
        blocks: [b 3] position of each block, in blocks along x, y, z.
        distances: [4 4 4 b] mean distance in front of the surface in units of the truncation, from -1 (behind) to 1;
            NaN where no image has seen the voxel. Blocks come last, since numpy is slow on short last axes.
        voxel: edge of a voxel [m]; voxel (i, j, k) has its centre at (i + 0.5, j + 0.5, k + 0.5) * voxel.
        resolution: voxels along an edge of the grid.
    """

    blocks: Int[np.ndarray, "b 3"]
    distances: Float32[np.ndarray, "4 4 4 b"]
    voxel: float
    resolution: int

    def surface_points(self) -> Float[np.ndarray, "n 3"]:
        """Points [m] where the distance changes its sign between two neighbouring voxels along x, y or z."""
        usable = np.where(np.abs(self.distances) < SATURATED, self.distances, np.float32(np.nan))
        parts = [found for axis in range(3) for found in self._crossings(usable, axis)]
        return (np.concatenate(parts) + 0.5) * self.voxel

    def _crossings(self, values: Float32[np.ndarray, "4 4 4 b"], axis: int) -> list[Float[np.ndarray, "_ 3"]]:
        """Where the sign changes along an axis [voxels]: inside of blocks, and between a block and the next."""
        block, inner = _sign_changes(_layers(values, axis, 0, BLOCK - 1), _layers(values, axis, 1, BLOCK), axis)
        following = self._following(axis)
        linked = np.flatnonzero(following >= 0)
        last, first = _layers(values, axis, BLOCK - 1, BLOCK), _layers(values, axis, 0, 1)
        link, between = _sign_changes(last[..., linked], first[..., following[linked]], axis)
        to_last_layer = (BLOCK - 1) * np.eye(3)[axis]
        return [self.blocks[block] * BLOCK + inner, self.blocks[linked[link]] * BLOCK + between + to_last_layer]

    def _following(self, axis: int) -> Int[np.ndarray, "b"]:
        """Index of the block after each block along an axis, -1 where there is none."""
        count = -(-self.resolution // BLOCK)
        number = np.full((count + 1,) * 3, -1)
        number[tuple(self.blocks.T)] = np.arange(len(self.blocks))
        return number[tuple((self.blocks + np.eye(3, dtype=int)[axis]).T)]


def fuse(
    depths: Sequence[Float[np.ndarray, "_ _"]],
    intrinsics: Sequence[Float[np.ndarray, "3 3"]],
    T_world_cameras: Sequence[Float[np.ndarray, "4 4"]],
    resolution: int,
    size: float = SIZE,
    least_height: float = 0.0,
) -> Tsdf:
    """The truncated signed distances that one or more depth images of the cube [0, size]^3 give together.

    Args:
        depths: along the camera's z axis [m]; 0 or not finite means not measured.
        intrinsics: camera matrix of each image [pixels].
        T_world_cameras: camera pose of each image.
        resolution: voxels along an edge of the cube; 180, 120 and 40 are published.
        size: edge of the cube [m].
        least_height: the surface below this is not wanted, world frame [m]; most pixels show the table.

    Raises:
        InputError: no image, other numbers of intrinsics or poses, unusable ones, or a resolution below 1.
    """
    if not depths or not len(depths) == len(intrinsics) == len(T_world_cameras):
        raise InputError(
            "every depth image needs intrinsics and a pose, "
            f"got {len(depths)} images, {len(intrinsics)} intrinsics, {len(T_world_cameras)} poses"
        )
    if resolution < 1:
        raise InputError(f"resolution must be at least 1, got {resolution}")
    voxel = size / resolution
    views = [_View.of(*each) for each in zip(depths, intrinsics, T_world_cameras, strict=True)]
    blocks = _blocks_near(views, resolution, voxel, least_height)
    distances = np.empty((BLOCK**3, len(blocks)), np.float32)
    for first in range(0, len(blocks), CHUNK):
        chunk = slice(first, first + CHUNK)
        distances[:, chunk] = _mean_distances([view.distances(blocks[chunk], voxel) for view in views])
    distances = distances.reshape(BLOCK, BLOCK, BLOCK, -1)
    # The grid's edge need not be a multiple of a block.
    distances[~_inside(blocks, resolution)] = np.nan
    return Tsdf(blocks, distances, voxel, resolution)


@dataclass(frozen=True, eq=False)
class _View:
    """A depth image as the fusion needs it.

    Attributes:
        depth: [h w] along the optical axis [m], 0 for not measured.
        stretch: [h w] length of the ray of a pixel for a depth of 1.
        intrinsics: camera matrix [pixels].
        T_camera_world: from the world to the camera.
    """

    depth: Float32[np.ndarray, "h w"]
    stretch: Float32[np.ndarray, "h w"]
    intrinsics: Float32[np.ndarray, "3 3"]
    T_camera_world: Float32[np.ndarray, "4 4"]

    @staticmethod
    def of(
        depth: Float[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], T_world_camera: Float[np.ndarray, "4 4"]
    ) -> "_View":
        matrix = check_intrinsics(intrinsics).astype(np.float32)
        pose = invert_transform(check_transform(T_world_camera, "T_world_camera")).astype(np.float32)
        # Comparisons with NaN are false, so what is not finite counts as not measured.
        usable = np.where((depth > 0) & (depth <= FARTHEST_DEPTH), depth, 0.0).astype(np.float32)
        x, y = (_slope(usable.shape, matrix, np.eye(3)[axis]) for axis in range(2))
        return _View(usable, np.sqrt(x * x + y * y + 1), matrix, pose)

    def points(self) -> list[Float32[np.ndarray, "h w"]]:
        """Coordinates x, y and z of every pixel's point in the world [m]."""
        R, t = self.T_camera_world[:3, :3], self.T_camera_world[:3, 3]
        origin = -t @ R
        return [self.depth * _slope(self.depth.shape, self.intrinsics, R[:, i]) + origin[i] for i in range(3)]

    def distances(self, blocks: Int[np.ndarray, "b 3"], voxel: float) -> Float32[np.ndarray, "64 b"]:
        """Distance of each voxel of the blocks in front of the surface on its ray, in truncations; NaN if not seen."""
        x, y, depth = self._voxel_centres(blocks, voxel)
        (fx, skew, cx), (_, fy, cy), _ = self.intrinsics
        seen = depth > 0
        scale = np.float32(1.0) / np.where(seen, depth, np.float32(1.0))
        # Every voxel asks the pixel that its centre falls into.
        u = np.floor((fx * x + skew * y) * scale + (cx + np.float32(0.5)))
        v = np.floor(fy * y * scale + (cy + np.float32(0.5)))
        height, width = self.depth.shape
        seen &= (u >= 0) & (u < width) & (v >= 0) & (v < height)
        pixel = np.where(seen, v * np.float32(width) + u, np.float32(0.0)).astype(np.int32)
        measured = self.depth.ravel()[pixel]
        distance = (measured - depth) * self.stretch.ravel()[pixel]
        distance *= np.float32(1.0 / (TRUNCATION_VOXELS * voxel))
        seen &= (measured > 0) & (distance > -1.0)
        return np.where(seen, np.minimum(distance, np.float32(1.0)), np.float32(np.nan))

    def _voxel_centres(self, blocks: Int[np.ndarray, "b 3"], voxel: float) -> list[Float32[np.ndarray, "64 b"]]:
        """Coordinates x, y and z of the centres of all voxels in the camera's frame [m]."""
        R, t = self.T_camera_world[:3, :3], self.T_camera_world[:3, 3]
        corners = (blocks * (BLOCK * voxel)).astype(np.float32) @ R.T + t
        steps = np.indices((BLOCK, BLOCK, BLOCK)).reshape(3, -1).T + 0.5
        offsets = (steps * voxel).astype(np.float32) @ R.T
        return [offsets[:, axis, None] + corners[:, axis] for axis in range(3)]


def _slope(
    shape: tuple[int, ...], intrinsics: Float[np.ndarray, "3 3"], direction: Float[np.ndarray, "3"]
) -> Float32[np.ndarray, "h w"]:
    """How far each pixel's ray goes in a direction of the camera's frame at a depth of 1."""
    (fx, skew, cx), (_, fy, cy), _ = intrinsics
    y = (np.arange(shape[0]) - cy) / fy
    by_column = direction[0] * (np.arange(shape[1]) - cx) / fx
    by_row = (direction[1] - direction[0] * skew / fx) * y + direction[2]
    return by_column.astype(np.float32) + by_row.astype(np.float32)[:, None]


def _mean_distances(distances: list[Float32[np.ndarray, "64 b"]]) -> Float32[np.ndarray, "64 b"]:
    """Mean over the images that have seen a voxel, NaN where none has."""
    if len(distances) == 1:
        return distances[0]
    stacked = np.stack(distances)
    with np.errstate(invalid="ignore"):
        return np.nansum(stacked, axis=0) / np.isfinite(stacked).sum(axis=0, dtype=np.float32)


def _blocks_near(views: Sequence[_View], resolution: int, voxel: float, least_height: float) -> Int[np.ndarray, "b 3"]:
    """Positions of all blocks that may hold a voxel within the truncation distance of a measured point.

    A block is as wide as the truncation, so these are the blocks of the points and the 26 around each of them.
    """
    count = -(-resolution // BLOCK)
    # One more layer on either side holds the points outside of the grid whose neighbours lie inside.
    marked = np.zeros((count + 2,) * 3, dtype=bool)
    for view in views:
        points = view.points()
        wanted = (view.depth > 0) & (points[2] >= least_height)
        cells = np.stack([each[wanted] for each in points]) * np.float32(1.0 / (BLOCK * voxel))
        cells = np.floor(cells).astype(np.int64) + 1
        x, y, z = cells[:, np.all((cells >= 0) & (cells < count + 2), axis=0)]
        marked[x, y, z] = True
    for axis in range(3):
        along = np.moveaxis(marked, axis, 0)
        grown = along.copy()
        grown[1:] |= along[:-1]
        grown[:-1] |= along[1:]
        marked = np.moveaxis(grown, 0, axis)
    return np.argwhere(marked[1:-1, 1:-1, 1:-1])


def _inside(blocks: Int[np.ndarray, "b 3"], resolution: int) -> Bool[np.ndarray, "4 4 4 b"]:
    """Which voxels of the blocks belong to the grid."""
    if resolution % BLOCK == 0:
        return np.ones((BLOCK, BLOCK, BLOCK, len(blocks)), dtype=bool)
    x, y, z = ((blocks[:, axis] * BLOCK + np.arange(BLOCK)[:, None]) < resolution for axis in range(3))
    return x[:, None, None] & y[None, :, None] & z[None, None]


def _layers(values: Float32[np.ndarray, "4 4 4 b"], axis: int, start: int, stop: int) -> Float32[np.ndarray, "_ _ _ b"]:
    """The voxels of each block from layer `start` to before layer `stop` along an axis."""
    return values[(slice(None),) * axis + (slice(start, stop),)]


def _sign_changes(
    values: Float32[np.ndarray, "i j k b"], following: Float32[np.ndarray, "i j k b"], axis: int
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """Block of every change of sign between a voxel and the one that follows, and its position there [voxels]."""
    # Products with NaN compare as false.
    where = np.unravel_index(np.flatnonzero(values * following < 0), values.shape)
    here, there = np.abs(values[where]), np.abs(following[where])
    position = np.stack(where[:3], axis=1).astype(np.float64)
    position[:, axis] += here / (here + there)
    return where[3], position
