"""Triangles that rays meet: the only file that builds embree's scenes."""

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from jaxtyping import Float


def ray_scene(triangles: Float[np.ndarray, "t 3 3"]) -> EmbreeScene:
    """The scene of these triangles [m], which it copies in single precision; rays meet nothing where there are none."""
    scene = EmbreeScene()
    if len(triangles):
        TriangleMesh(scene, np.ascontiguousarray(triangles, np.float32))
    return scene
