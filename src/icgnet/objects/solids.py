"""Solids whose convex pieces are known by construction: lofts, vessels, tubes, extrusions and their unions."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial import ConvexHull
from trimesh.transformations import rotation_matrix, translation_matrix

from icgnet.objects.model import convex_hull
from icgnet.objects.outlines import Outline, convex_cells, cut_ears

Ring = Float[np.ndarray, "_ 3"]


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed surface with outward winding, and the convex pieces it consists of [m].

    Attributes:
        vertices: of the surface.
        faces: of the surface; a union of several closed components where pieces are joined.
        parts: points whose convex hulls are the pieces.
    """

    vertices: Ring
    faces: Int[np.ndarray, "f 3"]
    parts: tuple[Ring, ...]

    @property
    def surface(self) -> trimesh.Trimesh:
        """The surface as a mesh."""
        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    @property
    def extents(self) -> Float[np.ndarray, "3"]:
        """Sides of the bounding box [m]."""
        return np.ptp(self.vertices, axis=0)

    def hulls(self) -> tuple[trimesh.Trimesh, ...]:
        """Returns the convex pieces as meshes."""
        return tuple(convex_hull(part) for part in self.parts)

    def __add__(self, other: "Solid") -> "Solid":
        """Returns the union; the pieces should overlap a little where they are joined."""
        return Solid(
            np.concatenate([self.vertices, other.vertices]),
            np.concatenate([self.faces, other.faces + len(self.vertices)]),
            self.parts + other.parts,
        )

    def transformed(self, T: Float[np.ndarray, "4 4"]) -> "Solid":
        """Returns the solid moved, turned and scaled (not mirrored) by `T`."""
        vertices, *parts = (points @ T[:3, :3].T + T[:3, 3] for points in (self.vertices, *self.parts))
        return Solid(vertices, self.faces, tuple(parts))

    def moved(self, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> "Solid":
        """Returns the solid shifted [m]."""
        return self.transformed(np.asarray(translation_matrix([x, y, z])))

    def turned(self, angle: float, axis: tuple[float, float, float]) -> "Solid":
        """Returns the solid turned about an axis through the origin [rad]."""
        return self.transformed(np.asarray(rotation_matrix(angle, axis)))


def ring(outline: Outline, scale: float | tuple[float, float], z: float, x: float = 0.0, y: float = 0.0) -> Ring:
    """Returns an outline, scaled, at height `z`, shifted by (x, y) [m]."""
    flat = outline * np.asarray(scale) + np.array([x, y])
    return np.column_stack([flat, np.full(len(flat), z)])


def loft(rings: list[Ring], closed: bool = False) -> Solid:
    """Returns the solid between convex rings of equal length, counter-clockwise seen from where they lead.

    Args:
        rings: cross-sections in order.
        closed: the last ring is followed by the first (a torus) instead of both ends being capped.
    """
    steps = [*rings, rings[0]] if closed else rings
    return Solid(*_skin(rings, closed), tuple(_convex_runs(steps)))


def vessel(outer: list[Ring], inner: list[Ring], sectors: int = 14) -> Solid:
    """Returns a vessel that is open at the top.

    Args:
        outer: rings of the outside, upwards.
        inner: rings of the hollow, upwards, the last at the height of the rim.
        sectors: convex pieces that the wall is divided into around its axis.
    """
    floor = inner[0][:, 2].max()
    below = [section for section in outer if section[:, 2].max() < floor - 1e-9]
    base = _convex_runs([*below, _at_height(outer, floor)])
    wall = [_at_height(outer, floor), *(section for section in outer if section[:, 2].min() > floor + 1e-9)]
    return Solid(*_skin([*outer, *inner[::-1]], closed=False), (*base, *_wall_parts(wall, inner, sectors)))


def hollow_prism(outer: Outline, inner: Outline, height: float, sectors: int = 14, bevel: float = 0.0) -> Solid:
    """Returns a tube with a bore from end to end (a roll of tape), standing on z = 0 [m]."""
    shrink = 1.0 - bevel / np.abs(outer).max()
    levels = (
        [(shrink, 0.0), (1.0, bevel), (1.0, height - bevel), (shrink, height)] if bevel else [(1.0, 0.0), (1.0, height)]
    )
    outside = [ring(outer, scale, z) for scale, z in levels]
    inside = [ring(inner, 1.0, 0.0), ring(inner, 1.0, height)]
    return Solid(*_skin([*outside, *inside[::-1]], closed=True), tuple(_wall_parts(outside, inside, sectors)))


def tube(
    path: Float[np.ndarray, "p 3"],
    outline: Outline,
    scales: list[float] | None = None,
    side: tuple[float, float, float] = (0, 1, 0),
    closed: bool = False,
) -> Solid:
    """Returns an outline swept along a path [m].

    Args:
        path: points of the centre line.
        outline: cross-section; its x axis stays at right angles to the path and `side`, its y axis along `side`.
        scales: size of the cross-section at each point; 1 everywhere if left out.
        side: normal of the plane in which the path lies.
        closed: the path returns to its first point.
    """
    following, previous = np.roll(path, -1, axis=0), np.roll(path, 1, axis=0)
    if not closed:
        following[-1], previous[0] = path[-1], path[0]
    forward = following - previous
    forward = forward / np.linalg.norm(forward, axis=1, keepdims=True)
    y = np.broadcast_to(np.asarray(side, np.float64), path.shape)
    x = np.cross(y, forward)
    sizes = np.ones(len(path)) if scales is None else np.asarray(scales)
    rings = [p + s * (outline[:, :1] * a + outline[:, 1:] * b) for p, s, a, b in zip(path, sizes, x, y, strict=True)]
    return loft(rings, closed)


def extrude(outline: Outline, height: float, bevel: float = 0.0) -> Solid:
    """Returns a prism over any simple outline, from z = 0 up [m].

    Args:
        outline: counter-clockwise, need not be convex [m].
        height: of the prism.
        bevel: how far the caps are drawn in towards the origin, over the same height.
    """
    count = len(outline)
    shrink = 1.0 - bevel / np.linalg.norm(outline, axis=1).max()
    levels = (
        [(shrink, 0.0), (1.0, bevel), (1.0, height - bevel), (shrink, height)] if bevel else [(1.0, 0.0), (1.0, height)]
    )
    rings = [ring(outline, scale, z) for scale, z in levels]
    cap = np.array(cut_ears(outline))
    faces = np.concatenate([_side_faces(len(rings), count), cap[:, ::-1], cap + count * (len(rings) - 1)])
    parts = (np.concatenate([section[cell] for section in rings]) for cell in convex_cells(outline))
    return Solid(np.concatenate(rings), faces, tuple(parts))


def hull(points: Float[np.ndarray, "n 3"]) -> Solid:
    """Returns the convex hull of points."""
    mesh = convex_hull(points)
    return Solid(mesh.vertices, mesh.faces, (mesh.vertices,))


def _skin(rings: list[Ring], closed: bool) -> tuple[Ring, Int[np.ndarray, "f 3"]]:
    """Returns the surface through rings, capped at both ends by fans about their centres unless `closed`."""
    count = len(rings[0])
    faces = _side_faces(len(rings) + closed, count) % (count * len(rings))
    points = np.concatenate(rings)
    if not closed:
        start, end = len(points), len(points) + 1
        index = np.arange(count)
        following = np.roll(index, -1)
        last = count * (len(rings) - 1)
        bottom = np.stack([following, index, np.full(count, start)], axis=1)
        top = np.stack([index + last, following + last, np.full(count, end)], axis=1)
        faces = np.concatenate([faces, bottom, top])
        points = np.concatenate([points, rings[0].mean(axis=0)[None], rings[-1].mean(axis=0)[None]])
    return points, faces


def _side_faces(levels: int, count: int) -> np.ndarray:
    """Returns the triangles between successive rings of `count` points."""
    index = np.arange(count)
    following = np.roll(index, -1)
    lower = np.stack([index, following, following + count], axis=1)
    upper = np.stack([index, following + count, index + count], axis=1)
    one_step = np.concatenate([lower, upper])
    return np.concatenate([one_step + level * count for level in range(levels - 1)])


def _convex_runs(rings: list[Ring], tolerance: float = 0.0007) -> list[Ring]:
    """Returns the points of runs of rings; a run grows while its surface is within `tolerance` [m] of its hull's."""
    parts = []
    start = 0
    while start < len(rings) - 1:
        end = start + 1
        while end + 1 < len(rings) and _depth(rings[start : end + 2]) <= tolerance:
            end += 1
        parts.append(np.concatenate(rings[start : end + 1]))
        start = end
    return parts


def _depth(rings: list[Ring]) -> float:
    """Returns how deep the surface through the rings dips below their convex hull at the middle of an edge [m]."""
    planes = ConvexHull(np.concatenate(rings)).equations
    around = [0.5 * (section + np.roll(section, -1, axis=0)) for section in rings]
    diagonals = [0.5 * (low + np.roll(high, -1, axis=0)) for low, high in pairwise(rings)]
    points = np.concatenate([*rings, *around, *diagonals])
    return -float((points @ planes[:, :3].T + planes[:, 3]).max(axis=1).min())


def _wall_parts(outer: list[Ring], inner: list[Ring], sectors: int) -> list[Ring]:
    """Returns convex pieces of the wall between two stacks of rings, both upwards."""
    count = len(outer[0])
    parts = []
    cuts = _wall_levels(outer, inner)
    for low, high in pairwise(cuts):
        bands = [_at_height(stack, z) for stack in (outer, inner) for z in (low, high)]
        bands += [section for section in (*outer, *inner) if low < section[:, 2].mean() < high]
        for sector in range(sectors):
            first, last = round(sector * count / sectors), round((sector + 1) * count / sectors)
            take = np.arange(first, last + 1) % count
            parts.append(np.concatenate([band[take] for band in bands]))
    return parts


def _wall_levels(outer: list[Ring], inner: list[Ring], tolerance: float = 0.002) -> list[float]:
    """Returns heights at which a wall is cut, so that between them both sides are straight within `tolerance` [m]."""
    heights = sorted({round(float(section[:, 2].mean()), 9) for section in [*outer, *inner]})
    bottom = max(outer[0][0, 2], inner[0][0, 2])
    heights = [height for height in heights if height >= bottom - 1e-9]
    cuts = [heights[0]]
    for candidate, following in pairwise(heights[1:]):
        if any(_bends(stack, cuts[-1], following, heights, tolerance) for stack in (outer, inner)):
            cuts.append(candidate)
    return [*cuts, heights[-1]]


def _bends(stack: list[Ring], low: float, high: float, heights: list[float], tolerance: float) -> bool:
    """Returns whether a stack leaves the straight line between two heights by more than `tolerance` [m]."""
    start, end = _at_height(stack, low), _at_height(stack, high)
    for height in heights:
        if low < height < high:
            share = (height - low) / (high - low)
            if np.abs(start + share * (end - start) - _at_height(stack, height)).max() > tolerance:
                return True
    return False


def _at_height(rings: list[Ring], z: float) -> Ring:
    """Returns the ring of a stack at a height, between two rings if need be [m]."""
    heights = np.array([section[:, 2].mean() for section in rings])
    above = int(np.clip(np.searchsorted(heights, z), 1, len(rings) - 1))
    low, high = rings[above - 1], rings[above]
    span = heights[above] - heights[above - 1]
    share = np.clip((z - heights[above - 1]) / span, 0.0, 1.0) if span > 1e-12 else 1.0
    return low + share * (high - low)
