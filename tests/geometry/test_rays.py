import gc

import numpy as np
import trimesh

from icgnet.geometry.rays import ray_scene

DIRECTIONS = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, 1.0]], np.float32)
CENTRE = np.zeros((3, 3), np.float32)


def test_the_scene_outlives_the_array_that_it_was_made_of():
    triangles = np.array(trimesh.creation.box([2.0, 4.0, 6.0]).triangles)
    scene = ray_scene(triangles)
    triangles[:] = np.nan
    del triangles
    gc.collect()
    np.testing.assert_allclose(scene.run(CENTRE, DIRECTIONS, output=True)["tfar"], [1.0, 2.0, 3.0], rtol=1e-6)


def test_rays_meet_nothing_where_there_is_nothing():
    assert (ray_scene(np.zeros((0, 3, 3))).run(CENTRE, DIRECTIONS, output=True)["primID"] < 0).all()
