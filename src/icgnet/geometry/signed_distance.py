"""Signed-distance grids of meshes: who is inside whom, and by how much."""

import hashlib
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Float16, Int
from scipy import ndimage
from scipy.spatial import KDTree

from icgnet.files import new_file
from icgnet.geometry.rays import ray_scene

PITCH = 0.0015
"""Distance between neighbouring nodes [m], of all but thin-walled things."""
FINEST_PITCH = 0.0005
"""The same of things with the thinnest walls [m]: at 1.5 mm, a wall of 1 mm falls between the nodes."""
NODES_ACROSS_WALL = 1.5
MOST_FINE_NODES = 6_000_000
"""A grid is not made finer than this many nodes allow."""
PADDING = 0.006
"""Room between the mesh's bounding box and the border of the grid [m]."""

_FORMAT = 2
_NEIGHBOURS = np.ones((3, 3, 3), bool)
_WALL_SAMPLES = 256
_THIN_SHARE = 10
"""Percentile of the thickness that counts as that of the walls: every thing is thin along some edge."""
_JITTER = np.array([0.00213, 0.00137])
"""Shift of the columns [pitch], so that none runs exactly along an edge of a mesh with round coordinates."""


@dataclass(frozen=True, eq=False)
class SignedDistanceGrid:
    """Signed distance to a surface, sampled at the nodes of a grid: negative inside, positive outside [m].

    One grid serves all scales and places of an object: see `distance_from`.

    Attributes:
        origin: position of node (0, 0, 0) in the object frame [m].
        pitch: distance between neighbouring nodes [m].
        values: distance at each node [m].
    """

    origin: Float[np.ndarray, "3"]
    pitch: float
    values: Float16[np.ndarray, "x y z"]

    def distance_from(
        self,
        points: Float[np.ndarray, "n 3"],
        T_world_object: Float[np.ndarray, "4 4"],
        scale: float | Float[np.ndarray, "3"],
    ) -> Float[np.ndarray, "n"]:
        """Returns the signed distance of world points [m] from the object, scaled and placed.

        Of a stretched object (three factors), inside and outside are exact, and the distance is a bound: the nearest
        point of the surface is at least so far away, and at most the ratio of the largest to the smallest factor
        further.

        Args:
            points: world frame [m].
            T_world_object: pose of the object, without scale.
            scale: factor of its size, or one for each axis of its own frame.
        """
        local = (points - T_world_object[:3, 3]) @ T_world_object[:3, :3]
        return np.min(scale) * self.distance(local / scale)

    def distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Returns the signed distance of points in the object frame [m], trilinear between the nodes.

        Outside the grid it is a lower bound of the true distance: the object lies in the box, so the path
        through the box's nearest point makes an angle of at least 90 degrees there.
        """
        shape = np.array(self.values.shape)
        cells = (np.asarray(points, np.float64) - self.origin) / self.pitch
        clamped = np.clip(cells, 0.0, shape - 1.0)
        excess = np.linalg.norm(cells - clamped, axis=1) * self.pitch
        corner = np.minimum(clamped.astype(np.int64), shape - 2)
        fraction = clamped - corner
        flat = np.ravel_multi_index(corner.T, self.values.shape)
        step_x, step_y = int(shape[1] * shape[2]), int(shape[2])
        values = self.values.reshape(-1)
        x, y, z = fraction.T

        def along_z(offset: int) -> Float[np.ndarray, "n"]:
            return values[flat + offset] * (1.0 - z) + values[flat + offset + 1] * z

        near = along_z(0) * (1.0 - y) + along_z(step_y) * y
        far = along_z(step_x) * (1.0 - y) + along_z(step_x + step_y) * y
        inner = near * (1.0 - x) + far * x
        return np.where(excess > 0.0, np.hypot(inner, excess), inner)

    def save(self, path: Path) -> None:
        """Writes the grid as npz; the file appears whole or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with new_file(path) as file:
            np.savez_compressed(file, origin=self.origin, pitch=self.pitch, values=self.values)

    @classmethod
    def load(cls, path: Path) -> "SignedDistanceGrid":
        """Returns a grid that `save` wrote.

        Raises:
            ValueError, KeyError, EOFError, zipfile.BadZipFile: the file is not such a grid.
        """
        with np.load(path) as arrays:
            grid = cls(arrays["origin"], float(arrays["pitch"]), arrays["values"])
        if grid.values.ndim != 3 or grid.values.dtype != np.float16 or grid.origin.shape != (3,):
            raise ValueError(f"{path}: not a signed-distance grid")
        return grid


def cached_signed_distance_grid(mesh: trimesh.Trimesh, cache: Path | None) -> SignedDistanceGrid:
    """Returns the grid of a mesh from the folder `cache`, built and stored there first if it is missing or broken.

    The file's name is a hash of the mesh and of the grid's settings, so a changed mesh gets a new grid.
    """
    pitch = choose_pitch(mesh)
    if cache is None:
        return build_signed_distance_grid(mesh, pitch)
    path = cache / f"{surface_hash(mesh, f'{_FORMAT} {pitch} {PADDING}')}.npz"
    if path.is_file():
        try:
            return SignedDistanceGrid.load(path)
        except (ValueError, KeyError, EOFError, OSError, zipfile.BadZipFile):
            pass  # a damaged cache file is replaced below
    grid = build_signed_distance_grid(mesh, pitch)
    grid.save(path)
    return grid


def choose_pitch(mesh: trimesh.Trimesh) -> float:
    """Returns a pitch [m] at which the walls of a mesh have nodes inside: 1.5 mm for solid things, down to 0.5 mm."""
    box = float(np.prod(mesh.extents + 2.0 * PADDING))
    finest = max(FINEST_PITCH, (box / MOST_FINE_NODES) ** (1 / 3))
    return round(float(np.clip(wall_thickness(mesh) / NODES_ACROSS_WALL, min(finest, PITCH), PITCH)), 5)


def wall_thickness(mesh: trimesh.Trimesh) -> float:
    """Returns how thick a mesh is at its thinner places [m]: rays go inwards from points all over the surface.

    A tenth of the surface has less behind it. Infinite for a surface that encloses nothing.
    """
    rng = np.random.default_rng(0)
    faces = rng.choice(len(mesh.faces), _WALL_SAMPLES, p=mesh.area_faces / mesh.area_faces.sum())
    triangles = mesh.triangles[faces]
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    points = np.einsum("sc,scd->sd", rng.dirichlet((1.0, 1.0, 1.0), _WALL_SAMPLES), triangles) - 1e-5 * normals
    hits = ray_scene(np.asarray(mesh.triangles)).run(
        points.astype(np.float32), -normals.astype(np.float32), output=True
    )
    return float(np.percentile(np.where(hits["primID"] >= 0, hits["tfar"], np.inf), _THIN_SHARE, method="lower"))


def build_signed_distance_grid(
    mesh: trimesh.Trimesh, pitch: float = PITCH, padding: float = PADDING
) -> SignedDistanceGrid:
    """Returns the signed-distance grid of a mesh [m].

    Walls thinner than the pitch are lost in part: see `choose_pitch`.

    A node is inside when it is inside any of the mesh's connected components (so overlapping closed pieces are
    a union and a hollow that is open to the outside stays hollow). The direction of the faces does not matter.
    """
    lower, upper = mesh.bounds[0] - padding, mesh.bounds[1] + padding
    shape = tuple(int(nodes) for nodes in np.ceil((upper - lower) / pitch) + 1)
    inside = np.zeros(shape, bool)
    for component in mesh.split(only_watertight=False) if mesh.body_count > 1 else [mesh]:
        inside |= _inside(component, lower, pitch, shape)
    distance = _unsigned_distance(mesh, lower, pitch, inside)
    return SignedDistanceGrid(lower, pitch, np.where(inside, -distance, distance).astype(np.float16))


def surface_hash(mesh: trimesh.Trimesh, settings: str) -> str:
    """Returns a name for what is derived from a mesh with some settings: the same for the same surface only."""
    digest = hashlib.sha256(settings.encode())
    digest.update(np.asarray(mesh.vertices, np.float32).tobytes())
    digest.update(np.asarray(mesh.faces, np.int32).tobytes())
    return digest.hexdigest()[:32]


def _inside(
    mesh: trimesh.Trimesh, origin: Float[np.ndarray, "3"], pitch: float, shape: tuple[int, ...]
) -> Bool[np.ndarray, "x y z"]:
    """Returns which nodes are inside one component; one with holes is decided by two votes of three directions."""
    cells = (mesh.triangles - origin) / pitch
    if mesh.is_watertight:
        return _column_parity(cells, shape)
    votes = np.zeros(shape, np.int8)
    for axis in range(3):
        order = [(axis + 1) % 3, (axis + 2) % 3, axis]
        parity = _column_parity(cells[:, :, order], tuple(shape[i] for i in order))
        votes += np.transpose(parity, np.argsort(order))
    return votes >= 2


def _column_parity(cells: Float[np.ndarray, "t 3 3"], shape: tuple[int, ...]) -> Bool[np.ndarray, "x y z"]:
    """Returns for each node whether a ray from it to z = -infinity crosses the triangles an odd number of times.

    Args:
        cells: triangles in units of nodes.
        shape: nodes along x, y, z.
    """
    triangle, column = _covered_columns(cells[:, :, :2], shape)
    a, b, c = (cells[triangle, corner] for corner in range(3))
    position = column + _JITTER
    weight_a = _cross(b[:, :2] - position, c[:, :2] - position)
    weight_b = _cross(c[:, :2] - position, a[:, :2] - position)
    weight_c = _cross(a[:, :2] - position, b[:, :2] - position)
    area = weight_a + weight_b + weight_c
    hit = ((weight_a > 0) == (weight_b > 0)) & ((weight_b > 0) == (weight_c > 0)) & (area != 0)
    height = (weight_a * a[:, 2] + weight_b * b[:, 2] + weight_c * c[:, 2])[hit] / area[hit]
    first_above = np.clip(np.ceil(height), 0, shape[2]).astype(np.int64)
    crossings = np.zeros((shape[0], shape[1], shape[2] + 1), np.int32)
    np.add.at(crossings, (column[hit, 0], column[hit, 1], first_above), 1)
    return (np.cumsum(crossings, axis=2)[:, :, :-1] % 2).astype(bool)


def _covered_columns(
    corners: Float[np.ndarray, "t 3 2"], shape: tuple[int, ...]
) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p 2"]]:
    """Returns all pairs of a triangle and a column within the triangle's bounding rectangle."""
    first = np.clip(np.floor(corners.min(axis=1) - _JITTER), 0, None).astype(np.int64)
    last = np.minimum(np.ceil(corners.max(axis=1)), np.array(shape[:2]) - 1).astype(np.int64)
    size = np.maximum(last - first + 1, 0)
    count = size.prod(axis=1)
    triangle = np.repeat(np.arange(len(corners)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    row, column = np.divmod(within, np.maximum(size[triangle, 1], 1))
    return triangle, first[triangle] + np.stack([row, column], axis=1)


def _cross(a: Float[np.ndarray, "p 2"], b: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p"]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _unsigned_distance(
    mesh: trimesh.Trimesh, origin: Float[np.ndarray, "3"], pitch: float, inside: Bool[np.ndarray, "x y z"]
) -> Float[np.ndarray, "x y z"]:
    """Returns each node's distance to the surface [m]: exact near it, elsewhere to the nearest near node's foot."""
    samples, source = _surface_samples(mesh, pitch)
    cells = np.rint((samples - origin) / pitch).astype(np.int64)
    deep = np.asarray(ndimage.binary_erosion(inside, _NEIGHBOURS), bool)
    visible = ~deep[tuple(cells.T)]  # the rest is hidden where pieces overlap
    samples, source, cells = samples[visible], source[visible], cells[visible]
    near = np.zeros(inside.shape, bool)
    near[tuple(cells.T)] = True
    near = np.asarray(ndimage.binary_dilation(near, _NEIGHBOURS), bool)
    nodes = origin + np.argwhere(near) * pitch
    _, nearest = KDTree(samples).query(nodes, k=min(3, len(samples)))
    feet = np.zeros((3, *inside.shape), np.float32)
    feet[:, near] = _closest_point(mesh, nodes, source[nearest.reshape(len(nodes), -1)]).T

    index = np.empty((3, *inside.shape), np.int32)
    ndimage.distance_transform_edt(~near, return_distances=False, return_indices=True, indices=index)
    square = np.zeros(inside.shape, np.float32)
    for axis in range(3):
        line = origin[axis] + pitch * np.arange(inside.shape[axis])
        square += (np.expand_dims(line, [other for other in range(3) if other != axis]) - feet[axis][tuple(index)]) ** 2
    return np.sqrt(square)


def _surface_samples(mesh: trimesh.Trimesh, spacing: float) -> tuple[Float[np.ndarray, "s 3"], Int[np.ndarray, "s"]]:
    """Returns points all over the surface, no further apart than `spacing` [m], and their faces.

    Each face is filled with rows of points along its longest edge, the first one on that edge: its ends are the
    corners of a sliver, which no other row comes near.
    """
    corners = mesh.triangles
    edges = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    longest = edges.argmax(axis=1)
    a, b, c = (corners[np.arange(len(corners)), (longest + i) % 3] for i in range(3))
    length = edges.max(axis=1)
    along = np.ceil(length / spacing).astype(np.int64)
    rows = np.ceil(2.0 * mesh.area_faces / np.maximum(length, 1e-12) / spacing).astype(np.int64).clip(1)
    count = along * rows
    face = np.repeat(np.arange(len(corners)), count)
    within = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    row, column = np.divmod(within, along[face])
    v = (row / rows[face])[:, None]
    u = ((column + 0.5) / along[face])[:, None]
    return (1.0 - v) * ((1.0 - u) * a[face] + u * b[face]) + v * c[face], face


def _closest_point(
    mesh: trimesh.Trimesh, points: Float[np.ndarray, "n 3"], candidates: Int[np.ndarray, "n k"]
) -> Float[np.ndarray, "n 3"]:
    """Returns the nearest point of each point's candidate faces."""
    best, best_distance = np.zeros_like(points), np.full(len(points), np.inf)
    for column in candidates.T:
        foot = trimesh.triangles.closest_point(mesh.triangles[column], points)
        distance = np.linalg.norm(foot - points, axis=1)
        closer = distance < best_distance
        best[closer], best_distance[closer] = foot[closer], distance[closer]
    return best
