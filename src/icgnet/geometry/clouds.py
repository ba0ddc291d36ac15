"""Point clouds: checks, cropping, thinning, outliers and surface normals."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from icgnet.errors import InputError
from icgnet.geometry.arrays import real_array
from icgnet.geometry.transforms import transform_points

# A cloud whose typical point is farther than this from the middle [m] is in millimetres.
LARGEST_SPREAD = 10.0
# One whose typical point is nearer than this to the middle [m] is in kilometres, or one point many times.
SMALLEST_SPREAD = 0.001
FARTHEST_POINT = 1000.0
"""Points farther than this from the origin of their frame [m] were not measured."""
# Fewer neighbours than this do not span a plane.
FEWEST_NEIGHBOURS = 3
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points and where they were seen from.

    Attributes:
        points: [n 3] positions in the frame `frame_id` [m].
        viewpoint: [3] camera centre in the same frame [m]; None when it is not known.
        frame_id: name of the frame.
    """

    points: Float[np.ndarray, "n 3"]
    viewpoint: Float[np.ndarray, "3"] | None = None
    frame_id: str = "world"

    def __len__(self) -> int:
        return len(self.points)

    def select(self, index: Bool[np.ndarray, "n"] | Int[np.ndarray, "m"]) -> "PointCloud":
        """The cloud of the chosen points, seen from the same viewpoint."""
        return PointCloud(self.points[index], self.viewpoint, self.frame_id)

    def transformed(self, T_a_b: Float[np.ndarray, "4 4"], frame_id: str) -> "PointCloud":
        """The same cloud in frame a, named `frame_id`, when it is given in frame b."""
        viewpoint = None if self.viewpoint is None else transform_points(T_a_b, self.viewpoint[None])[0]
        return PointCloud(transform_points(T_a_b, self.points), viewpoint, frame_id)


def check_points(points: Any, minimum: int = 100) -> Float[np.ndarray, "n 3"]:
    """The measured rows of a cloud as float64.

    Args:
        points: [n 3] positions [m]; rows with NaN, infinity or masked entries, and those farther than 1 km
            away, are dropped.
        minimum: how many finite points there must be.

    Raises:
        InputError: no numbers, another shape, fewer than `minimum` finite points, or a cloud that is not in metres.
    """
    cloud = real_array(points, "points", (None, 3), finite=False)
    finite = cloud[_in_every_column(np.isfinite(cloud))]
    sample = finite[:: max(1, len(finite) // 1000)]
    if len(finite) >= minimum and len(sample):
        spread = np.median(np.abs(sample - np.median(sample, axis=0)).max(axis=1))
        if spread > LARGEST_SPREAD:
            raise InputError(
                f"half of the points are more than {spread:g} m from the middle of the cloud, "
                "which looks like millimetres: divide by 1000"
            )
        if spread < SMALLEST_SPREAD:
            raise InputError(
                f"half of the points are within {spread:g} m of the middle of the cloud, nearer than any camera sees: "
                "are the points in metres?"
            )
    measured = cloud[measured_rows(cloud)]
    if len(measured) < minimum:
        raise InputError(
            f"cloud has {len(measured)} finite points (of {len(cloud)} given), at least {minimum} are needed"
        )
    return measured


def measured_rows(points: Float[np.ndarray, "n 3"]) -> Int[np.ndarray, "m"]:
    """Rows of the points that were measured: finite and within `FARTHEST_POINT` of the origin."""
    return np.flatnonzero(_in_every_column(np.abs(points) < FARTHEST_POINT))


def _in_every_column(holds: Bool[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """As `all(axis=1)`, which takes five times as long for so short rows."""
    return holds[:, 0] & holds[:, 1] & holds[:, 2]


def crop(
    points: Float[np.ndarray, "n 3"], lower: Float[np.ndarray, "3"], upper: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "n"]:
    """Which points lie inside the box from `lower` to `upper` [m], borders included."""
    return np.all((points >= lower) & (points <= upper), axis=1)


def voxel_downsample(
    points: Float[np.ndarray, "n 3"], size: float
) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "n"]]:
    """Mean point of every occupied voxel, and the voxel of every point.

    Args:
        points: positions [m].
        size: edge of a voxel [m]; voxel borders lie at whole multiples of it.

    Returns:
        Means [v 3] in the order of the voxels' coordinates, and their index for every point [n].
    """
    if len(points) == 0:
        return np.zeros((0, 3)), np.zeros(0, dtype=np.int64)
    cells = np.floor(points / size).astype(np.int64)
    cells -= cells.min(axis=0)
    key = np.ravel_multi_index(tuple(cells.T), tuple(cells.max(axis=0) + 1))
    _, inverse, counts = np.unique(key, return_inverse=True, return_counts=True)
    sums = [np.bincount(inverse, points[:, axis], len(counts)) for axis in range(3)]
    return np.stack(sums, axis=1) / counts[:, None], inverse


def radius_outlier_mask(points: Float[np.ndarray, "n 3"], radius: float, neighbours: int) -> Bool[np.ndarray, "n"]:
    """Which points have at least `neighbours` other points within `radius` [m]: True for those to keep."""
    if len(points) <= neighbours:
        return np.zeros(len(points), dtype=bool)
    # The point itself is its own first neighbour, hence the one more.
    distance, _ = _tree(points).query(points, k=neighbours + 1, distance_upper_bound=radius)
    return np.isfinite(distance.reshape(len(points), -1)[:, -1])


def statistical_outlier_mask(
    points: Float[np.ndarray, "n 3"], neighbours: int = 30, ratio: float = 1.0
) -> Bool[np.ndarray, "n"]:
    """Which points lie as close to their neighbours as the others do: True for those to keep.

    Args:
        points: positions [m].
        neighbours: how many nearest points the mean distance is taken over.
        ratio: how many standard deviations above the cloud's average that mean may be.
    """
    if len(points) <= 1:
        return np.ones(len(points), dtype=bool)
    distance, _ = _tree(points).query(points, k=min(neighbours + 1, len(points)))
    mean = distance[:, 1:].mean(axis=1)
    # The margin keeps clouds of exactly even spacing, where rounding decides which mean is the largest.
    return mean <= mean.mean() + ratio * mean.std() + 1e-9


def estimate_normals(
    points: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"] | None = None,
    neighbours: int = 30,
    radius: float = 0.015,
    queries: Float[np.ndarray, "m 3"] | None = None,
) -> Float[np.ndarray, "m 3"]:
    """Unit surface normals from the spread of each point's neighbours, turned towards the viewpoint.

    A point with fewer than three neighbours gets the direction to the viewpoint itself.

    Args:
        points: the cloud [m].
        viewpoint: camera centre in the same frame [m]; normals are turned upwards (+z) if None.
        neighbours: the most neighbours that are used, the point itself included.
        radius: the farthest distance of a neighbour [m].
        queries: where normals are wanted [m]; at all of `points` if None.
    """
    where = points if queries is None else queries
    towards = np.broadcast_to(UP, where.shape) if viewpoint is None else viewpoint - where
    if len(where) == 0 or len(points) == 0:
        return _unit(towards)
    distance, index = _tree(points).query(where, k=neighbours, distance_upper_bound=radius)
    index = index.reshape(len(where), -1)
    found = np.isfinite(distance.reshape(len(where), -1))
    counts = found.sum(axis=1)
    # Positions relative to the query keep the covariance exact far from the origin; absent neighbours count as zero.
    offsets = points[np.minimum(index, len(points) - 1)] - where[:, None]
    offsets[~found] = 0.0
    mean = offsets.sum(axis=1) / np.maximum(counts, 1)[:, None]
    scatter = np.matmul(offsets.transpose(0, 2, 1), offsets)
    scatter -= counts[:, None, None] * mean[:, :, None] * mean[:, None, :]
    normals = np.linalg.eigh(scatter)[1][:, :, 0]
    normals = np.where((counts < FEWEST_NEIGHBOURS)[:, None], _unit(towards), normals)
    facing = np.einsum("nd,nd->n", normals, towards)
    return np.where((facing < 0)[:, None], -normals, normals)


def _tree(points: Float[np.ndarray, "n 3"]) -> KDTree:
    """KD-tree built for few queries: splitting at the box middle builds much faster than at medians."""
    return KDTree(points, leafsize=32, balanced_tree=False, compact_nodes=False)


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Vectors scaled to length 1, world z in place of vectors of length 0."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 0, vectors / np.where(length > 0, length, 1.0), UP)
