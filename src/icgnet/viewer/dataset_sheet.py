"""Sheets of labelled scenes: what a camera sees of them, and where a hand can take hold."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float, Int, UInt8

from icgnet.geometry.camera import unproject
from icgnet.geometry.clouds import estimate_normals, voxel_downsample
from icgnet.geometry.transforms import transform_points
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.grasping.selection import non_maximum_suppression
from icgnet.viewer.describe import best_per_object
from icgnet.viewer.palette import instance_colour, score_colours
from icgnet.viewer.render import TableSurface, render
from icgnet.viewer.sheet import colour_depth, colour_ids, draw_sheet
from icgnet.viewer.triangles import (
    Triangles,
    disc_triangles,
    hand_triangles,
    join,
    mesh_triangles,
    needle_triangles,
)
from icgnet.viewer.view import Perspective, framing_view

SCENES_PER_SHEET = 4
CLOUD_VOXEL = 0.002
"""The cloud is thinned to one point in each voxel of this edge [m]."""
CLOUD_RADIUS, CONTACT_RADIUS = 0.0016, 0.0032
"""Of the discs that points are drawn as [m]."""
NEEDLE_LENGTH, NEEDLE_RADIUS = 0.012, 0.0009
"""Of the spikes that show the normals of contacts [m]."""
BRIGHTEST = 0.5
"""Share of successful angles at which a contact has the brightest colour: hardly any succeeds at more of them."""
FAILED = (0.62, 0.12, 0.16)
"""Colour of contacts where no angle succeeds."""
FEWEST_HANDS, MOST_HANDS = 3, 6
LIFT = 0.0004
"""How far contacts are drawn before their surface [m]."""
PALM_DISTANCE = 0.06
"""Hands are in the picture up to this far behind their finger tips [m]."""
PALENESS = 0.6
"""How much white is mixed into the colours of objects under contacts and hands."""
SHAPE_OPACITY = 0.75
"""Of objects among hands, so that a finger inside of one is seen."""
STRUCTURE_COLOUR, STRUCTURE_OPACITY = (0.55, 0.45, 0.35), 0.35
CAMERA_ELEVATION, LEVEL_ELEVATION = np.deg2rad(42.0), np.deg2rad(6.0)
"""Above the horizon: what floats above the table or sinks into it shows from nearly level."""
LEVEL_TURN = np.deg2rad(120.0)
"""How far the level view stands from the camera, about the vertical."""


@dataclass(frozen=True, eq=False)
class LabelledScene:
    """A scene as a sheet shows it, world frame.

    Attributes:
        title: number and kind of the scene.
        meshes: visual mesh of each object [m], at least one.
        view: the camera, see `sheet_view`.
        depth: its image along its z axis, 0 where nothing is seen [m]; all pictures of the scene have its size.
        ids: object of each pixel; -1 for nothing, -2 for the table.
        positions: contacts [m].
        normals: outward unit normals there.
        scores: share of the approach angles that succeed at each contact.
        grasps: the successful grasps; high scores are drawn first.
        gripper: the hand.
        structures: what else stands there [m].
        extent: of the table, see `icgnet.simulation.surroundings.Surroundings`; None for the workspace.
    """

    title: str
    meshes: tuple[trimesh.Trimesh, ...]
    view: Perspective
    depth: Float[np.ndarray, "h w"]
    ids: Int[np.ndarray, "h w"]
    positions: Float[np.ndarray, "g 3"]
    normals: Float[np.ndarray, "g 3"]
    scores: Float[np.ndarray, "g"]
    grasps: Grasps
    gripper: Gripper
    structures: tuple[trimesh.Trimesh, ...] = ()
    extent: tuple[float, float, float, float] | None = None

    @property
    def panel(self) -> tuple[int, int]:
        """Height and width of each of its pictures [pixels]."""
        height, width = self.depth.shape
        return height, width


def draw_dataset_sheets(scenes: Sequence[LabelledScene], folder: Path) -> list[Path]:
    """Writes sheets of up to four scenes, one scene a row, into a folder that exists; returns their paths."""
    paths = []
    for start in range(0, len(scenes), SCENES_PER_SHEET):
        rows = [scene_pictures(scene) for scene in scenes[start : start + SCENES_PER_SHEET]]
        paths.append(folder / f"sheet_{start // SCENES_PER_SHEET:02d}.png")
        images = [image for row in rows for image in row.values()]
        draw_sheet(images, [caption for row in rows for caption in row], paths[-1], columns=len(rows[0]))
    return paths


def scene_pictures(scene: LabelledScene) -> dict[str, UInt8[np.ndarray, "_ _ 3"]]:
    """The pictures of one scene by their captions, from the depth image to the hands."""
    hands = chosen_hands(scene.grasps)
    among = join([_shapes(scene, SHAPE_OPACITY), _hands(hands, scene.gripper)])
    of_objects = np.where(scene.ids >= 0, scene.depth, 0.0)
    return {
        f"{scene.title}: depth of the objects": colour_depth(of_objects),
        f"{len(scene.meshes)} object{'s' * (len(scene.meshes) != 1)}": colour_ids(scene.ids),
        "cloud; colour: normal x, y, z": _drawn(_cloud(scene), scene, scene.view),
        f"{len(scene.scores)} contacts; red: all angles fail": _drawn(
            join([_shapes(scene, 1.0), _contacts(scene)]), scene, scene.view
        ),
        f"the {len(hands)} safest of {len(scene.grasps)} grasps": _drawn(among, scene, _hands_view(scene, hands, 0.0)),
        "from another side, nearly level": _drawn(among, scene, _hands_view(scene, hands, LEVEL_TURN)),
    }


def sheet_view(meshes: Sequence[trimesh.Trimesh], azimuth: float, panel: tuple[int, int]) -> Perspective:
    """The camera of a sheet's first pictures: it sees the whole of all meshes (world frame [m]).

    Args:
        meshes: what stands on the table, at least one.
        azimuth: where the camera stands, about world z from world x [rad].
        panel: height and width of its image [pixels].
    """
    corners = np.concatenate([mesh.vertices for mesh in meshes])
    return framing_view(corners, azimuth, CAMERA_ELEVATION, panel, margin=0.08)


def chosen_hands(grasps: Grasps) -> Grasps:
    """The best grasp of each object, or several that differ where only one or two objects have any; at most six."""
    different = non_maximum_suppression(grasps)
    chosen = best_per_object(different, 1)
    for count in range(2, FEWEST_HANDS + 1):
        if len(chosen) < FEWEST_HANDS:
            chosen = best_per_object(different, count)
    return chosen.select(slice(0, MOST_HANDS))


def _drawn(triangles: Triangles, scene: LabelledScene, view: Perspective) -> UInt8[np.ndarray, "_ _ 3"]:
    """Triangles on the table with the structures around it; a support with edges is drawn as the square around it."""
    middle, half = (SIZE / 2, SIZE / 2), 0.8 * SIZE
    if scene.extent is not None:
        lower_x, lower_y, upper_x, upper_y = scene.extent
        middle = ((lower_x + upper_x) / 2, (lower_y + upper_y) / 2)
        half = max(upper_x - lower_x, upper_y - lower_y) / 2
    around = [mesh_triangles(mesh, STRUCTURE_COLOUR, STRUCTURE_OPACITY) for mesh in scene.structures]
    return render(join([triangles, *around]), TableSurface(TABLE_HEIGHT, middle, half), view, scene.panel)


def _hands_view(scene: LabelledScene, hands: Grasps, turn: float) -> Perspective:
    """A view of all objects and hands from the side of the camera, or nearly level and turned about the vertical."""
    corners = np.concatenate([mesh.vertices for mesh in scene.meshes])
    palms = hands.poses[:, :3, 3] - PALM_DISTANCE * hands.poses[:, :3, 2]
    outward = -scene.view.T_world_camera[:3, 2]
    azimuth = float(np.arctan2(outward[1], outward[0])) + turn
    elevation = LEVEL_ELEVATION if turn else CAMERA_ELEVATION
    return framing_view(np.concatenate([corners, palms]), azimuth, elevation, scene.panel, margin=0.06)


def _shapes(scene: LabelledScene, opacity: float) -> Triangles:
    """The objects in pale colours of their ids."""
    parts = []
    for index, mesh in enumerate(scene.meshes):
        red, green, blue = (PALENESS + (1.0 - PALENESS) * channel for channel in instance_colour(index))
        parts.append(mesh_triangles(mesh, (red, green, blue), opacity))
    return join(parts)


def _cloud(scene: LabelledScene) -> Triangles:
    """What the camera sees of the objects, with normals estimated from it; red, green, blue are their x, y, z."""
    seen = unproject(scene.depth, scene.view.intrinsics(scene.panel))[scene.ids >= 0]
    points, _ = voxel_downsample(transform_points(scene.view.T_world_camera, seen), CLOUD_VOXEL)
    normals = estimate_normals(points, scene.view.T_world_camera[:3, 3])
    return disc_triangles(points, normals, 0.5 + 0.5 * normals, CLOUD_RADIUS)


def _contacts(scene: LabelledScene) -> Triangles:
    """Discs a little before the surface, and needles along the normals: both are hidden where a normal is wrong."""
    colours = np.where(scene.scores[:, None] > 0, score_colours(scene.scores / BRIGHTEST), FAILED)
    before = scene.positions + LIFT * scene.normals
    return join(
        [
            disc_triangles(before, scene.normals, colours, CONTACT_RADIUS),
            needle_triangles(before, scene.normals, colours, NEEDLE_LENGTH, NEEDLE_RADIUS),
        ]
    )


def _hands(grasps: Grasps, gripper: Gripper) -> Triangles:
    colours = score_colours(grasps.scores)
    return join(
        [
            hand_triangles(gripper, pose, float(opening), tuple(colour))
            for pose, opening, colour in zip(grasps.poses, grasps.openings, colours, strict=True)
        ]
    )
