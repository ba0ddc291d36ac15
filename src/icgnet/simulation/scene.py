"""What stands on the table: object names, scales and poses. No physics engine needed to read it."""

from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float, Int

from icgnet.geometry.transforms import transform_points
from icgnet.objects.kinds import Kind
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.surroundings import ENDLESS, Surroundings

NOTHING, TABLE, BACKGROUND = -1, -2, -3
"""What stands for these in the place of an object's index."""


@dataclass(frozen=True, eq=False)
class PlacedObject:
    """An object of an object set, scaled and placed.

    Attributes:
        name: its key in the object set.
        scale: factor on the mesh.
        T_world_object: pose of the scaled mesh [m].
        stretch: further factors along the axes of the mesh.
    """

    name: str
    scale: float
    T_world_object: Float[np.ndarray, "4 4"]
    stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)

    @property
    def factors(self) -> Float[np.ndarray, "3"]:
        """Scale and stretch along the axes of the mesh."""
        return self.scale * np.array(self.stretch)


@dataclass(frozen=True)
class Scene:
    """Objects at rest.

    Attributes:
        kind: "packed" (standing side by side), "pile" (dropped), "table" or "bin".
        objects: what can be grasped.
        surroundings: what carries them and what stands around them.
    """

    kind: Kind
    objects: tuple[PlacedObject, ...]
    surroundings: Surroundings = ENDLESS


def scene_triangles(scene: Scene, object_set: ObjectSet) -> tuple[Float[np.ndarray, "t 3 3"], Int[np.ndarray, "t"]]:
    """The triangles [m] of all visual meshes in the world frame, and the object index that owns each.

    Those of structures are owned by `BACKGROUND`.
    """
    triangles = [world_mesh(placed, object_set).triangles for placed in scene.objects]
    owners = [np.full(len(own), index) for index, own in enumerate(triangles)]
    for structure in scene.surroundings.structures:
        triangles.append(structure.mesh().triangles)
        owners.append(np.full(len(triangles[-1]), BACKGROUND))
    return np.concatenate([np.zeros((0, 3, 3)), *triangles]), np.concatenate([np.zeros(0, int), *owners])


def world_mesh(placed: PlacedObject, object_set: ObjectSet) -> trimesh.Trimesh:
    """The visual mesh of a placed object in the world frame [m]."""
    mesh = object_set.model(placed.name).visual
    vertices = transform_points(placed.T_world_object, mesh.vertices * placed.factors)
    return trimesh.Trimesh(vertices, mesh.faces, process=False)
