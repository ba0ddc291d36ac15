"""The predicted complete shapes of the objects in a scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float
from scipy import ndimage
from scipy.special import expit

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
OUTSIDE = -10.0
"""Logit where no shape is looked for."""
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
        inside = np.flatnonzero(((points >= self.lower) & (points <= self.upper)).all(axis=1))
        probability = np.zeros(len(points))
        if len(inside):
            index = (points[inside] - self.lower) / GRID_PITCH
            probability[inside] = expit(ndimage.map_coordinates(self._lattice, index.T, order=1, mode="nearest"))
        return probability

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

    @cached_property
    def _lattice(self) -> Float[np.ndarray, "x y z"]:
        """Logits on a lattice: everywhere at twice the pitch, then at the pitch itself near surface and seen points."""
        pitch = GRID_PITCH
        cells = np.maximum(np.ceil((self.upper - self.lower) / (2 * pitch)), 1).astype(int)
        coarse_index = np.stack(np.meshgrid(*(np.arange(n + 1) for n in cells), indexing="ij"), axis=-1)
        coarse = self.logits((self.lower + 2 * pitch * coarse_index).reshape(-1, 3)).reshape(cells + 1)
        fine_index = np.stack(np.meshgrid(*(np.arange(2 * n + 1) for n in cells), indexing="ij"))
        fine = ndimage.map_coordinates(coarse, fine_index / 2, order=1)
        near = np.argwhere(_near_surface(fine) | self._near_seen(fine.shape))
        # Every other node is one of the coarse lattice, which is known.
        near = near[(near % 2 != 0).any(axis=1)]
        if len(near):
            fine[tuple(near.T)] = self.logits(self.lower + pitch * near)
        return fine

    def _near_seen(self, nodes: tuple[int, ...]) -> Bool[np.ndarray, "x y z"]:
        """Nodes of the lattice next to a point that was seen."""
        around = cells_with(self.seen, self.lower - 0.5 * GRID_PITCH, GRID_PITCH, nodes)
        return ndimage.binary_dilation(around, np.ones((3, 3, 3), dtype=bool))

    @torch.no_grad()
    def _decode(self, points: torch.Tensor) -> torch.Tensor:
        if len(points) == 0:
            return points.new_zeros(0)
        device = self.network.device
        query = torch.tensor([self.instance.query], device=device)
        return self.network.decode_occupancy(self.instance.scene.embedding, query, points.to(device))[0].cpu()


def scene_occupancy(shapes: Sequence[Shape], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Probability that a point of the table frame [m] is inside of any of the shapes."""
    occupied = np.zeros(len(points))
    for shape in shapes:
        np.maximum(occupied, shape.occupancy(points), out=occupied)
    return occupied


def _near_surface(logits: Float[np.ndarray, "x y z"]) -> Bool[np.ndarray, "x y z"]:
    """Nodes next to one of the other sign."""
    inside = logits > 0
    block = np.ones((3, 3, 3), dtype=bool)
    return np.logical_xor(ndimage.binary_dilation(inside, block), ndimage.binary_erosion(inside, block))
