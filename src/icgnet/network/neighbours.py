"""Nearest neighbours and farthest points of point sets."""

import numpy as np
import torch
from jaxtyping import Float, Int
from scipy.spatial import KDTree
from torch import Tensor

_DISTANCES_AT_ONCE = 1 << 24
LEAF_SIZE = 32
"""Points of a leaf of the tree, for which six neighbours are found the fastest."""


class NeighbourSearch:
    """Nearest rows of a fixed point set: a KD-tree on the CPU, blocks of all distances on other devices."""

    def __init__(self, points: Float[Tensor, "t 3"]) -> None:
        self._points = points.detach()
        self._tree = KDTree(self._points.numpy(), leafsize=LEAF_SIZE) if points.device.type == "cpu" else None

    def nearest(self, queries: Float[Tensor, "n 3"], count: int) -> Int[Tensor, "n k"]:
        """Rows of the `count` nearest points, nearest first; the last is repeated where the set is smaller."""
        queries, found = queries.detach(), min(count, len(self._points))
        if self._tree is not None:
            rows = np.asarray(self._tree.query(queries.numpy(), k=found, workers=torch.get_num_threads())[1])
            nearest = torch.from_numpy(rows.reshape(len(queries), found))
        else:
            blocks = queries.split(max(1, _DISTANCES_AT_ONCE // len(self._points)))
            nearest = torch.cat([torch.cdist(b, self._points).topk(found, largest=False).indices for b in blocks])
        if found < count:
            nearest = torch.cat([nearest, nearest[:, -1:].expand(-1, count - found)], 1)
        return nearest


def spaced_points(points: Float[Tensor, "n 3"], spacing: float) -> Int[Tensor, " k"]:
    """Rows of points that are at least `spacing` [m] apart, so many that every point is within that of one of them.

    In the order of the rows each point is taken that none before is near to, so what is far away changes nothing.
    """
    places = points.detach().cpu().numpy()
    tree = KDTree(places)
    covered, rows = np.zeros(len(places), dtype=bool), []
    for row in range(len(places)):
        if not covered[row]:
            rows.append(row)
            covered[tree.query_ball_point(places[row], spacing)] = True
    return torch.tensor(rows, device=points.device)


def farthest_points(points: Float[Tensor, "n 3"], count: int) -> Int[Tensor, " k"]:
    """Rows of `count` points spread over the set: each is the farthest from those before it.

    Starts with the point nearest to the centroid, so the choice depends on nothing but the points. A set with fewer
    points gives repeated rows.

    Paper: farthest-point sampling of the query positions.
    """
    points = points.detach()
    row = (points - points.mean(0)).square().sum(1).argmin()
    distance = points.new_full((len(points),), torch.inf)
    rows = []
    for _ in range(count):
        rows.append(row)
        distance = torch.minimum(distance, (points - points[row]).square().sum(1))
        row = distance.argmax()
    return torch.stack(rows)
