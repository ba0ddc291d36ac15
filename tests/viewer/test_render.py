import numpy as np
import pytest
import trimesh

from icgnet.viewer.palette import instance_colour
from icgnet.viewer.render import TableSurface, render
from icgnet.viewer.triangles import Triangles, disc_triangles, join, mesh_triangles
from icgnet.viewer.view import Perspective, framing_view

SHAPE = (120, 160)
BLUE, ORANGE = instance_colour(0), instance_colour(1)
FROM_THE_SIDE = (-np.pi / 2, np.deg2rad(30.0))


def ball(x: float, y: float, z: float = 0.1, radius: float = 0.03) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=3, radius=radius).apply_translation([x, y, z])


def view_of(
    triangles: Triangles, azimuth: float = FROM_THE_SIDE[0], elevation: float = FROM_THE_SIDE[1]
) -> Perspective:
    return framing_view(triangles.corners.reshape(-1, 3), azimuth, elevation, SHAPE)


def nearest_colour(pixel: np.ndarray, colours: list[tuple[float, float, float]]) -> int:
    """Index of the colour with the most similar hue, whatever the light."""
    chroma = [np.array(c) / np.linalg.norm(c) for c in colours]
    return int(np.argmax([c @ (pixel / np.linalg.norm(pixel)) for c in chroma]))


def test_each_object_has_its_colour_where_it_projects():
    left, right = mesh_triangles(ball(0.08, 0.15), BLUE), mesh_triangles(ball(0.22, 0.15), ORANGE)
    drawn = join([left, right])
    view = view_of(drawn)
    image = render(drawn, None, view, SHAPE)
    centres = view.project(np.array([[0.08, 0.15, 0.1], [0.22, 0.15, 0.1]]), SHAPE)
    found = [nearest_colour(image[round(v), round(u)].astype(float), [BLUE, ORANGE]) for u, v in centres]
    assert found == [0, 1]


def test_the_nearer_object_hides_the_farther_one():
    far, near = mesh_triangles(ball(0.15, 0.2), BLUE), mesh_triangles(ball(0.15, 0.1), ORANGE)
    view = Perspective(framing_view(near.corners.reshape(-1, 3), -np.pi / 2, 0.0, SHAPE).T_world_camera)
    image = render(join([far, near]), None, view, SHAPE)
    assert nearest_colour(image[60, 80].astype(float), [BLUE, ORANGE]) == 1


def test_nothing_is_left_of_the_paper_without_triangles():
    view = framing_view(np.array([[0.0, 0.0, 0.0], [0.3, 0.3, 0.1]]), *FROM_THE_SIDE, SHAPE)
    assert (render(join([]), None, view, SHAPE) == 255).all()


def test_a_table_is_nearly_white_and_fades_into_the_paper():
    view = framing_view(np.array([[0.0, 0.0, 0.0], [0.3, 0.3, 0.1]]), *FROM_THE_SIDE, SHAPE)
    image = render(join([]), TableSurface(0.05, (0.15, 0.15), 0.15), view, SHAPE)
    assert image.min() > 220
    assert (image < 255).any()
    assert (image[[0, -1]] == 255).all()


def test_an_object_throws_a_shadow_on_the_table():
    drawn = mesh_triangles(ball(0.15, 0.15, 0.12), BLUE)
    view = framing_view(np.array([[0.0, 0.0, 0.05], [0.3, 0.3, 0.2]]), *FROM_THE_SIDE, SHAPE)
    table = TableSurface(0.05, (0.15, 0.15), 0.4)
    grey = [render(scene, table, view, SHAPE).std(axis=2) < 2 for scene in (join([]), drawn)]
    empty, full = (render(scene, table, view, SHAPE).astype(int) for scene in (join([]), drawn))
    darker = (full.sum(axis=2) < empty.sum(axis=2) - 60) & grey[1]
    assert darker.sum() > 100


def test_what_lies_under_the_table_is_not_seen():
    drawn = mesh_triangles(ball(0.15, 0.15, 0.0), BLUE)
    view = view_of(drawn)
    image = render(drawn, TableSurface(0.05, (0.15, 0.15), 0.3), view, SHAPE)
    assert np.ptp(image.astype(int), axis=2).max() < 5


def test_see_through_surfaces_let_half_of_what_is_behind_through():
    solid = mesh_triangles(ball(0.15, 0.2), ORANGE)
    glass = mesh_triangles(trimesh.creation.box([0.1, 0.01, 0.1]).apply_translation([0.15, 0.1, 0.1]), BLUE, 0.5)
    view = framing_view(solid.corners.reshape(-1, 3), -np.pi / 2, 0.0, SHAPE)
    pixels = [render(scene, None, view, SHAPE)[60, 80].astype(float) for scene in (solid, join([solid, glass]))]
    opaque_glass = Triangles(glass.corners, glass.normals, glass.colours, np.ones(len(glass)))
    only_glass = render(join([solid, opaque_glass]), None, view, SHAPE)[60, 80].astype(float)
    mixed = ((pixels[0] / 255) ** 2.2 + (only_glass / 255) ** 2.2) / 2
    assert 255 * mixed ** (1 / 2.2) == pytest.approx(pixels[1], abs=6)


def test_points_are_drawn_as_discs_of_their_radius():
    point = np.array([[0.15, 0.15, 0.1]])
    disc = disc_triangles(point, np.array([[0.0, 0.0, 1.0]]), np.array([BLUE]), 0.01)
    view = framing_view(point + np.array([[0.02, 0.02, 0.0], [-0.02, -0.02, 0.0]]), 0.0, np.deg2rad(89.9), SHAPE)
    image = render(disc, None, view, SHAPE).astype(int)
    coverage = (255 - image.min(axis=2)).sum() / (255 - image.min())
    pixel = np.linalg.norm(view.T_world_camera[:3, 3] - point[0]) / view.intrinsics(SHAPE)[0, 0]
    hexagon = 1.5 * np.sqrt(3) * 0.01**2
    assert coverage * pixel**2 == pytest.approx(hexagon, rel=0.08)


@pytest.mark.parametrize("azimuth", [0.0, 1.0, 2.5, -2.0])
@pytest.mark.parametrize("elevation", [0.0, 0.7, 1.5])
def test_a_framing_view_shows_every_point_inside_of_its_margins(azimuth, elevation):
    points = np.random.default_rng(0).uniform([0, 0, 0.05], [0.3, 0.2, 0.2], (200, 3))
    pixels = framing_view(points, azimuth, elevation, SHAPE, margin=0.1).project(points, SHAPE)
    free = np.stack([pixels.min(axis=0), np.array(SHAPE[::-1]) - pixels.max(axis=0)]) / SHAPE[::-1]
    assert free.min() > 0.09
    assert free.min(axis=0).min() < 0.12
