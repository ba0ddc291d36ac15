"""The predicted complete shapes of the objects in a scene."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.special import expit
from skimage import measure

from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.instances import Instance
from icgnet.network.icgnet import IcgNet
from icgnet.network.surface import cells_with, extract_mesh

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
        for number, shape in enumerate(self._shapes):
            rows = np.flatnonzero(((points >= shape.lower) & (points <= shape.upper)).all(axis=1))
            if len(rows):
                inside[number] = rows
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
    """Logits of each shape on a lattice: at its pitch near surface and seen points, elsewhere at twice the pitch."""
    cells = [np.maximum(np.ceil((each.upper - each.lower) / (2 * GRID_PITCH)), 1).astype(int) for each in shapes]
    nodes = [
        np.stack(np.meshgrid(*(np.arange(n + 1) for n in each), indexing="ij"), -1).reshape(-1, 3) for each in cells
    ]
    coarse = _decode_together(
        shapes, [each.lower + 2 * GRID_PITCH * index for each, index in zip(shapes, nodes, strict=True)]
    )
    lattices, near = [], []
    for shape, count, values in zip(shapes, cells, coarse, strict=True):
        fine_index = np.stack(np.meshgrid(*(np.arange(2 * n + 1) for n in count), indexing="ij"))
        fine = ndimage.map_coordinates(values.reshape(count + 1), fine_index / 2, order=1)
        wanted = np.argwhere(_near_surface(fine) | _near_seen(shape, fine.shape))
        # Every other node is one of the coarse lattice, which is known.
        near.append(wanted[(wanted % 2 != 0).any(axis=1)])
        lattices.append(fine)
    exact = _decode_together(
        shapes, [each.lower + GRID_PITCH * index for each, index in zip(shapes, near, strict=True)]
    )
    for fine, index, values in zip(lattices, near, exact, strict=True):
        fine[tuple(index.T)] = values
    return lattices


@torch.no_grad()
def _decode_together(
    shapes: Sequence[Shape], points: Sequence[Float[np.ndarray, "_ 3"]]
) -> list[Float[np.ndarray, "_"]]:
    """Occupancy logits of each shape at its own points [m]."""
    counts = [len(each) for each in points]
    if sum(counts) == 0:
        return [np.zeros(0) for _ in shapes]
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


def _near_seen(shape: Shape, nodes: tuple[int, ...]) -> Bool[np.ndarray, "x y z"]:
    """Nodes of the lattice next to a point that was seen."""
    around = cells_with(shape.seen, shape.lower - 0.5 * GRID_PITCH, GRID_PITCH, nodes)
    return ndimage.binary_dilation(around, np.ones((3, 3, 3), dtype=bool))


def _near_surface(logits: Float[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Nodes next to one of the other sign."""
    inside = logits > 0
    block = np.ones((3, 3, 3), dtype=bool)
    return np.logical_xor(ndimage.binary_dilation(inside, block), ndimage.binary_erosion(inside, block))
