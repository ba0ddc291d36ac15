from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from icgnet.grasping.frame import grasp_poses
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import load_gripper
from icgnet.simulation.camera import SceneRenderer
from icgnet.viewer.dataset_sheet import (
    FEWEST_HANDS,
    MOST_HANDS,
    SCENES_PER_SHEET,
    LabelledScene,
    chosen_hands,
    draw_dataset_sheets,
    scene_pictures,
    sheet_view,
)
from icgnet.viewer.palette import score_colours
from icgnet.viewer.triangles import needle_triangles

GRIPPER = load_gripper("franka")
PANEL = (152, 176)
CUBE = 0.05


def grasps_on(centres: np.ndarray, each: int) -> Grasps:
    """Some grasps of each cube, a little apart, the first of each the best."""
    owners = np.repeat(np.arange(len(centres)), each)
    shift = np.linspace(-0.02, 0.02, each)[np.tile(np.arange(each), len(centres))]
    contacts = centres[owners] + np.stack([shift, np.full(len(owners), CUBE / 2), np.zeros(len(owners))], axis=1)
    normals = np.tile([0.0, 1.0, 0.0], (len(owners), 1))
    poses = grasp_poses(contacts, normals, np.full(len(owners), CUBE))[:, 6]
    scores = np.tile(np.linspace(0.9, 0.5, each), len(centres))
    widths = np.full(len(owners), CUBE)
    return Grasps(poses, widths, GRIPPER.opening(widths), scores, owners, contacts, np.full(len(owners), 6))


@pytest.fixture
def scene() -> LabelledScene:
    """Two cubes on the table, one contact on each of the four walls of each, the first cube graspable."""
    centres = np.array([[0.10, 0.10, 0.075], [0.20, 0.18, 0.075]])
    meshes = tuple(trimesh.creation.box([CUBE] * 3).apply_translation(centre) for centre in centres)
    view = sheet_view(meshes, 0.4, PANEL)
    owners = np.repeat([0, 1], 12)
    triangles = np.concatenate([mesh.triangles for mesh in meshes])
    image = SceneRenderer(triangles, owners).render(view.intrinsics(PANEL), PANEL, view.T_world_camera)
    normals = np.tile(np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], float), (2, 1))
    return LabelledScene(
        "scene 3 (packed)",
        meshes,
        view,
        image.depth.astype(float),
        image.ids,
        np.repeat(centres, 4, axis=0) + CUBE / 2 * normals,
        normals,
        np.repeat([0.5, 0.0], 4),
        grasps_on(centres, 3),
        GRIPPER,
    )


def share_of(image: np.ndarray, hue: np.ndarray) -> float:
    """Share of the pixels that have a hue, however bright they are lit."""
    pixels = image.reshape(-1, 3).astype(float)
    lengths = np.linalg.norm(pixels, axis=1) * np.linalg.norm(hue)
    return float((pixels @ hue / np.maximum(lengths, 1.0) > 0.985).mean())


def test_a_row_shows_six_pictures_of_one_size_and_says_which_scene(scene):
    pictures = scene_pictures(scene)
    assert len(pictures) == 6
    assert {image.shape for image in pictures.values()} == {(*PANEL, 3)}
    captions = " ".join(pictures)
    for words in ("scene 3 (packed)", "2 objects", "8 contacts", "the 4 safest of 6 grasps"):
        assert words in captions


def test_contacts_show_whether_they_can_be_grasped(scene):
    def reddish(drawn: LabelledScene) -> float:
        return share_of(list(scene_pictures(drawn).values())[3], np.array([0.62, 0.12, 0.16]))

    yellow = score_colours(np.array([1.0]))[0]
    assert reddish(scene) > 0
    assert reddish(replace(scene, scores=np.full(8, 0.5))) == 0
    assert share_of(list(scene_pictures(scene).values())[3], yellow) > 0


def test_a_contact_with_an_inward_normal_is_hidden_inside_its_object(scene):
    def marked(drawn: LabelledScene) -> int:
        bare = replace(drawn, positions=np.zeros((0, 3)), normals=np.zeros((0, 3)), scores=np.zeros(0))
        with_contacts, without = (list(scene_pictures(each).values())[3] for each in (drawn, bare))
        return int((with_contacts != without).any(axis=2).sum())

    assert marked(scene) > 20
    assert marked(replace(scene, normals=-scene.normals)) < 0.2 * marked(scene)


def test_a_scene_that_nobody_can_grasp_and_without_contacts_is_drawn_all_the_same(scene):
    bare = replace(
        scene, positions=np.zeros((0, 3)), normals=np.zeros((0, 3)), scores=np.zeros(0), grasps=Grasps.empty()
    )
    assert "the 0 safest of 0 grasps" in scene_pictures(bare)


def test_every_object_gets_its_best_hand_and_few_objects_get_several():
    one = chosen_hands(grasps_on(np.array([[0.1, 0.1, 0.1]]), 3))
    assert len(one) == FEWEST_HANDS
    many = chosen_hands(grasps_on(np.array([[0.1 * k, 0.1, 0.1] for k in range(8)]), 2))
    assert len(many) == MOST_HANDS
    four = chosen_hands(grasps_on(np.array([[0.1 * k, 0.1, 0.1] for k in range(4)]), 3))
    assert sorted(four.instances.tolist()) == [0, 1, 2, 3]
    np.testing.assert_array_equal(four.scores, 0.9)
    assert len(chosen_hands(Grasps.empty())) == 0


def test_scenes_are_spread_over_sheets(scene, tmp_path: Path):
    paths = draw_dataset_sheets([scene] * (SCENES_PER_SHEET + 1), tmp_path)
    assert [path.name for path in paths] == ["sheet_00.png", "sheet_01.png"]
    heights = [Image.open(path).height for path in paths]
    assert heights[0] > 3.5 * heights[1]


def test_needles_stand_on_their_points_and_point_along_their_directions():
    points = np.array([[0.1, 0.2, 0.3], [0.0, 0.0, 0.0]])
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]])
    needles = needle_triangles(points, directions, np.ones((2, 3)), length=0.01, radius=0.001)
    along = [(needles.corners[3 * k : 3 * k + 3] - points[k]) @ directions[k] for k in range(2)]
    for heights in along:
        np.testing.assert_allclose(np.sort(heights.ravel()), [0.0] * 6 + [0.01] * 3, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(needles.normals, axis=2), 1.0)
