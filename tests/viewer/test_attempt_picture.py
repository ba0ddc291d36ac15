from dataclasses import replace

import numpy as np
import pytest
import trimesh
from PIL import Image

from icgnet.geometry.camera import sphere_pose
from icgnet.geometry.clouds import PointCloud
from icgnet.grasping.gripper import load_gripper
from icgnet.viewer import attempt_picture as module
from icgnet.viewer.attempt_picture import AttemptScene, DrawnGrasp, PredictedObject, TrueObject, attempt_picture
from icgnet.viewer.palette import MARK, instance_colour
from icgnet.viewer.section import Cut, CutMesh, draw_section

EDGE, TABLE = 0.05, 0.05
GRIPPER = load_gripper()
DOWN = np.array([[1.0, 0, 0, 0.15], [0, -1, 0, 0.15], [0, 0, -1, TABLE + EDGE / 2], [0, 0, 0, 1]])
HAND, OUTLINE, FILL = (0.0, 0.6, 0.0), (0.0, 0.0, 0.9), (0.9, 0.4, 0.0)
SECTION = (180, 320)


def cube(edge: float = EDGE) -> trimesh.Trimesh:
    return trimesh.creation.box([edge] * 3).apply_translation([0.15, 0.15, TABLE + EDGE / 2])


@pytest.fixture
def scene() -> AttemptScene:
    """A hand around a cube that is predicted a little larger than it is, and a ball beside it."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(0.125, 0.175, (400, 2)), np.full(400, TABLE + EDGE)])
    ball = trimesh.creation.icosphere(radius=0.02).apply_translation([0.24, 0.18, TABLE + 0.02])
    camera = sphere_pose(np.array([0.15, 0.15, 0.25]), 0.7, np.deg2rad(50.0), 0.3)
    return AttemptScene(
        title="Missed, score 0.70",
        story=("The hand closed beside it.",),
        objects=(TrueObject(cube(), "target", "target: cube"), TrueObject(ball, "other")),
        predicted=(PredictedObject(cube(1.2 * EDGE), 2, "0  box", points),),
        cloud=PointCloud(points, camera[:3, 3], "world"),
        cloud_instances=np.full(400, 2),
        T_world_camera=camera,
        table_height=TABLE,
        grasp=DrawnGrasp(DOWN, 0.08, GRIPPER, np.zeros((0, 3))),
        panel=(235, 400),
    )


def panels(scene: AttemptScene) -> list[np.ndarray]:
    """The four panels, left to right and downwards."""
    picture = np.asarray(attempt_picture(scene)).astype(int)
    height, width = scene.panel
    top = picture.shape[0] - module.LEGEND_HEIGHT - 2 * (height + module.GAP)
    corners = [
        (top + row * (height + module.GAP), column * (width + module.GAP)) for row in (0, 1) for column in (0, 1)
    ]
    return [picture[y + 1 : y + height - 1, x + 1 : x + width - 1] for y, x in corners]


def hued(image: np.ndarray, colour: tuple[float, float, float]) -> int:
    """How many pixels have the hue of a colour, whatever the light."""
    pixels = image - image.min(axis=2, keepdims=True)
    wanted = np.array(colour) - min(colour)
    strength = np.linalg.norm(pixels, axis=2)
    cosine = pixels @ wanted / (np.linalg.norm(wanted) * np.maximum(strength, 1e-9))
    return int(((cosine > 0.98) & (strength > 30)).sum())


def test_every_panel_shows_the_hand(scene):
    for panel, bare in zip(panels(scene), panels(replace(scene, grasp=None)), strict=True):
        assert hued(panel, module.HAND_COLOUR) > 200
        assert hued(bare, module.HAND_COLOUR) == 0


def test_walls_are_seen_through_in_all_panels_of_true_shapes_and_change_no_view(scene):
    wall = trimesh.creation.box([0.02, 0.4, 0.2]).apply_translation([0.30, 0.15, TABLE + 0.1])
    near = trimesh.creation.box([0.02, 0.02, 0.2]).apply_translation([0.15, 0.185, TABLE + 0.1])
    shown, without = panels(replace(scene, structures=(wall, near))), panels(scene)
    np.testing.assert_array_equal(shown[0], without[0])
    for index in (1, 2, 3):
        assert (shown[index] != without[index]).any(axis=2).sum() > 200
    assert hued(shown[1], module.HAND_COLOUR) > 50, "the hand behind it is seen"


def test_a_predicted_shape_is_seen_around_and_inside_of_the_true_one(scene):
    colour = instance_colour(2)
    for edge in (1.2 * EDGE, 0.8 * EDGE):
        predicted = (replace(scene.predicted[0], mesh=cube(edge)),)
        shown, hidden = panels(replace(scene, predicted=predicted)), panels(replace(scene, predicted=()))
        for index in (1, 2, 3):
            assert hued(shown[index], colour) > hued(hidden[index], colour) + 100


def test_what_the_hand_meets_is_marked_even_inside_of_an_object(scene):
    marks = np.array([[0.15, 0.15, TABLE + EDGE / 2]])
    for index, panel in enumerate(panels(replace(scene, grasp=replace(scene.grasp, marks=marks)))):
        assert (hued(panel, MARK) > 10) == (index > 0), "the cloud is shown as it was seen"


def test_touched_objects_stand_out(scene):
    touched = (scene.objects[0], replace(scene.objects[1], role="touched"))
    colour = module.ROLE_COLOURS["touched"]
    assert hued(panels(replace(scene, objects=touched))[1], colour) > hued(panels(scene)[1], colour) + 50


@pytest.mark.parametrize("polar", [0.0, 0.5, 1.5])
def test_a_picture_without_a_cloud_a_shape_and_a_grasp_is_drawn_from_any_camera(scene, polar):
    empty = replace(scene.predicted[0], mesh=trimesh.Trimesh())
    camera = sphere_pose(np.array([0.15, 0.15, 0.1]), 0.6, polar, 1.0)
    bare = replace(
        scene,
        T_world_camera=camera,
        cloud=PointCloud(np.zeros((0, 3)), camera[:3, 3], "world"),
        cloud_instances=np.zeros(0, int),
        predicted=(empty,),
        grasp=None,
    )
    assert [hued(panel, instance_colour(2)) for panel in panels(bare)[1:]] == [0, 0, 0]


@pytest.mark.parametrize("turn", [0.0, 0.4, np.pi / 2])
def test_any_direction_of_the_hand_can_be_drawn(scene, turn):
    c, s = np.cos(turn), np.sin(turn)
    pose = DOWN.copy()
    pose[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ pose[:3, :3]
    assert hued(panels(replace(scene, grasp=replace(scene.grasp, T_world_grasp=pose)))[2], module.HAND_COLOUR) > 200


def cut(**changes) -> Cut:
    none = np.zeros((0, 3))
    whole = Cut(DOWN, GRIPPER, 0.08, HAND, (CutMesh(cube(), FILL, filled=True),), none, none, none, TABLE)
    return replace(whole, **changes)


def columns(image: Image.Image, colour: tuple[float, float, float], row: int) -> np.ndarray:
    """Where a row of the image has a colour."""
    return np.flatnonzero(np.abs(np.asarray(image)[row] - 255 * np.array(colour)).max(axis=1) < 12)


def test_a_section_is_to_scale():
    scale = SECTION[0] / 0.09
    image = draw_section(cut(), SECTION)
    tips = round(0.62 * SECTION[0])
    hand = columns(image, HAND, tips - round(0.005 * scale))
    gap = np.diff(hand).max() / scale
    assert gap == pytest.approx(0.08, abs=0.002)
    inside = np.asarray(image)[tips + round(0.010 * scale)]
    tinted = np.flatnonzero(inside.max(axis=1).astype(int) - inside.min(axis=1) > 20)
    assert np.ptp(tinted) / scale == pytest.approx(EDGE, abs=0.002)


def test_the_wall_of_a_hollow_thing_is_filled_and_its_inside_is_not():
    wall = cube() + cube(0.6 * EDGE)
    solid, hollow = (
        np.asarray(draw_section(cut(meshes=(CutMesh(mesh, FILL, filled=True),)), SECTION)) for mesh in (cube(), wall)
    )
    middle = (round(0.62 * SECTION[0]), SECTION[1] // 2)
    assert (hollow[middle] == 255).all()
    assert (solid[middle] != 255).any()


def test_a_section_shows_points_near_its_plane_only():
    near, far = np.array([[0.151, 0.19, 0.07]]), np.array([[0.158, 0.19, 0.07]])
    empty, with_near, with_far = (
        np.asarray(
            draw_section(cut(meshes=(), points=points, point_colours=np.tile(OUTLINE, (len(points), 1))), SECTION)
        )
        for points in (np.zeros((0, 3)), near, far)
    )
    assert (empty != with_near).any()
    assert (empty == with_far).all()


def test_the_table_is_shaded_below_its_height():
    image = np.asarray(draw_section(cut(meshes=()), SECTION)).astype(int)
    scale = SECTION[0] / 0.09
    border = round(0.62 * SECTION[0] + EDGE / 2 * scale)
    assert (image[: border - 2, 160] == 255).sum() > 0
    assert (image[border + 2 :, 160] < 250).all()
    assert (image[border - 4, 160] == 255).all()
