"""Pictures of a prediction: what the camera saw, and what the network makes of it."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from PIL import Image
from scipy.spatial import KDTree

from icgnet.geometry.clouds import estimate_normals
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.workspace import CENTRE, SIZE, TABLE_HEIGHT
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import DetectedObject, Prediction
from icgnet.viewer.annotate import Label, draw_score_scale, mark_pixels, shorten, text_width, write, write_labels
from icgnet.viewer.describe import SEPARATOR, best_per_object, object_name, object_top, points_on_table, summary
from icgnet.viewer.palette import QUIET_INK, instance_colour, instance_colours, score_colours
from icgnet.viewer.render import TableSurface, render
from icgnet.viewer.triangles import Triangles, disc_triangles, hand_triangles, join, mesh_triangles, moved
from icgnet.viewer.view import Perspective, framing_view

PICTURE_SHAPE = (900, 1600)
"""Height and width unless another size is asked for [pixels]."""
TITLE_HEIGHT, TITLE_SIZE = 64, 25
MARGIN = 28
FADE = 60
"""Over how many pixels a panel fades into the paper at its sides."""

ELEVATION = np.deg2rad(42.0)
DEFAULT_AZIMUTH = np.deg2rad(-60.0)
LARGEST_CLOUD = 25_000
"""More points than this are thinned out before they are drawn."""
GRASPS_PER_OBJECT, MOST_GRASPS = 2, 12


@dataclass(frozen=True, eq=False)
class SceneDrawing:
    """What one panel shows, in a frame with z up.

    Attributes:
        triangles: meshes, hands and clouds.
        labels: names at points in space.
        view: where from.
        table: what everything stands on; None for nothing.
        marks: points that are marked with dots, also where something hides them [m].
    """

    triangles: Triangles
    labels: tuple["PlacedLabel", ...]
    view: Perspective
    table: TableSurface | None
    marks: Float[np.ndarray, "k 3"] = field(default_factory=lambda: np.zeros((0, 3)))


@dataclass(frozen=True, eq=False)
class PlacedLabel:
    """A name at a point in space [m]."""

    text: str
    point: Float[np.ndarray, "3"]
    colour: tuple[float, float, float]


def draw_scene(drawing: SceneDrawing, shape: tuple[int, int]) -> Image.Image:
    """The picture of one scene, with its marks and labels."""
    image = Image.fromarray(render(drawing.triangles, drawing.table, drawing.view, shape))
    if len(drawing.marks):
        mark_pixels(image, drawing.view.project(drawing.marks, shape))
    labels = []
    for label in drawing.labels:
        pixel = drawing.view.project(label.point[None], shape)[0]
        u, v = np.clip(pixel, 0, [shape[1] - 1, shape[0] - 1])
        labels.append(Label(label.text, (float(u), float(v)), label.colour))
    write_labels(image, labels)
    return image


def draw_prediction(
    prediction: Prediction, path: str | Path, title: str | None = None, size: tuple[int, int] = PICTURE_SHAPE
) -> None:
    """Writes a PNG: on the left the observed cloud and the best grasp of each object, on the right shapes and grasps.

    Args:
        prediction: may have no objects and no grasps.
        path: file to write.
        title: first words of the title line, before the numbers; for example the name of the input.
        size: height and width [pixels].
    """
    prediction_picture(prediction, title, size).save(path)


def prediction_picture(
    prediction: Prediction, title: str | None = None, size: tuple[int, int] = PICTURE_SHAPE
) -> Image.Image:
    """The picture that `draw_prediction` writes."""
    height, width = size
    shape = (height - TITLE_HEIGHT, width // 2)
    T_table_frame = invert_transform(prediction.T_frame_table)
    grasps = prediction.grasps.transformed(T_table_frame)
    observed, assigned = points_on_table(prediction, LARGEST_CLOUD)
    shapes = [moved(_object_shape(item), T_table_frame) for item in prediction.objects]
    hands_left = _hands(best_per_object(grasps, 1), prediction.gripper)
    hands_right = _hands(best_per_object(grasps, GRASPS_PER_OBJECT).select(slice(0, MOST_GRASPS)), prediction.gripper)
    dots = cloud_discs(observed, assigned, _viewpoint(prediction, T_table_frame))
    labels = tuple(_object_label(item, T_table_frame) for item in prediction.objects)

    drawn = join([*shapes, hands_left, hands_right] if len(prediction.objects) else [dots])
    view, table = _framing(drawn, _viewpoint(prediction, T_table_frame), shape)
    left = SceneDrawing(join([dots, hands_left]), labels, view, table)
    right = SceneDrawing(join([*shapes, hands_right]), (), view, table)

    picture = Image.new("RGB", (width, height), "white")
    for index, drawing in enumerate((left, right)):
        picture.paste(draw_scene(drawing, shape), (index * width // 2, TITLE_HEIGHT), _fading(shape))
    _write_words(picture, prediction, title)
    return picture


def _fading(shape: tuple[int, int]) -> Image.Image:
    """A mask that lets a panel end softly at its sides, so that the table has no edge between two panels."""
    column = np.arange(shape[1])
    strength = np.clip(np.minimum(column, column[::-1]) / FADE, 0.0, 1.0)
    return Image.fromarray(np.tile((255 * strength).astype(np.uint8), (shape[0], 1)))


def _write_words(picture: Image.Image, prediction: Prediction, title: str | None) -> None:
    width, height = picture.size
    numbers = summary(prediction)
    if title is not None:
        numbers = SEPARATOR + numbers
        numbers = shorten(title, TITLE_SIZE, width - 2 * MARGIN - text_width(numbers, TITLE_SIZE)) + numbers
    write(picture, numbers, (MARGIN, 20), TITLE_SIZE, bold=True)
    write(picture, "Observed points and the best grasp of each object", (MARGIN, height - 44), 19, QUIET_INK)
    write(picture, "Predicted shapes and grasps", (width // 2 + MARGIN, height - 44), 19, QUIET_INK)
    draw_score_scale(picture, width - MARGIN, height - 33, "score")


def _viewpoint(prediction: Prediction, T_table_frame: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"] | None:
    viewpoint = prediction.cloud.viewpoint
    return None if viewpoint is None else transform_points(T_table_frame, viewpoint)


def cloud_discs(
    points: Float[np.ndarray, "n 3"], instances: Int[np.ndarray, "n"], viewpoint: Float[np.ndarray, "3"] | None
) -> Triangles:
    """A cloud as discs that nearly touch their neighbours, in the colours of its instances."""
    if len(points) < 3:
        return join([])
    spacing = np.median(KDTree(points).query(points, k=min(5, len(points)))[0][:, -1])
    normals = estimate_normals(points, viewpoint)
    return disc_triangles(points, normals, instance_colours(instances), float(np.clip(0.6 * spacing, 6e-4, 3e-3)))


def _object_shape(item: DetectedObject) -> Triangles:
    return mesh_triangles(item.mesh(), instance_colour(item.instance_id))


def _object_label(item: DetectedObject, T_table_frame: Float[np.ndarray, "4 4"]) -> PlacedLabel:
    return PlacedLabel(object_name(item), object_top(item, T_table_frame), instance_colour(item.instance_id))


def _hands(grasps: Grasps, gripper: Gripper) -> Triangles:
    colours = score_colours(grasps.scores)
    return join(
        [
            hand_triangles(gripper, pose, float(opening), tuple(colour))
            for pose, opening, colour in zip(grasps.poses, grasps.openings, colours, strict=True)
        ]
    )


def _framing(
    drawn: Triangles, viewpoint: Float[np.ndarray, "3"] | None, shape: tuple[int, int]
) -> tuple[Perspective, TableSurface]:
    """A view from the side of the capture that shows everything drawn, and the table under it."""
    points = drawn.corners.reshape(-1, 3)
    if not len(points):
        points = CENTRE + 0.5 * SIZE * np.array([[-1, -1, -0.6], [1, 1, -0.6], [-1, 1, 0], [1, -1, 0]])
    lower, upper = points.min(axis=0), points.max(axis=0)
    centre = (lower + upper) / 2
    azimuth = DEFAULT_AZIMUTH
    if viewpoint is not None and np.linalg.norm(viewpoint[:2] - centre[:2]) > 0.05:
        azimuth = float(np.arctan2(viewpoint[1] - centre[1], viewpoint[0] - centre[0]))
    radius = 0.75 * float(np.linalg.norm(upper[:2] - lower[:2])) + 0.1
    table = TableSurface(TABLE_HEIGHT, (float(centre[0]), float(centre[1])), radius)
    return framing_view(points, azimuth, ELEVATION, shape), table
