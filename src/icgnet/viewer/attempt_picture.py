"""The picture of one grasp: what was seen, what was predicted and what is true, and where the hand was.

Four panels: the cloud and the predicted over the true shapes as the camera stood, the grasp from its side, and a cut
through the hand. Where no grasp was found, other sides of the objects take the place of the last two.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh
from jaxtyping import Float, Int
from PIL import Image, ImageDraw

from icgnet.geometry.clouds import PointCloud
from icgnet.grasping.gripper import Gripper
from icgnet.viewer.annotate import text_width, write, write_legend
from icgnet.viewer.palette import MARK, QUIET_INK, instance_colour, instance_colours
from icgnet.viewer.picture import LARGEST_CLOUD, PlacedLabel, SceneDrawing, cloud_discs, draw_scene
from icgnet.viewer.render import TableSurface
from icgnet.viewer.section import Cut, CutMesh, draw_section
from icgnet.viewer.triangles import Triangles, hand_triangles, join, mesh_triangles, whole_hand_triangles
from icgnet.viewer.view import Perspective, framing_view

Role = Literal["target", "touched", "other"]

PANEL = (470, 800)
"""Height and width of one panel [pixels]."""
GAP, MARGIN = 4, 20
TITLE_SIZE, STORY_SIZE, CAPTION_SIZE = 25, 18, 18
LINE_HEIGHT = 26
LEGEND_HEIGHT = 44

ROLE_COLOURS = {"target": (0.40, 0.42, 0.46), "touched": (0.86, 0.42, 0.38), "other": (0.70, 0.71, 0.74)}
HAND_COLOUR = (0.24, 0.66, 0.30)
STRUCTURE_COLOUR = (0.80, 0.75, 0.52)
TRUE_OPACITY, PREDICTED_OPACITY, PALM_OPACITY, STRUCTURE_OPACITY = 0.4, 0.75, 0.15, 0.15
"""Of true and predicted shapes, so that one is seen inside of the other, of the palm, and of walls and the like."""
LOWEST, SIDE, ABOVE = np.deg2rad(8.0), np.deg2rad(20.0), np.deg2rad(89.0)
"""Elevations of the views from the side of the hand (at least), from another side, and from above."""
OTHER_SIDE = np.deg2rad(100.0)


@dataclass(frozen=True, eq=False)
class TrueObject:
    """What really stands there.

    Attributes:
        mesh: in the world [m].
        role: what the hand had to do with it.
        label: what is written at it in the view from the camera; nothing if empty.
    """

    mesh: trimesh.Trimesh
    role: Role
    label: str = ""


@dataclass(frozen=True, eq=False)
class PredictedObject:
    """What the planner takes for an object.

    Attributes:
        mesh: in the world [m]; may be empty.
        instance_id: decides its colour, which is that of its points.
        label: what is written at its points.
        points: that belong to it [m].
    """

    mesh: trimesh.Trimesh
    instance_id: int
    label: str
    points: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, eq=False)
class DrawnGrasp:
    """A hand at a grasp.

    Attributes:
        T_world_grasp: the grasp [m].
        opening: between its pads [m].
        gripper: the hand.
        marks: points in the world that are marked in red: where the hand meets something [m].
    """

    T_world_grasp: Float[np.ndarray, "4 4"]
    opening: float
    gripper: Gripper
    marks: Float[np.ndarray, "k 3"]

    @property
    def outline(self) -> Float[np.ndarray, "k 3"]:
        """Points on the fingers, in the world [m]."""
        points = self.gripper.surface_points(self.opening)
        points = points[points[:, 2] >= min(box.centre[2] - box.size[2] / 2 for box in self.gripper.finger)]
        return points @ self.T_world_grasp[:3, :3].T + self.T_world_grasp[:3, 3]


@dataclass(frozen=True, eq=False)
class AttemptScene:
    """Everything that the picture of an attempt shows, in the world.

    Attributes:
        title: the first line.
        story: the lines below.
        objects: that stand on the table, at least one.
        predicted: by the planner; none if it predicts no shapes.
        cloud: what was seen; may be empty.
        cloud_instances: predicted instance of each of its points, below 0 for none.
        T_world_camera: where it was seen from.
        table_height: of the table plane [m].
        grasp: None if there was none.
        structures: in the world [m], what rises above the table and is no object, such as the walls of a bin.
        panel: height and width of each of the four parts of the picture [pixels].
    """

    title: str
    story: tuple[str, ...]
    objects: tuple[TrueObject, ...]
    predicted: tuple[PredictedObject, ...]
    cloud: PointCloud
    cloud_instances: Int[np.ndarray, "n"]
    T_world_camera: Float[np.ndarray, "4 4"]
    table_height: float
    grasp: DrawnGrasp | None
    structures: tuple[trimesh.Trimesh, ...] = ()
    panel: tuple[int, int] = PANEL

    @property
    def shapes(self) -> tuple[PredictedObject, ...]:
        """The predicted objects that have a shape."""
        return tuple(each for each in self.predicted if len(each.mesh.faces))


def attempt_picture(scene: AttemptScene) -> Image.Image:
    """The four panels with title, story and legend."""
    panels = _panels(scene)
    top = MARGIN + LINE_HEIGHT * (1 + len(scene.story)) + 14
    height, width = top + 2 * (scene.panel[0] + GAP) + LEGEND_HEIGHT, 2 * scene.panel[1] + GAP
    picture = Image.new("RGB", (width, height), "white")
    write(picture, scene.title, (MARGIN, MARGIN - 6), TITLE_SIZE, bold=True)
    for index, line in enumerate(scene.story):
        write(picture, line, (MARGIN, MARGIN + 8 + LINE_HEIGHT * (index + 1)), STORY_SIZE)
    pen = ImageDraw.Draw(picture)
    for index, (caption, image) in enumerate(panels.items()):
        left, upper = index % 2 * (scene.panel[1] + GAP), top + index // 2 * (scene.panel[0] + GAP)
        picture.paste(image, (left, upper))
        pen.rectangle([left, upper, left + scene.panel[1] - 1, upper + scene.panel[0] - 1], outline=(225, 226, 229))
        at = (left + 12, upper + scene.panel[0] - CAPTION_SIZE - 12)
        wide = text_width(caption, CAPTION_SIZE)
        pen.rectangle([at[0] - 8, at[1] - 4, at[0] + wide + 8, at[1] + CAPTION_SIZE + 6], fill="white")
        write(picture, caption, at, CAPTION_SIZE, QUIET_INK)
    write_legend(picture, _legend(scene), (MARGIN, height - LEGEND_HEIGHT + 10), STORY_SIZE)
    return picture


def _panels(scene: AttemptScene) -> dict[str, Image.Image]:
    """The panels by their captions, left to right and downwards."""
    if scene.grasp is None:
        last = {
            "the same from another side": _shapes_panel(scene, _turned_view(scene, OTHER_SIDE, SIDE)),
            "the same from above": _shapes_panel(scene, _turned_view(scene, 0.0, ABOVE)),
        }
    else:
        last = {
            "the grasp from its side, near its target": _grasp_panel(scene, scene.grasp),
            f"cut through the hand, {1e3 * scene.grasp.opening:.0f} mm open": _section_panel(scene, scene.grasp),
        }
    seen = "what the planner saw" + (", by object" if scene.predicted else "")
    true = "predicted shapes over the true ones" if scene.shapes else "true shapes"
    view = _turned_view(scene, 0.0, None)
    return {f"{seen}, from the camera": _cloud_panel(scene, view), true: _shapes_panel(scene, view, named=True)} | last


def _legend(scene: AttemptScene) -> list[tuple[str, tuple[float, float, float]]]:
    others = "other true shapes" if scene.grasp is not None else "true shapes"
    names: dict[Role, str] = {"target": "true shape of the target", "touched": "touched on the way", "other": others}
    roles = {each.role for each in scene.objects}
    entries = [(name, ROLE_COLOURS[role]) for role, name in names.items() if role in roles]
    if scene.shapes:
        entries.append(("predicted shapes (see-through, a colour each)", instance_colour(scene.shapes[0].instance_id)))
    if scene.structures:
        entries.append(("walls and other structures", STRUCTURE_COLOUR))
    if scene.grasp is not None:
        entries.append(("hand", HAND_COLOUR))
        if len(scene.grasp.marks):
            entries.append(("where the hand meets something", MARK))
    return entries


def _cloud_panel(scene: AttemptScene, view: Perspective) -> Image.Image:
    rows = slice(None, None, max(1, -(-len(scene.cloud) // LARGEST_CLOUD)))
    dots = cloud_discs(scene.cloud.points[rows], scene.cloud_instances[rows], scene.cloud.viewpoint)
    labels = tuple(
        PlacedLabel(each.label, _top(each.points), instance_colour(each.instance_id)) for each in scene.predicted
    )
    return draw_scene(SceneDrawing(join([dots, _slim_hand(scene)]), labels, view, _table(scene)), scene.panel)


def _shapes_panel(scene: AttemptScene, view: Perspective, named: bool = False) -> Image.Image:
    drawn = join([_true_shapes(scene), _predicted(scene), _slim_hand(scene)])
    labels = tuple(
        PlacedLabel(each.label, _top(each.mesh.vertices), ROLE_COLOURS[each.role])
        for each in scene.objects
        if named and each.label
    )
    return draw_scene(SceneDrawing(drawn, labels, view, _table(scene), _marks(scene)), scene.panel)


def _grasp_panel(scene: AttemptScene, grasp: DrawnGrasp) -> Image.Image:
    """Across the closing direction, so that both fingers are seen."""
    near = [each.mesh.vertices for each in scene.objects if each.role == "target"]
    outward, away = grasp.T_world_grasp[:3, 0], scene.T_world_camera[:3, 2]
    # From above; where both sides are nearly level, from the side of the camera.
    if outward[2] - 0.2 * outward @ away < 0:
        outward = -outward
    azimuth = float(np.arctan2(outward[1], outward[0]))
    elevation = max(float(np.arcsin(np.clip(outward[2], -1.0, 1.0))), LOWEST)
    view = framing_view(np.concatenate([*near, grasp.outline]), azimuth, elevation, scene.panel, margin=0.07)
    hand = whole_hand_triangles(grasp.gripper, grasp.T_world_grasp, grasp.opening, HAND_COLOUR, PALM_OPACITY)
    drawn = join([_true_shapes(scene), _predicted(scene), hand])
    return draw_scene(SceneDrawing(drawn, (), view, _table(scene), grasp.marks), scene.panel)


def _section_panel(scene: AttemptScene, grasp: DrawnGrasp) -> Image.Image:
    true = [CutMesh(each.mesh, ROLE_COLOURS[each.role], filled=True) for each in scene.objects]
    true += [CutMesh(each, STRUCTURE_COLOUR, filled=True) for each in scene.structures]
    predicted = [CutMesh(each.mesh, instance_colour(each.instance_id), filled=False) for each in scene.shapes]
    cut = Cut(
        grasp.T_world_grasp,
        grasp.gripper,
        grasp.opening,
        HAND_COLOUR,
        [*true, *predicted],
        scene.cloud.points,
        instance_colours(scene.cloud_instances),
        grasp.marks,
        scene.table_height,
    )
    return draw_section(cut, scene.panel)


def _true_shapes(scene: AttemptScene) -> Triangles:
    objects = [mesh_triangles(each.mesh, ROLE_COLOURS[each.role], TRUE_OPACITY) for each in scene.objects]
    return join([*objects, *(mesh_triangles(each, STRUCTURE_COLOUR, STRUCTURE_OPACITY) for each in scene.structures)])


def _predicted(scene: AttemptScene) -> Triangles:
    return join(
        [mesh_triangles(each.mesh, instance_colour(each.instance_id), PREDICTED_OPACITY) for each in scene.shapes]
    )


def _slim_hand(scene: AttemptScene) -> Triangles:
    """The hand as a few bars, so that it does not hide the scene."""
    grasp = scene.grasp
    if grasp is None:
        return join([])
    return hand_triangles(grasp.gripper, grasp.T_world_grasp, grasp.opening, HAND_COLOUR)


def _marks(scene: AttemptScene) -> Float[np.ndarray, "k 3"]:
    return np.zeros((0, 3)) if scene.grasp is None else scene.grasp.marks


def _turned_view(scene: AttemptScene, turn: float, elevation: float | None) -> Perspective:
    """A view of all objects from the azimuth of the camera, turned by an angle, and from its elevation if None."""
    right, outward = scene.T_world_camera[:3, 0], -scene.T_world_camera[:3, 2]
    azimuth = float(np.arctan2(-right[0], right[1])) + turn
    if elevation is None:
        elevation = float(np.arcsin(np.clip(outward[2], -1.0, 1.0)))
    hand = np.zeros((0, 3)) if scene.grasp is None else scene.grasp.outline
    points = np.concatenate([*(each.mesh.vertices for each in scene.objects), hand])
    return framing_view(points, azimuth, elevation, scene.panel, margin=0.1)


def _table(scene: AttemptScene) -> TableSurface:
    corners = np.concatenate([each.mesh.vertices for each in scene.objects])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    x, y = ((lower + upper) / 2)[:2]
    return TableSurface(
        scene.table_height, (float(x), float(y)), 0.75 * float(np.linalg.norm((upper - lower)[:2])) + 0.15
    )


def _top(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    return np.array([*np.median(points[:, :2], axis=0), points[:, 2].max()])
