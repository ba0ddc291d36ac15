import subprocess
import sys

import numpy as np
import pytest
import trimesh

from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, look_at, pixel_rays, sphere_pose, unproject
from icgnet.geometry.transforms import transform_points
from icgnet.simulation.camera import NOTHING, TABLE, SceneRenderer
from icgnet.simulation.config import WideScenes
from icgnet.simulation.furniture import draw_bin, draw_table
from icgnet.simulation.scene import BACKGROUND
from icgnet.simulation.surroundings import Structure

VIEW = sphere_pose(np.array([0.15, 0.15, 0.1]), 0.6, 0.7, 1.0)


def _renderer(*meshes, table_height=0.05):
    triangles = np.concatenate([np.zeros((0, 3, 3)), *(mesh.triangles for mesh in meshes)])
    owners = np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes])
    return SceneRenderer(triangles, owners, table_height)


def _box(centre, edge=0.06):
    mesh = trimesh.creation.box(extents=[edge] * 3)
    mesh.apply_translation(centre)
    return mesh


def test_depth_of_a_sphere_is_the_analytic_one():
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    sphere.apply_translation([0.15, 0.15, 0.1])
    image = _renderer(sphere).render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, VIEW)
    rays = pixel_rays(DEFAULT_INTRINSICS, DEFAULT_SHAPE) @ VIEW[:3, :3].T
    # |eye + t ray - centre| = radius.
    to_centre = np.array([0.15, 0.15, 0.1]) - VIEW[:3, 3]
    a, b = (rays**2).sum(-1), rays @ to_centre
    discriminant = b**2 - a * (to_centre @ to_centre - 0.05**2)
    expected = (b - np.sqrt(np.maximum(discriminant, 0.0))) / a
    well_inside = discriminant > 0.1 * discriminant.max()
    assert (image.ids[well_inside] == 0).all()
    np.testing.assert_allclose(image.depth[well_inside], expected[well_inside], atol=2e-4)


def test_unprojected_table_pixels_lie_on_the_table():
    image = _renderer(_box([0.15, 0.15, 0.08])).render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, VIEW)
    points = transform_points(VIEW, unproject(image.depth, DEFAULT_INTRINSICS))
    np.testing.assert_allclose(points[image.ids == TABLE][:, 2], 0.05, atol=1e-5)


def test_unprojected_object_pixels_lie_on_the_object_that_they_name():
    boxes = [_box([0.1, 0.1, 0.08]), _box([0.2, 0.2, 0.08], edge=0.05)]
    image = _renderer(*boxes).render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, VIEW)
    points = transform_points(VIEW, unproject(image.depth, DEFAULT_INTRINSICS))
    for index, box in enumerate(boxes):
        seen = points[image.ids == index]
        assert len(seen) > 500
        assert np.abs(trimesh.proximity.signed_distance(box, seen[::37])).max() < 1e-5


def test_the_nearer_object_hides_the_one_behind():
    above, below = _box([0.15, 0.15, 0.2]), _box([0.15, 0.15, 0.1], edge=0.05)
    camera = look_at(np.array([0.15, 0.15, 0.6]), np.array([0.15, 0.15, 0.0]))
    image = _renderer(below, above).render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, camera)
    assert set(np.unique(image.ids)) == {TABLE, 1}
    assert image.depth[240, 320] == pytest.approx(0.6 - 0.23, abs=1e-5)


def test_a_table_between_camera_and_object_hides_it():
    camera = look_at(np.array([0.15, 0.15, -0.4]), np.array([0.15, 0.15, 0.1]))
    image = _renderer(_box([0.15, 0.15, 0.08])).render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, camera)
    assert (image.ids == TABLE).all()
    np.testing.assert_allclose(image.depth, 0.45, rtol=1e-5)


def test_what_is_out_of_range_is_not_measured():
    camera = look_at(np.array([0.15, -1.0, 0.2]), np.array([0.15, 0.15, 0.2]))
    image = _renderer(_box([0.15, 0.15, 0.2]), _box([0.15, 1.5, 0.2], edge=0.5)).render(
        DEFAULT_INTRINSICS, DEFAULT_SHAPE, camera
    )
    assert set(np.unique(image.ids)) == {TABLE, NOTHING, 0}
    assert image.depth.max() <= 2.0
    assert (image.depth[image.ids == NOTHING] == 0).all()
    assert (image.depth[image.ids != NOTHING] > 0).all()


def test_without_table_and_objects_nothing_is_seen():
    image = _renderer(table_height=None).render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, VIEW)
    assert (image.ids == NOTHING).all()
    assert (image.depth == 0).all()


def test_turning_scene_and_camera_together_changes_nothing():
    turn = trimesh.transformations.rotation_matrix(0.9, [0, 0, 1], [0.15, 0.15, 0.0])
    box, turned = _box([0.1, 0.12, 0.08]), _box([0.1, 0.12, 0.08])
    turned.apply_transform(turn)
    shape = (120, 160)
    intrinsics = np.array([[135.0, 0.0, 80.0], [0.0, 135.0, 60.0], [0.0, 0.0, 1.0]])
    before = _renderer(box).render(intrinsics, shape, VIEW)
    after = _renderer(turned).render(intrinsics, shape, turn @ VIEW)
    assert np.mean(before.ids == after.ids) > 0.999
    same = before.ids == after.ids
    np.testing.assert_allclose(before.depth[same], after.depth[same], atol=1e-5)


def test_a_camera_among_the_triangles_sees_those_in_front():
    camera = look_at(np.array([0.15, 0.15, 0.2]), np.array([0.5, 0.15, 0.2]))
    image = _renderer(_box([0.15, 0.15, 0.2], edge=0.3)).render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, camera)
    assert image.ids[240, 320] == 0
    assert image.depth[240, 320] == pytest.approx(0.15, abs=1e-5)


def test_the_camera_does_not_load_the_physics_engine():
    code = "import icgnet.simulation.camera, sys; sys.exit('mujoco' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def _with_structures(structures, boxes, extent=None):
    """Renderers of the same scene with the structures as planes and as triangles."""
    own = np.concatenate([np.zeros((0, 3, 3)), *(mesh.triangles for mesh in boxes)])
    owners = np.repeat(np.arange(len(boxes)), [len(mesh.triangles) for mesh in boxes])
    around = [each.mesh().triangles for each in structures]
    background = np.full(sum(map(len, around)), BACKGROUND)
    return (
        SceneRenderer(own, owners, extent=extent, structures=structures),
        SceneRenderer(np.concatenate([own, *around]), np.append(owners, background), extent=extent),
    )


@pytest.mark.parametrize("seed", range(8))
def test_structures_as_planes_give_the_picture_of_their_triangles(seed):
    rng = np.random.default_rng(seed)
    surroundings = (draw_table, draw_bin)[seed % 2](WideScenes(), rng)
    boxes = [_box([0.15, 0.15, 0.08]), _box([0.22, 0.1, 0.08])]
    planes, triangles = _with_structures(surroundings.structures, boxes, surroundings.extent)
    pose = sphere_pose(np.array([0.15, 0.15, 0.1]), 0.7, rng.uniform(0.0, 1.2), rng.uniform(0.0, 6.0))
    intrinsics = DEFAULT_INTRINSICS * [[0.25], [0.25], [1.0]]
    ours, theirs = (each.render(intrinsics, (120, 160), pose) for each in (planes, triangles))
    same = ours.ids == theirs.ids
    assert same.mean() > 0.9995
    np.testing.assert_allclose(ours.depth[same], theirs.depth[same], atol=1e-4)
    assert (ours.ids == BACKGROUND).sum() > 100
    assert (ours.ids >= 0).any()


def test_inside_of_a_structure_the_camera_sees_where_its_rays_leave_it():
    cube = np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (-1.0, 1.0))).reshape(3, 8).T
    planes, triangles = _with_structures([Structure("room", cube)], [_box([0.15, 0.15, 0.08])])
    ours, theirs = (each.render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, VIEW) for each in (planes, triangles))
    assert (ours.ids == theirs.ids).mean() > 0.9995
    level = look_at(VIEW[:3, 3], VIEW[:3, 3] + [1.0, 0.0, 0.0])
    image = planes.render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, level)
    assert image.ids[240, 320] == BACKGROUND
    assert image.depth[240, 320] == pytest.approx(1.0 - VIEW[0, 3], abs=1e-3)


def test_what_is_behind_the_camera_is_not_seen():
    behind = Structure("wall", np.array(np.meshgrid((-1.0, 1.0), (-1.0, 1.0), (2.0, 2.1))).reshape(3, 8).T)
    planes, _ = _with_structures([behind], [_box([0.15, 0.15, 0.08])])
    assert not (planes.render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, VIEW).ids == BACKGROUND).any()
