"""Contacts on the surfaces of placed objects, and how wide the object is behind each of them."""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float, Int

from icgnet.geometry.rays import ray_scene
from icgnet.geometry.workspace import TABLE_HEIGHT

STEEP = 0.5  # |n_z| below which a surface counts as a wall
WALL_SHARE = 0.85  # share of contacts on walls
TABLE_GAP = 0.005  # contacts are at least this far above the table [m]
DENSITY = 24  # surface samples drawn for every contact wanted
MAX_CROSSINGS = 12  # of a ray with one object
STEP = 1e-5  # a ray starts again this far behind a crossing [m]


@dataclass(frozen=True, eq=False)
class Contacts:
    """Points on objects where a finger pad may touch.

    Attributes:
        positions: [n 3] world frame [m].
        normals: [n 3] outward unit normals of the visual mesh, world frame.
        objects: [n] index of the object in the scene.
        widths: [n e] distances [m] along -normal at which a ray leaves the object, ascending, padded with inf: a
            hollow object has several (the wall of a mug, the whole mug).
    """

    positions: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    objects: Int[np.ndarray, "n"]
    widths: Float[np.ndarray, "n e"]

    def __len__(self) -> int:
        return len(self.positions)


def sample_contacts(meshes: list[trimesh.Trimesh], count: int, rng: np.random.Generator) -> Contacts:
    """`count` contacts, shared equally among the objects.

    Fewer come back only where an object has no surface above the table.

    Args:
        meshes: visual meshes in the world frame [m], one an object.
        count: number of contacts.
        rng: source of every draw.
    """
    shares = np.full(len(meshes), count // len(meshes))
    shares[rng.permutation(len(meshes))[: count % len(meshes)]] += 1
    return _concatenate([_sample_object(mesh, i, int(shares[i]), rng) for i, mesh in enumerate(meshes)])


def _sample_object(mesh: trimesh.Trimesh, index: int, count: int, rng: np.random.Generator) -> Contacts:
    surface = _Surface(mesh)
    positions, normals = surface.sample(DENSITY * count, rng)
    usable = positions[:, 2] >= TABLE_HEIGHT + TABLE_GAP
    positions, normals = positions[usable], normals[usable]
    outside = ~surface.is_inside(positions, normals)
    positions, normals = positions[outside], normals[outside]
    is_wall = np.abs(normals[:, 2]) < STEEP
    # Samples come in random order: the first ones of each kind are a fair draw.
    walls, others = np.flatnonzero(is_wall), np.flatnonzero(~is_wall)
    wanted = rng.binomial(count, WALL_SHARE)
    wanted = int(np.clip(wanted, count - len(others), len(walls)))
    chosen = np.concatenate([walls[:wanted], others[: count - wanted]])
    positions, normals = positions[chosen], normals[chosen]
    return Contacts(positions, normals, np.full(len(chosen), index), surface.exits(positions, normals))


def _concatenate(parts: list[Contacts]) -> Contacts:
    return Contacts(
        np.concatenate([part.positions for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.objects for part in parts]),
        np.concatenate([part.widths for part in parts]),
    )


class _Surface:
    """Ray queries on one mesh, which may consist of several overlapping closed pieces."""

    def __init__(self, mesh: trimesh.Trimesh) -> None:
        self._triangles = np.asarray(mesh.triangles)
        cross = np.cross(self._triangles[:, 1] - self._triangles[:, 0], self._triangles[:, 2] - self._triangles[:, 0])
        length = np.linalg.norm(cross, axis=1)
        self._area_sums = np.cumsum(length)
        self._normals = cross / np.maximum(length, 1e-12)[:, None]
        self._scene = ray_scene(self._triangles)

    def sample(self, count: int, rng: np.random.Generator) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Points uniform on the surface [m] and the normals there."""
        faces = np.searchsorted(self._area_sums, rng.uniform(0.0, self._area_sums[-1], count), side="right")
        faces = np.minimum(faces, len(self._triangles) - 1)
        a, b = rng.uniform(size=(2, count, 1))
        a, b = np.where(a + b > 1.0, 1.0 - a, a), np.where(a + b > 1.0, 1.0 - b, b)
        corner, second, third = np.moveaxis(self._triangles[faces], 1, 0)
        return corner + a * (second - corner) + b * (third - corner), self._normals[faces]

    def is_inside(self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> np.ndarray:
        """Which surface points lie inside another piece of the mesh: a ray outwards leaves more than it enters."""
        _, depth = self._crossings(points + 1e-4 * normals, normals)
        return depth.sum(axis=1) < 0

    def exits(self, points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n e"]:
        """Distances [m] along -normal where a ray from the surface leaves the union of all pieces, padded with inf."""
        start = 1e-4
        distances, entering = self._crossings(points - start * normals, -normals)
        depth = 1 + np.cumsum(entering, axis=1)
        widths = np.where((entering < 0) & (depth == 0), distances + start, np.inf)
        return np.sort(widths, axis=1)[:, :4]

    def _crossings(
        self, origins: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
    ) -> tuple[Float[np.ndarray, "n e"], Int[np.ndarray, "n e"]]:
        """Distance [m] of each surface that rays cross, and +1 where they enter, -1 where they leave, 0 for none."""
        travelled = np.zeros(len(origins))
        distances = np.full((len(origins), MAX_CROSSINGS), np.inf)
        entering = np.zeros((len(origins), MAX_CROSSINGS), int)
        active = np.arange(len(origins))
        for crossing in range(MAX_CROSSINGS):
            if len(active) == 0:
                break
            start = origins[active] + travelled[active, None] * directions[active]
            hits = self._scene.run(start.astype(np.float32), directions[active].astype(np.float32), output=True)
            is_hit = hits["primID"] >= 0
            active, faces = active[is_hit], hits["primID"][is_hit]
            travelled[active] += hits["tfar"][is_hit]
            distances[active, crossing] = travelled[active]
            facing = np.einsum("nk,nk->n", self._normals[faces], directions[active])
            entering[active, crossing] = np.where(facing < 0.0, 1, -1)
            travelled[active] += STEP
        return distances, entering
