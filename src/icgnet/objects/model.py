"""One object of a set: what the camera sees, and what the physics touches."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial import ConvexHull

from icgnet.errors import DataError
from icgnet.geometry.signed_distance import SignedDistanceGrid, cached_signed_distance_grid

FLAT = 1e-4
"""A mesh whose vertices are nearer to a plane than this share of its longest side encloses nothing."""
LARGEST, SMALLEST = 1.0, 0.001
"""A longest side beyond these [m] means other units than were said."""
THINNEST = 0.0002
"""Convex pieces are at least this thick [m]: the physics cannot take slivers that enclose (almost) nothing."""


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """An object at scale 1 in its own frame: z up as it stands, origin at the centre of mass.

    Attributes:
        name: key within its object set, e.g. "packed/mug_0012".
        class_name: one of `icgnet.objects.classes.CLASSES`.
        visual: surface [m] with outward normals, usually one closed component; overlapping closed components
            (a handle pushed into a cup) are a union.
        parts: convex pieces [m] that together stand for the object in the physics.
    """

    name: str
    class_name: str
    visual: trimesh.Trimesh
    parts: tuple[trimesh.Trimesh, ...]

    @cached_property
    def fill(self) -> float:
        """The share of its convex hull that its parts fill: little for bowls, mugs and what else is hollow or bent."""
        hull = convex_hull(np.concatenate([part.vertices for part in self.parts]))
        return sum(abs(float(part.volume)) for part in self.parts) / abs(float(hull.volume))

    def signed_distance(self, cache: Path | None = None) -> SignedDistanceGrid:
        """Returns the signed-distance grid of the visual mesh, read from or written to the folder `cache`."""
        return cached_signed_distance_grid(self.visual, cache)


def clean_surface(mesh: trimesh.Trimesh, source: str) -> trimesh.Trimesh:
    """Returns the mesh with vertices merged by position and the winding of every closed component outward.

    Scans come with split vertices along texture seams and with single components turned inside out; both
    would break inside/outside tests and surface normals. Sheets come with a second side, whose faces are the
    first one's backwards; one side is left.

    Raises:
        DataError: a vertex is not finite, nothing but degenerate faces is left, or all of it lies in a plane.
    """
    if not np.isfinite(mesh.triangles).all():
        raise DataError(f"{source}: the mesh has vertices that are not finite numbers")
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    mesh.remove_unreferenced_vertices()
    mesh.merge_vertices(merge_tex=True, merge_norm=True)
    mesh.update_faces(mesh.nondegenerate_faces() & mesh.unique_faces())
    mesh.remove_unreferenced_vertices()
    if len(mesh.faces) == 0:
        raise DataError(f"{source}: the mesh is empty (no face with an area)")
    if _thickness(mesh.vertices) < FLAT * float(mesh.extents.max()):
        raise DataError(f"{source}: the mesh is flat (all its vertices lie in a plane)")
    trimesh.repair.fix_normals(mesh, multibody=True)
    return trimesh.Trimesh(np.asarray(mesh.vertices, np.float64), np.asarray(mesh.faces, np.int64), process=False)


def check_size(surface: trimesh.Trimesh, source: str) -> None:
    """Raises DataError where a surface [m] is of no size that a hand could meet."""
    longest = float(surface.extents.max())
    if not SMALLEST <= longest <= LARGEST:
        raise DataError(f"{source}: the longest side is {longest:.4g} m: are the units right?")


def _thickness(points: Float[np.ndarray, "n 3"]) -> float:
    """Returns the root mean square distance of points from the plane that fits them best."""
    offsets = points - points.mean(axis=0)
    return float(np.linalg.svd(offsets, compute_uv=False)[-1] / np.sqrt(len(points)))


def convex_hull(points: Float[np.ndarray, "n 3"]) -> trimesh.Trimesh:
    """Returns the convex hull of points as a closed mesh with outward winding.

    Raises:
        scipy.spatial.QhullError: the points lie in a plane, or are fewer than four.
    """
    qhull = ConvexHull(points)
    triangles = points[qhull.simplices]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    inward = np.einsum("ij,ij->i", normals, qhull.equations[:, :3]) < 0.0
    faces = np.where(inward[:, None], qhull.simplices[:, ::-1], qhull.simplices)
    index = np.zeros(len(points), np.int64)
    index[qhull.vertices] = np.arange(len(qhull.vertices))
    mesh = trimesh.Trimesh(points[qhull.vertices], index[faces], process=False)
    if not mesh.is_winding_consistent:  # slivers, whose own normals say nothing
        trimesh.repair.fix_normals(mesh)
    return mesh


def solid_hull(points: Float[np.ndarray, "n 3"]) -> trimesh.Trimesh:
    """Returns the convex hull of points, made `THINNEST` thick along each of its principal axes where it is thinner.

    Decompositions leave slivers and even flat pieces, which no physics engine takes for bodies.
    """
    for axis in np.linalg.svd(points - points.mean(axis=0), full_matrices=True)[2]:
        missing = THINNEST - float(np.ptp(points @ axis))
        if missing > 0.0:
            points = np.concatenate([points - missing / 2 * axis, points + missing / 2 * axis])
    return convex_hull(points)
