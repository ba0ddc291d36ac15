"""Pieces of one object that another object in front of it has cut apart in the picture."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from icgnet.geometry.clouds import PointCloud, estimate_normals, voxel_downsample
from icgnet.inference.instances import Instance
from icgnet.inference.tabletop import Tabletop

PITCH = 0.005
MOST_POINTS = 150
"""Pieces are compared by at most so many points of a grid of this pitch [m]."""
FEWEST_POINTS, LEAST_SHARE = 12, 0.3
"""Pieces with fewer such points have no faces to compare, and crumbs, of fewer points than this share of the other's,
continue nothing."""
LARGEST_GAP = 0.125
"""Pieces farther from each other are not compared [m]."""
LARGEST_OFFSET, SAME_NORMAL = 0.010, 0.97
"""Two points lie in one face when each is so near to the plane of the other [m], and their normals are so alike
(cosine)."""
SHARED_FACE = 0.15
"""A piece continues the other when at least this share of its points lies in a face of the other, of which this share
lies in it, too."""
SAME_DEPTH, SAME_HEIGHT, STRAYS = 0.5, 0.65, 0.03
"""Across the way from one piece to the other and in height, the two must cover the same range: so much of both ranges
together, without the share of strays at each end."""
STEPS = np.array([0.2, 0.35, 0.5, 0.65, 0.8])
"""Places between two points that are tested for being hidden."""
NEAREST_PAIRS = 40
SAME_DIRECTION, NEARER = 0.006, 0.01
"""A place is hidden by a point that is seen within this angle of it [rad] and is nearer by more than this [m]."""
HIDDEN = 0.8
"""Share of the places between two pieces that must be hidden."""


def joined_behind_others(found: Sequence[Instance], tabletop: Tabletop) -> list[list[Instance]]:
    """The pieces of each object: of most one, several of those that only other objects in front have cut apart."""
    groups = join_occluded([item.rows for item in found], tabletop.cloud, tabletop.above)
    return [
        [found[i] for i in np.flatnonzero(groups == number).tolist()] for number in range(groups.max(initial=-1) + 1)
    ]


def join_occluded(
    pieces: Sequence[Int[np.ndarray, "_"]], cloud: PointCloud, above: Int[np.ndarray, "a"]
) -> Int[np.ndarray, "i"]:
    """For every piece the number of the object that it belongs to; objects are numbered by their first piece.

    Two pieces are one object when faces of the one go on in the other, both have the same cross-section, and all that
    lies between is hidden.

    Paper: nothing; its masks may have several pieces, too.

    Args:
        pieces: rows of the cloud that belong to each.
        cloud: the tabletop's cloud, with its viewpoint; without one nothing is joined.
        above: rows of everything that may hide anything.
    """
    groups = np.arange(len(pieces))
    if cloud.viewpoint is None or len(pieces) < 3:  # two pieces and what is in front of them
        return groups
    faces = [_Faces(cloud, rows) for rows in pieces]
    ways = cloud.points[above] - cloud.viewpoint
    seen = _Seen(KDTree(ways / np.linalg.norm(ways, axis=1, keepdims=True)), np.linalg.norm(ways, axis=1))
    pairs = [
        (a, b)
        for a in range(len(pieces))
        for b in range(a)
        if faces[a].goes_on_in(faces[b])
        and faces[a].is_in_line_with(faces[b])
        and seen.hide_between(faces[a].points, faces[b].points, cloud.viewpoint)
    ]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    links = coo_array((np.ones(len(first)), (first, second)), shape=(len(pieces), len(pieces)))
    return connected_components(links, directed=False)[1]


class _Faces:
    """The surface of a piece: some of its points, with normals."""

    def __init__(self, cloud: PointCloud, rows: Int[np.ndarray, "n"]) -> None:
        points, _ = voxel_downsample(cloud.points[rows], PITCH)
        self.size = len(points)
        self.points = points[:: -(-len(points) // MOST_POINTS)]
        self.normals = estimate_normals(points, cloud.viewpoint, queries=self.points)

    def goes_on_in(self, other: "_Faces") -> bool:
        """Whether faces of this piece and of the other one lie in the same planes, with a gap between."""
        few, many = sorted((self.size, other.size))
        if min(len(self.points), len(other.points)) < FEWEST_POINTS or few < LEAST_SHARE * many:
            return False
        if np.linalg.norm(np.maximum(self._lower - other._upper, other._lower - self._upper).clip(0)) > LARGEST_GAP:
            return False
        way = other.points[None] - self.points[:, None]
        along_own = np.abs(np.einsum("abk,ak->ab", way, self.normals))
        along_other = np.abs(np.einsum("abk,bk->ab", way, other.normals))
        alike = self.normals @ other.normals.T > SAME_NORMAL
        in_one_face = alike & (along_own < LARGEST_OFFSET) & (along_other < LARGEST_OFFSET)
        own = (in_one_face.mean(axis=1) > SHARED_FACE).mean()
        others = (in_one_face.mean(axis=0) > SHARED_FACE).mean()
        return bool(min(own, others) > SHARED_FACE)

    def is_in_line_with(self, other: "_Faces") -> bool:
        """Whether both pieces have the same cross-section, seen along the way from one to the other."""
        x, y = (other.points.mean(axis=0) - self.points.mean(axis=0))[:2]
        across = np.array([-y, x]) / max(np.hypot(x, y), 1e-9)
        depth = _common_range(self.points[:, :2] @ across, other.points[:, :2] @ across)
        return depth > SAME_DEPTH and _common_range(self.points[:, 2], other.points[:, 2]) > SAME_HEIGHT

    @property
    def _lower(self) -> Float[np.ndarray, "3"]:
        return self.points.min(axis=0)

    @property
    def _upper(self) -> Float[np.ndarray, "3"]:
        return self.points.max(axis=0)


def _common_range(first: Float[np.ndarray, "n"], second: Float[np.ndarray, "m"]) -> float:
    """Length of what the ranges of two sets of numbers have in common, as a share of the range of both together."""
    (low, high), (other_low, other_high) = (np.quantile(each, (STRAYS, 1.0 - STRAYS)) for each in (first, second))
    common = min(high, other_high) - max(low, other_low)
    return float(max(common, 0.0) / max(max(high, other_high) - min(low, other_low), 1e-9))


class _Seen:
    """What the camera saw, by direction."""

    def __init__(self, directions: KDTree, distances: Float[np.ndarray, "n"]) -> None:
        self._directions, self._distances = directions, distances

    def hide_between(
        self, first: Float[np.ndarray, "n 3"], second: Float[np.ndarray, "m 3"], viewpoint: Float[np.ndarray, "3"]
    ) -> bool:
        """Whether other things hide what lies between two pieces."""
        distance, nearest = KDTree(second).query(first)
        near = np.argsort(distance)[:NEAREST_PAIRS]
        if distance[near[0]] > LARGEST_GAP:
            return False
        start, end = first[near], second[np.asarray(nearest)[near]]
        places = (start[:, None] + STEPS[:, None] * (end - start)[:, None]).reshape(-1, 3)
        return bool(self._hidden(places - viewpoint).mean() > HIDDEN)

    def _hidden(self, ways: Float[np.ndarray, "k 3"]) -> Bool[np.ndarray, "k"]:
        length = np.linalg.norm(ways, axis=1)
        angle, nearest = self._directions.query(ways / length[:, None], distance_upper_bound=SAME_DIRECTION)
        found = np.isfinite(angle)
        in_front = np.zeros(len(ways), dtype=bool)
        in_front[found] = self._distances[np.asarray(nearest)[found]] < length[found] - NEARER
        return in_front
