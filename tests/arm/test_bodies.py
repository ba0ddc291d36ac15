"""What stands around an arm."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import needs_arm  # noqa: F401
from arm_scenes import T_BASE_FRAME, box
from icgnet.arm.bodies import BACKGROUND, SUPPORT, bodies_of, cubes_around
from icgnet.geometry.clouds import PointCloud
from icgnet.inference.prediction import NO_INSTANCE


def test_cubes_around_points_cover_what_they_fill():
    points = 0.01 * np.array([[0.5, 0.5, 0.5], [0.6, 0.4, 0.5], [1.5, 0.5, 0.5], [4.5, 0.5, 0.5]])
    mesh = cubes_around(points, 0.01)
    assert len(mesh.faces) == 2 * (10 + 6)  # the wall between the first two is left out
    assert mesh.volume == pytest.approx(3e-6)  # positive: the faces look outwards


def test_shapes_and_support_are_in_the_frame_of_the_base(seen):
    bodies = {body.name: body for body in bodies_of(seen([box((0.05, 0.04, 0.08))]), T_BASE_FRAME)}
    assert set(bodies) == {SUPPORT, "object 0"}
    np.testing.assert_allclose(bodies["object 0"].mesh.bounds, [[0.475, -0.02, 0.0], [0.525, 0.02, 0.08]], atol=1e-9)
    assert bodies[SUPPORT].mesh.bounds[1, 2] == pytest.approx(0.0)
    assert not bodies["object 0"].from_points


def test_points_stand_for_objects_where_they_are_asked_for_or_no_shape_is(seen):
    prediction = seen([box((0.05, 0.04, 0.08)), box((0.05, 0.04, 0.08), y=0.25)])
    shapeless = replace(prediction.objects[1], extract=trimesh.Trimesh)
    mixed = bodies_of(replace(prediction, objects=(prediction.objects[0], shapeless)), T_BASE_FRAME)
    assert [body.from_points for body in mixed] == [False, False, True]
    points = bodies_of(prediction, T_BASE_FRAME, "points")
    assert [body.from_points for body in points] == [False, True, True]
    lower, upper = points[1].mesh.bounds
    assert (lower <= np.array([0.475, -0.02, 0.0]) + 1e-9).all()
    assert (upper >= np.array([0.525, 0.02, 0.08]) - 1e-9).all()
    assert (upper - lower < np.array([0.05, 0.04, 0.08]) + 0.0121).all()


def background_of(prediction, stray):
    """The body of the points that belong to no object, if there is one; the points are given in the table's frame."""
    count = len(prediction.cloud.points) + len(stray)
    cloud = PointCloud(np.concatenate([prediction.cloud.points, stray]), None, "world")
    labels = np.concatenate([prediction.cloud_instances, np.full(len(stray), NO_INSTANCE)])
    changed = replace(
        prediction, cloud=cloud, cloud_instances=labels, input_rows=np.arange(count), input_shape=(count,)
    )
    return next((body for body in bodies_of(changed, T_BASE_FRAME) if body.name == BACKGROUND), None)


def test_points_of_no_object_are_background_unless_they_lie_on_the_support_or_alone(seen):
    stray = np.array(
        [[0.304, 0.305, 0.155], [0.306, 0.305, 0.155], [0.0, 0.3, 0.155], [0.2, 0.3, 0.055], [0.2, 0.3, 0.056]]
    )
    background = background_of(seen([box((0.05, 0.04, 0.08))]), stray)
    assert background is not None
    assert background.mesh.volume == pytest.approx(1e-6)
    np.testing.assert_allclose(background.mesh.bounds.mean(axis=0), [0.655, 0.155, 0.105], atol=1e-6)


def test_beside_an_object_background_is_as_large_as_its_points_and_at_its_edge_there_is_none(seen):
    prediction = seen([box((0.05, 0.04, 0.08))])
    upper = prediction.cloud.points.max(axis=0)
    pair = np.array([[0.0, -0.001, -0.02], [0.0, 0.001, -0.02]])
    assert background_of(prediction, upper + pair + [0.005, -0.001, 0.0]) is None
    beside = background_of(prediction, upper + pair + [0.03, -0.001, 0.0])
    far = background_of(prediction, upper + pair + [0.09, -0.001, 0.0])
    assert beside is not None
    assert far is not None
    assert np.ptp(beside.mesh.bounds, axis=0).max() <= 0.008 + 1e-9 < np.ptp(far.mesh.bounds, axis=0).max()
