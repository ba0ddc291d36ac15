"""Parts that belong to one object, told by the shape of the surface between them.

Where an object was cut in two by mistake, the surface goes on evenly; where two objects touch, it has a groove or an
edge.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from icgnet.geometry.clouds import PointCloud, estimate_normals, voxel_downsample

VOXEL = 0.003
NEIGHBOURHOOD = 0.006
"""Points of two parts this near to each other lie on their common border [m]."""
GROOVE = -0.2
"""Sine of the bend below which a pair of border points lies in a groove."""
LARGEST_GROOVED_SHARE = 0.2
"""With more of its border in a groove, a part is an object of its own."""
SMOOTH = 0.5
"""Largest difference of unit normals (29 degrees) between border points where the surface goes on evenly."""
SMALLEST_SMOOTH_SHARE = 0.75
"""With less of its border smooth, a part is an object of its own."""
SHORTEST_BORDER = 0.5
"""Length of a border that counts, as a share of the smaller part's edge (the root of its area)."""


def group_parts(parts: Sequence[Int[np.ndarray, "_"]], cloud: PointCloud) -> Int[np.ndarray, "i"]:
    """For every part the number of the object that it belongs to; objects are numbered by their first part.

    Paper: nothing; the published code joins instances whose meshes touch. Differs: the surface between them decides.

    Args:
        parts: rows of the cloud that belong to each.
        cloud: the tabletop's cloud.
    """
    surfaces = [_Surface(cloud, rows) for rows in parts]
    pairs = [(a, b) for a in range(len(surfaces)) for b in range(a) if surfaces[a].continues_on(surfaces[b])]
    first, second = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    links = coo_array((np.ones(len(first)), (first, second)), shape=(len(parts), len(parts)))
    _, groups = connected_components(links, directed=False)
    _, first_part, groups = np.unique(groups, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first_part))[groups]


class _Surface:
    """The largest connected piece of a part, thinned, with normals from its points alone.

    Crumbs elsewhere would be bridges to other objects.
    """

    def __init__(self, cloud: PointCloud, rows: Int[np.ndarray, "n"]) -> None:
        points, _ = voxel_downsample(cloud.points[rows], VOXEL)
        links = KDTree(points).sparse_distance_matrix(KDTree(points), NEIGHBOURHOOD)
        _, piece = connected_components(links, directed=False)
        self.points = points[piece == np.bincount(piece).argmax()]
        self.normals = estimate_normals(self.points, cloud.viewpoint)
        self.tree = KDTree(self.points)

    def continues_on(self, other: "_Surface") -> bool:
        """Whether the other part lies on the same smooth surface."""
        distance, nearest = other.tree.query(self.points, distance_upper_bound=NEIGHBOURHOOD)
        nearest = np.asarray(nearest)
        border = np.flatnonzero(np.isfinite(distance) & (distance > 0))
        if len(border) < SHORTEST_BORDER * np.sqrt(min(len(self.points), len(other.points))):
            return False
        directions = (self.points[border] - other.points[nearest[border]]) / distance[border, None]
        turns = self.normals[border] - other.normals[nearest[border]]
        # Positive where the surface bends outwards between two points, negative where it bends inwards.
        bends = np.einsum("kd,kd->k", directions, turns)
        is_grooved = np.mean(bends < GROOVE) > LARGEST_GROOVED_SHARE
        is_smooth = np.mean(np.linalg.norm(turns, axis=1) < SMOOTH) >= SMALLEST_SMOOTH_SHARE
        return bool(is_smooth and not is_grooved)
