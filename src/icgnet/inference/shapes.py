"""The predicted complete shapes of the objects in a scene."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
import trimesh
from jaxtyping import Float
from scipy import ndimage
from scipy.special import expit
from skimage import measure

from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.instances import Instance
from icgnet.network.icgnet import IcgNet
from icgnet.network.lattice import Lattice
from icgnet.network.surface import extract_mesh

SIDE_PADDING = 0.04
"""A shape is looked for this far beyond the seen points, sideways [m]: the camera sees the front only."""
TOP_PADDING = 0.015
"""The same upwards [m]."""
MESH_PITCH = 0.003
"""Pitch of the grid in which the surface is looked for [m]."""
LEVEL_POINTS = 512
"""About so many of the seen points are asked for the level of the surface."""
GRID_PITCH = 0.006
"""Pitch of the lattice that collision checking reads [m]; the clearance of a finger."""
LEVEL_QUANTILE = 0.7
LOWEST_LEVEL = -0.5
"""The surface is drawn where the logits are as high as this quantile of them at seen points, but within this and 0."""
POINTS_AT_ONCE = 16_384
"""What so many take stays in the cache."""
RAY_STEP = 0.002
RAY_START = 0.010
"""A ray from a contact must meet the shape within this distance [m]."""


@dataclass(frozen=True, eq=False)
class Shape:
    """The occupancy field of one object, asked in the table frame.

    Attributes:
        network: the decoder.
        instance: the object.
        lower: lower corner of the box in which the shape is looked for, table frame [m].
        upper: upper corner of it [m].
        seen: points of the object, table frame [m]; where they are, thin parts are looked for.
    """

    network: IcgNet
    instance: Instance
    lower: Float[np.ndarray, "3"]
    upper: Float[np.ndarray, "3"]
    seen: Float[np.ndarray, "n 3"]

    @staticmethod
    def around(network: IcgNet, instance: Instance, points: Float[np.ndarray, "n 3"]) -> "Shape":
        """The shape of an instance with these points [m]; it reaches down to the table."""
        lower = points.min(axis=0) - SIDE_PADDING
        upper = points.max(axis=0) + np.array([SIDE_PADDING, SIDE_PADDING, TOP_PADDING])
        lower[2] = TABLE_HEIGHT
        return Shape(network, instance, lower, upper, points)

    def logits(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Occupancy logits at points of the table frame [m], asked from the network."""
        return self._decode(torch.from_numpy(points.astype(np.float32))).numpy()

    def occupancy(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Occupancy probability at points of the table frame [m], interpolated in a lattice; 0 outside of the box."""
        return self._alone(points)

    @cached_property
    def _alone(self) -> "SceneOccupancy":
        return SceneOccupancy([self])

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        """Closed surface in the table frame [m]; empty if the network sees no shape.

        It is drawn at `level`, which is 0 unless the network doubts what was seen.
        """
        level = self.level
        resolution = int(np.ceil((self.upper - self.lower).max() / MESH_PITCH))
        return extract_mesh(lambda points: self._decode(points) - level, self.lower, self.upper, resolution, self.seen)

    @cached_property
    def level(self) -> float:
        """The logit at which the surface is drawn: lower than 0 where the network doubts what was seen.

        Nowhere in the thin wall of a cup the logit may reach 0, because nobody can tell where exactly the wall is; but
        what was seen is there.
        """
        seen = float(np.quantile(self.logits(self.seen[:: max(1, len(self.seen) // LEVEL_POINTS)]), LEVEL_QUANTILE))
        return min(0.0, max(LOWEST_LEVEL, seen))

    def widths(
        self, contacts: Float[np.ndarray, "c 3"], normals: Float[np.ndarray, "c 3"], limit: float
    ) -> Float[np.ndarray, "c"]:
        """Thickness of the shape behind contacts, along a ray against the normal [m].

        Args:
            contacts: points on the surface, table frame [m].
            normals: outward unit normals there.
            limit: longest thickness that is looked for [m].

        Returns:
            Distance from the contact to where the ray leaves the shape first; infinite when that is beyond the limit,
            NaN when the ray does not meet the shape.
        """
        steps = np.arange(0.0, limit + RAY_START, RAY_STEP)
        ray = contacts[:, None] - steps[:, None] * normals[:, None]
        inside = (self.occupancy(ray.reshape(-1, 3)) > 0.5).reshape(len(contacts), len(steps))
        entry = inside.argmax(axis=1)
        left = ~inside & (np.arange(len(steps)) > entry[:, None])
        width = np.where(left.any(axis=1), steps[left.argmax(axis=1)], np.inf)
        width = np.where(width > limit, np.inf, width)
        return np.where(inside.any(axis=1) & (steps[entry] <= RAY_START), width, np.nan)

    @torch.no_grad()
    def _decode(self, points: torch.Tensor) -> torch.Tensor:
        if len(points) == 0:
            return points.new_zeros(0)
        device = self.network.device
        query = torch.tensor([self.instance.query], device=device)
        return self.network.decode_occupancy(self.instance.scene.embedding, query, points.to(device))[0].cpu()


class SceneOccupancy:
    """Probability that points of the table frame [m] are inside of any of some shapes: what the hand could hit.

    It is interpolated in a lattice around each shape, 0 outside of all boxes. The lattices are decoded when a point is
    asked for that lies in their boxes, all that are missing then at once.
    """

    def __init__(self, shapes: Sequence[Shape]) -> None:
        self._shapes = shapes
        self._lattices: dict[int, Float[np.ndarray, "_ _ _"]] = {}

    def __call__(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """The largest of the probabilities of all shapes."""
        occupied = np.zeros(len(points))
        inside = {}
        # One axis at a time: small reductions would take ten times as long.
        x, y, z = np.ascontiguousarray(points.T)
        for number, shape in enumerate(self._shapes):
            low, high = shape.lower, shape.upper
            near = (x >= low[0]) & (x <= high[0]) & (y >= low[1]) & (y <= high[1]) & (z >= low[2]) & (z <= high[2])
            if near.any():
                inside[number] = np.flatnonzero(near)
        self._decode(inside)
        for number, rows in inside.items():
            index = (points[rows] - self._shapes[number].lower) / GRID_PITCH
            logits = ndimage.map_coordinates(self._lattices[number], index.T, order=1, mode="nearest")
            occupied[rows] = np.maximum(occupied[rows], expit(logits))
        return occupied

    def rough_meshes(self, numbers: Sequence[int]) -> list[trimesh.Trimesh]:
        """Surfaces of some of the shapes in the table frame [m] as the lattices have them; open where a box ends."""
        self._decode(numbers)
        meshes = []
        for number in numbers:
            lattice, shape = self._lattices[number], self._shapes[number]
            if not lattice.min() < shape.level < lattice.max():
                meshes.append(trimesh.Trimesh())
                continue
            corners, faces, *_ = measure.marching_cubes(
                lattice, shape.level, spacing=(GRID_PITCH,) * 3, gradient_direction="ascent"
            )
            meshes.append(trimesh.Trimesh(corners + shape.lower, faces, process=False))
        return meshes

    def _decode(self, numbers: Iterable[int]) -> None:
        missing = [number for number in numbers if number not in self._lattices]
        self._lattices |= zip(missing, decode_lattices([self._shapes[number] for number in missing]), strict=True)


def decode_lattices(shapes: Sequence[Shape]) -> list[Float[np.ndarray, "_ _ _"]]:
    """Logits of each shape on a lattice: exact around its surface and seen points, see `Lattice`."""
    coarse = [Lattice.over(each.lower, each.upper, 2 * GRID_PITCH) for each in shapes]
    _fill_together(shapes, coarse)
    fine = [lattice.halved(shape.seen) for shape, lattice in zip(shapes, coarse, strict=True)]
    _fill_together(shapes, fine)
    return [lattice.values for lattice in fine]


def _fill_together(shapes: Sequence[Shape], lattices: Sequence[Lattice]) -> None:
    while any(map(len, missing := [lattice.missing() for lattice in lattices])):
        points = [lattice.positions(nodes) for lattice, nodes in zip(lattices, missing, strict=True)]
        for lattice, nodes, logits in zip(lattices, missing, _decode_together(shapes, points), strict=True):
            lattice.fill(nodes, logits)


@torch.no_grad()
def _decode_together(
    shapes: Sequence[Shape], points: Sequence[Float[np.ndarray, "_ 3"]]
) -> list[Float[np.ndarray, "_"]]:
    """Occupancy logits of each shape at its own points [m]."""
    counts = [len(each) for each in points]
    network, embedding = shapes[0].network, shapes[0].instance.scene.embedding
    queries = torch.tensor([each.instance.query for each in shapes], device=network.device)
    rows = torch.arange(len(shapes), device=network.device).repeat_interleave(
        torch.tensor(counts, device=network.device)
    )
    together = torch.from_numpy(np.concatenate(points).astype(np.float32)).to(network.device)
    logits = [
        network.decode_occupancy_pairs(embedding, queries, part, row[:, None])[:, 0].cpu()
        for part, row in zip(together.split(POINTS_AT_ONCE), rows.split(POINTS_AT_ONCE), strict=True)
    ]
    return np.split(torch.cat(logits).numpy().astype(np.float64), np.cumsum(counts)[:-1])
