"""What carries the objects of a scene and what stands around them: nothing of it is an object, and nothing moves."""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import ConvexHull

from icgnet.geometry.transforms import transform_points
from icgnet.geometry.workspace import SIZE
from icgnet.objects.model import convex_hull

BIN_WALL = "bin wall"
"""Name of the structures that a bin is made of."""
SIDES = 20
"""Corners of the prism that stands for a cylinder."""


@dataclass(frozen=True, eq=False)
class Structure:
    """A convex thing that is fixed and no object: a wall, a post, the edge of the table, the floor below it.

    Attributes:
        name: what it is.
        corners: [n 3] points in the world [m], whose convex hull it is.
    """

    name: str
    corners: Float[np.ndarray, "n 3"]

    def mesh(self) -> trimesh.Trimesh:
        """Its surface in the world [m], with outward normals."""
        return convex_hull(self.corners.astype(np.float64))

    def planes(self) -> Float[np.ndarray, "e 4"]:
        """Its sides as unit normals and offsets [m]: points x of the world with normal @ x + offset <= 0 are inside."""
        sides = ConvexHull(self.corners.astype(np.float64)).equations
        # Sides with more than three corners come as several triangles.
        return sides[np.unique(sides.round(6), axis=0, return_index=True)[1]]


@dataclass(frozen=True)
class Surroundings:
    """The support, whose surface is at `TABLE_HEIGHT`, and the structures around it.

    Attributes:
        extent: of the table top or the floor of the bin, as least x, least y, largest x, largest y [m]; None for a
            table without end.
        structures: what else there is.
    """

    extent: tuple[float, float, float, float] | None = None
    structures: tuple[Structure, ...] = ()

    @property
    def bounds(self) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
        """Least and largest x and y [m] that an object's centre may have: of the bin's walls, the table or the cube."""
        walls = [each.corners[:, :2] for each in self.structures if each.name == BIN_WALL]
        if walls:
            corners = np.concatenate(walls).astype(np.float64)
            return corners.min(axis=0), corners.max(axis=0)
        lower_x, lower_y, upper_x, upper_y = self.extent or (0.0, 0.0, SIZE, SIZE)
        return np.array([lower_x, lower_y]), np.array([upper_x, upper_y])


ENDLESS = Surroundings()
"""A table without end and nothing around it, as in the published benchmark."""


def block(
    name: str, size: tuple[float, float, float], T_world_block: Float[np.ndarray, "4 4"], flare: float = 1.0
) -> Structure:
    """A box with these edges [m], centred on its frame.

    Args:
        name: what it is.
        size: lengths along its own axes [m].
        T_world_block: pose [m].
        flare: how much longer than at the bottom it is along x at the top.
    """
    signs = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, 8).T / 2
    corners = signs * np.array(size)
    corners[corners[:, 2] > 0, 0] *= flare
    return Structure(name, transform_points(T_world_block, corners))


def rod(name: str, diameter: float, length: float, T_world_rod: Float[np.ndarray, "4 4"]) -> Structure:
    """A cylinder about the z axis of its frame, centred on it [m]."""
    angle = np.linspace(0.0, 2.0 * np.pi, SIDES, endpoint=False)
    ring = diameter / 2 * np.stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)], axis=1)
    end = np.array([0.0, 0.0, length / 2])
    return Structure(name, transform_points(T_world_rod, np.concatenate([ring - end, ring + end])))
