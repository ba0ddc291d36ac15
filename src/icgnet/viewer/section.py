"""A cut through a hand and what lies between its fingers: outlines in the plane in which the fingers close."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from PIL import Image, ImageDraw

from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.grasping.gripper import Gripper
from icgnet.viewer.annotate import mark_pixels
from icgnet.viewer.palette import to_bytes
from icgnet.viewer.triangles import Colour

HEIGHT = 0.09
"""Of the part of the plane that is shown [m]."""
TIPS_AT = 0.62
"""Where the finger tips are, as a share of that height from above."""
POINT_REACH, MARK_REACH = 0.004, 0.012
"""Measured points and marks up to this far from the plane are shown [m]."""
SUPERSAMPLING = 2
TABLE_COLOUR, PAD_LINE, FILL_STRENGTH = (0.93, 0.93, 0.94), (0.62, 0.63, 0.65), 0.35
LINE, DOT = 3, 2
"""Width of outlines and radius of points [pixels]."""
OUTLINE_DARKNESS, POINT_PALENESS = 0.45, 0.4
"""How much black is mixed into the outlines of filled meshes, and how much white into points."""


@dataclass(frozen=True, eq=False)
class CutMesh:
    """A mesh in the world, as a section shows it.

    Attributes:
        mesh: what is cut [m].
        colour: of its outline.
        filled: whether its inside has a pale colour.
    """

    mesh: trimesh.Trimesh
    colour: Colour
    filled: bool


@dataclass(frozen=True, eq=False)
class Cut:
    """Where a section is, and what it shows.

    Attributes:
        T_world_grasp: the grasp: the plane has its closing and its approach direction.
        gripper: the hand.
        opening: distance of its pads [m].
        hand_colour: of the hand.
        meshes: what is cut; the last is drawn on top.
        points: of the cloud, in the world [m].
        point_colours: of each.
        marks: points that are marked with dots [m].
        table_height: of the table plane in the world [m].
    """

    T_world_grasp: Float[np.ndarray, "4 4"]
    gripper: Gripper
    opening: float
    hand_colour: Colour
    meshes: Sequence[CutMesh]
    points: Float[np.ndarray, "n 3"]
    point_colours: Float[np.ndarray, "n 3"]
    marks: Float[np.ndarray, "k 3"]
    table_height: float


def draw_section(cut: Cut, shape: tuple[int, int]) -> Image.Image:
    """The plane with the closing axis to the right and the approach downwards, in an image of this height and width."""
    fine = (shape[0] * SUPERSAMPLING, shape[1] * SUPERSAMPLING)
    paper = _Paper(fine, fine[0] / HEIGHT)
    T_grasp_world = invert_transform(cut.T_world_grasp)
    paper.shade(_below_table(cut, paper), TABLE_COLOUR, 1.0)
    lines = [_outline(each.mesh, T_grasp_world) for each in cut.meshes]
    for each, segments in zip(cut.meshes, lines, strict=True):
        if each.filled:
            paper.shade(paper.inside(segments), each.colour, FILL_STRENGTH)
    for box in cut.gripper.boxes(cut.opening):
        centre, half = np.array(box.centre), np.array(box.size) / 2
        if abs(centre[0]) <= half[0]:
            paper.box((centre - half)[1:], (centre + half)[1:], cut.hand_colour)
    local = transform_points(T_grasp_world, cut.points)
    near = np.abs(local[:, 0]) <= POINT_REACH
    paper.dots(local[near, 1:], cut.point_colours[near] * (1.0 - POINT_PALENESS) + POINT_PALENESS, DOT)
    middle = -cut.gripper.finger_reach
    paper.lines(np.array([[[-cut.opening / 2, middle], [cut.opening / 2, middle]]]), PAD_LINE, 1)
    for each, segments in zip(cut.meshes, lines, strict=True):
        red, green, blue = each.colour
        light = 1.0 - OUTLINE_DARKNESS * each.filled
        paper.lines(segments, (light * red, light * green, light * blue))
    marks = transform_points(T_grasp_world, cut.marks)
    marks = marks[np.abs(marks[:, 0]) <= MARK_REACH, 1:]
    image = paper.image.resize((shape[1], shape[0]), Image.Resampling.BOX)
    mark_pixels(image, paper.pixels(marks) / SUPERSAMPLING)
    return image


def _outline(mesh: trimesh.Trimesh, T_grasp_world: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "s 2 2"]:
    """Line segments (y, z) in which a mesh meets the plane of the hand [m]."""
    T_world_grasp = invert_transform(T_grasp_world)
    segments = trimesh.intersections.mesh_plane(mesh, T_world_grasp[:3, 0], T_world_grasp[:3, 3])
    return transform_points(T_grasp_world, np.asarray(segments).reshape(-1, 2, 3))[..., 1:]


def _below_table(cut: Cut, paper: "_Paper") -> Bool[np.ndarray, "h w"]:
    y, z = paper.coordinates()
    pose = cut.T_world_grasp
    return pose[2, 3] + pose[2, 1] * y + pose[2, 2] * z < cut.table_height


class _Paper:
    """An image of the plane; positions are (y, z) of the hand [m], z downwards."""

    def __init__(self, shape: tuple[int, int], scale: float) -> None:
        self.image = Image.new("RGB", (shape[1], shape[0]), "white")
        self._pen = ImageDraw.Draw(self.image)
        self._shape, self._scale = shape, scale
        self._origin = np.array([shape[1] / 2, TIPS_AT * shape[0]])

    def coordinates(self) -> tuple[Float[np.ndarray, "1 w"], Float[np.ndarray, "h 1"]]:
        """The y of every column and the z of every row [m]."""
        rows, columns = (np.arange(size) + 0.5 for size in self._shape)
        return (columns[None] - self._origin[0]) / self._scale, (rows[:, None] - self._origin[1]) / self._scale

    def inside(self, segments: Float[np.ndarray, "s 2 2"]) -> Bool[np.ndarray, "h w"]:
        """Pixels from which a line to the left crosses the outline an odd number of times."""
        crossings = np.zeros((self._shape[0], self._shape[1] + 1), int)
        for start, end in self.pixels(segments):
            if start[1] > end[1]:
                start, end = end, start
            first, last = (int(np.clip(np.ceil(each[1] - 0.5), 0, self._shape[0])) for each in (start, end))
            rows = np.arange(first, last)
            along = (rows + 0.5 - start[1]) / max(end[1] - start[1], 1e-9)
            columns = np.ceil(start[0] + along * (end[0] - start[0]) - 0.5)
            np.add.at(crossings, (rows, np.clip(columns, 0, self._shape[1]).astype(int)), 1)
        return np.cumsum(crossings, axis=1)[:, :-1] % 2 == 1

    def shade(self, mask: Bool[np.ndarray, "h w"], colour: Colour, strength: float) -> None:
        """Mixes a colour into the pixels of a mask."""
        self.image.paste(to_bytes(colour), mask=Image.fromarray((255 * strength * mask).astype(np.uint8)))

    def box(self, lower: Float[np.ndarray, "2"], upper: Float[np.ndarray, "2"], colour: Colour) -> None:
        """Fills a rectangle."""
        self._pen.rectangle([tuple(self.pixels(lower)), tuple(self.pixels(upper))], fill=to_bytes(colour))

    def lines(self, segments: Float[np.ndarray, "s 2 2"], colour: Colour, width: int = LINE) -> None:
        """Draws segments of a width in pixels."""
        for start, end in self.pixels(segments):
            self._pen.line([tuple(start), tuple(end)], fill=to_bytes(colour), width=width * SUPERSAMPLING)

    def dots(self, points: Float[np.ndarray, "n 2"], colours: Float[np.ndarray, "n 3"], radius: int) -> None:
        """Draws round dots of a radius in pixels."""
        reach = radius * SUPERSAMPLING
        for (x, y), colour in zip(self.pixels(points), colours, strict=True):
            self._pen.ellipse([x - reach, y - reach, x + reach, y + reach], fill=to_bytes(tuple(colour)))

    def pixels(self, points: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Where positions are in the image."""
        return self._origin + self._scale * points
