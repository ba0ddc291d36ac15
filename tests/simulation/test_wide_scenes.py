"""Masses, pictures, approaches and attempts in scenes with edges and walls."""

from dataclasses import replace

import numpy as np
import pytest

from box_objects import BoxAndBall
from icgnet.geometry.camera import look_at
from icgnet.geometry.transforms import make_transform
from icgnet.simulation.approach import ApproachChecker
from icgnet.simulation.camera import SceneRenderer
from icgnet.simulation.config import Physics, default_physics
from icgnet.simulation.physics import Body
from icgnet.simulation.scene import BACKGROUND, NOTHING, TABLE, PlacedObject, Scene, scene_triangles
from icgnet.simulation.surroundings import BIN_WALL, Surroundings, block
from icgnet.simulation.workcell import PROTOCOLS, Cause, Workcell, _planes
from icgnet.simulation.world import World

DOWN = np.diag([1.0, -1.0, -1.0])
EXTENT = (-0.1, -0.1, 0.4, 0.4)
INTRINSICS = np.array([[150.0, 0.0, 80.0], [0.0, 150.0, 60.0], [0.0, 0.0, 1.0]])
SHAPE = (120, 160)
WALL = block(BIN_WALL, (0.3, 0.01, 0.15), make_transform(np.eye(3), np.array([0.15, 0.20, 0.125])))
WALLED = Surroundings(EXTENT, (WALL,))


def at(x, y, z):
    return make_transform(np.eye(3), np.array([x, y, z]))


def masses(bodies, physics):
    model = World(bodies, physics).model
    return [float(model.body(f"object_{index}").mass[0]) for index in range(len(bodies))]


def scene_of_a_box(surroundings, x=0.15, y=0.15):
    return Scene("table", (PlacedObject("box", 1.0, at(x, y, 0.08)),), surroundings)


def renderer_of(scene):
    return SceneRenderer(*scene_triangles(scene, BoxAndBall()), extent=scene.surroundings.extent)


def test_density_decides_masses_within_limits_and_follows_the_stretch(box):
    dense = default_physics("table")
    cases = {0.05: 0.05, 0.01: 0.02, 0.3: 1.0}
    bodies = [Body(box(edge, edge, edge), 1.0, at(0.5 * k, 0.0, 1.0)) for k, edge in enumerate(cases)]
    np.testing.assert_allclose(masses(bodies, dense), list(cases.values()), rtol=1e-5)
    stretched = Body(box(0.05, 0.05, 0.05), 1.2, at(0.0, 0.0, 1.0), (1.0, 1.1, 1.0))
    np.testing.assert_allclose(masses([stretched], dense), [0.05 * 1.2**3 * 1.1], rtol=1e-5)


@pytest.mark.parametrize("kind", ["packed", "pile"])
def test_objects_in_the_cube_weigh_what_they_did(box, kind):
    bodies = [Body(box(edge, edge, edge), 1.0, at(0.5 * k, 0.0, 1.0)) for k, edge in enumerate((0.02, 0.1))]
    np.testing.assert_allclose(masses(bodies, default_physics(kind)), 0.5, rtol=1e-6)


def test_a_stretched_box_is_stretched_in_the_engine(box):
    body = Body(box(0.04, 0.06, 0.1), 1.5, at(0.0, 0.0, 1.0), (1.0, 1.0, 0.9))
    model = World([body], Physics()).model
    geom = int(model.body("object_0").geomadr[0])
    assert model.geom_rbound[geom] == pytest.approx(np.linalg.norm([0.06, 0.09, 0.135]) / 2, rel=1e-4)


def test_the_table_ends_at_its_edge():
    eye = np.array([0.15, 0.15, 1.5])
    image = renderer_of(scene_of_a_box(Surroundings(EXTENT))).render(INTRINSICS, SHAPE, look_at(eye, eye * [1, 1, 0]))
    # Half of 0.5 m at a distance of 1.45 m.
    reach = 150 * 0.25 / 1.45
    row, column = np.indices(SHAPE)
    off = np.maximum(np.abs(column - 80), np.abs(row - 60))
    assert (image.ids[off > reach + 1] == NOTHING).all()
    assert (image.depth[off > reach + 1] == 0).all()
    assert np.isin(image.ids[off < reach - 1], (TABLE, 0)).all()
    floor = block("floor", (3.0, 3.0, 0.1), at(0.15, 0.15, -0.35))
    below = renderer_of(scene_of_a_box(Surroundings(EXTENT, (floor,))))
    image = below.render(INTRINSICS, SHAPE, look_at(eye, eye * [1, 1, 0]))
    assert (image.ids[off > reach + 1] == BACKGROUND).all()
    np.testing.assert_allclose(image.depth[off > reach + 1], 1.8, atol=1e-4)


@pytest.mark.parametrize("eye", [[0.15, -0.5, 0.6], [0.15, 0.15, 0.6], [0.15, 0.5, 0.2]])
def test_pictures_are_those_of_rays_through_all_pixels(eye, monkeypatch):
    renderer = renderer_of(scene_of_a_box(WALLED))
    pose = look_at(np.array(eye), np.array([0.15, 0.16, 0.08]))
    image = renderer.render(INTRINSICS, SHAPE, pose)
    assert (image.ids == BACKGROUND).sum() > 50
    everywhere = (slice(0, SHAPE[0]), slice(0, SHAPE[1])), np.ones(SHAPE, bool)
    monkeypatch.setattr(renderer, "_window", lambda *_: everywhere)
    complete = renderer.render(INTRINSICS, SHAPE, pose)
    np.testing.assert_array_equal(image.ids, complete.ids)
    np.testing.assert_array_equal(image.depth, complete.depth)


def test_a_grasp_that_is_free_on_a_table_collides_with_a_wall(standing_box, gripper):
    pose, opening = make_transform(DOWN, np.array([0.15, 0.15, 0.12]))[None], np.array([0.062])
    bodies = [standing_box(0.05, 0.05, 0.1)]
    free = ApproachChecker(bodies, gripper, Physics(), surroundings=Surroundings(EXTENT))
    assert free.collides(pose, opening).tolist() == [False]
    walled = ApproachChecker(bodies, gripper, Physics(), surroundings=WALLED)
    assert walled.collides(pose, opening).tolist() == [True]


def test_who_touches_a_wall_on_the_way_has_touched_the_table(gripper):
    pose = make_transform(DOWN, np.array([0.15, 0.15, 0.08]))
    for surroundings, touched in ((Surroundings(EXTENT), set()), (WALLED, {TABLE})):
        cell = Workcell(scene_of_a_box(surroundings), BoxAndBall(), gripper)
        outcome = cell.execute(pose, 0.075, PROTOCOLS["strict"])
        assert set(outcome.touched) - {0} == touched
        assert outcome.cause is (Cause.TOUCHED if touched else Cause.HELD)


def test_what_goes_over_the_edge_of_the_table_is_lost(gripper):
    stands = scene_of_a_box(Surroundings(EXTENT), x=0.38)
    hangs = replace(stands.objects[0], T_world_object=at(0.15, 0.42, 0.08))
    cell = Workcell(replace(stands, objects=(*stands.objects, hangs)), BoxAndBall(), gripper)
    outcome = cell.execute(make_transform(DOWN, np.array([0.0, 0.0, 0.2])), 0.07, PROTOCOLS["edge"])
    assert outcome.lost == (1,)
    assert cell.remaining.tolist() == [0]


def test_distances_from_a_stretched_body_are_in_metres(box):
    body = Body(box(0.04, 0.06, 0.1), 1.5, np.eye(4), (1.0, 1.2, 0.9))
    half = np.array([0.04, 0.06, 0.1]) / 2 * body.factors
    ((normals, offsets),) = _planes(body)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    for axis in range(3):
        point = np.zeros(3)
        point[axis] = half[axis] + 0.013
        assert (normals @ point - offsets).max() == pytest.approx(0.013)


def test_sides_that_are_aslant_turn_with_the_stretch():
    ball = BoxAndBall().model("ball")
    body = Body(ball, 1.1, np.eye(4), (1.0, 1.0, 1.2))
    ((normals, offsets),) = _planes(body)
    triangles = ball.parts[0].triangles * body.factors
    np.testing.assert_allclose(
        np.einsum("fk,fck->fc", normals, triangles), np.repeat(offsets[:, None], 3, 1), atol=1e-7
    )
