"""How much of a scene's objects a camera sees, and how much of what it sees is no object."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.geometry.camera import DEFAULT_INTRINSICS, sphere_pose
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.camera import SceneRenderer
from icgnet.simulation.scene import BACKGROUND, Scene, world_mesh

SHAPE = (240, 320)
POLAR = {"packed": 45.0, "pile": 45.0, "table": 45.0, "bin": 20.0}
"""Of the camera from the vertical [degrees]; walls hide what is in a bin."""
NEAREST, SPAN = 0.35, 1.1
"""Distance of the camera from the middle of the objects: at least so much [m], and so much for each metre of them."""


@dataclass(frozen=True, eq=False)
class Sight:
    """What one camera sees.

    Attributes:
        visible: pixels of each object, by what it would have alone in the picture; 1 where that is nothing.
        background: share of the pixels above the table that show structures.
    """

    visible: Float[np.ndarray, "i"]
    background: float


def look_at(scene: Scene, object_set: ObjectSet) -> Sight:
    """A look at all objects of a scene, from one side."""
    meshes = [world_mesh(placed, object_set) for placed in scene.objects]
    corners = np.array([mesh.bounds for mesh in meshes])
    lower, upper = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    distance = NEAREST + SPAN * float((upper - lower)[:2].max())
    middle = np.array([*((lower + upper)[:2] / 2), TABLE_HEIGHT])
    pose = sphere_pose(middle, distance, np.deg2rad(POLAR[scene.kind]), 0.0)
    intrinsics = DEFAULT_INTRINSICS * [[0.5], [0.5], [1.0]]
    triangles = [mesh.triangles for mesh in meshes]
    owners = [np.full(len(own), index) for index, own in enumerate(triangles)]
    alone = [
        (SceneRenderer(own, owner).render(intrinsics, SHAPE, pose).ids == index).sum()
        for index, (own, owner) in enumerate(zip(triangles, owners, strict=True))
    ]
    for structure in scene.surroundings.structures:
        if structure.corners[:, 2].max() > TABLE_HEIGHT:
            triangles.append(structure.mesh().triangles)
            owners.append(np.full(len(triangles[-1]), BACKGROUND))
    renderer = SceneRenderer(np.concatenate(triangles), np.concatenate(owners), extent=scene.surroundings.extent)
    ids = renderer.render(intrinsics, SHAPE, pose).ids
    together = np.array([(ids == index).sum() for index in range(len(meshes))])
    things, background = int((ids >= 0).sum()), int((ids == BACKGROUND).sum())
    visible = np.where(np.array(alone) > 0, together / np.maximum(alone, 1), 1.0)
    return Sight(visible, background / max(things + background, 1))
