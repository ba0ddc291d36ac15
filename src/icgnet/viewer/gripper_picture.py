"""The picture of a hand: open, closed and on a cup, with the frames that its file is about."""

from dataclasses import replace

import numpy as np
import trimesh
from jaxtyping import Float
from PIL import Image

from icgnet.grasping.gripper import Gripper
from icgnet.viewer.palette import QUIET_INK
from icgnet.viewer.picture import PlacedLabel, SceneDrawing, draw_scene
from icgnet.viewer.render import TableSurface
from icgnet.viewer.triangles import Colour, Triangles, join, mesh_triangles, whole_hand_triangles
from icgnet.viewer.view import Perspective, framing_view

PANEL = (560, 520)
"""Height and width of one panel [pixels]."""
PALM_COLOUR, FINGER_COLOUR, CUP_COLOUR = (0.62, 0.64, 0.67), (0.24, 0.66, 0.30), (0.40, 0.62, 0.85)
AXIS_COLOURS = {"x": (0.80, 0.20, 0.20), "y": (0.20, 0.60, 0.25), "z": (0.20, 0.35, 0.85)}
AXIS_LENGTH, AXIS_RADIUS = 0.04, 0.0012
"""Of the drawn axes of a frame [m]."""
SEE_THROUGH = 0.45
"""Opacity of the palm where the axes of the base link may lie inside of it."""
AZIMUTH, ELEVATION = np.deg2rad(32.0), np.deg2rad(16.0)
CUP_HEIGHT, CUP_WALL = 0.09, 0.004
LARGEST_CUP = 0.07
"""Outer diameter of the cup at most [m]; a hand that opens less gets a smaller one."""
DOWN = np.diag([-1.0, 1.0, -1.0, 1.0])
"""The orientation of a hand that comes straight down, closing along world y."""


def gripper_panels(gripper: Gripper, panel: tuple[int, int] = PANEL) -> dict[str, Image.Image]:
    """Pictures of the hand by their captions: open, closed, and on a cup.

    Args:
        gripper: the hand.
        panel: height and width of each [pixels].
    """
    diameter = cup_diameter(gripper)
    frames = {"grasp": DOWN, "base": DOWN @ gripper.T_grasp_base}
    open_hand = _hand(gripper, DOWN, gripper.max_opening, SEE_THROUGH)
    axes = [_axes(pose) for pose in frames.values()]
    labels = tuple(PlacedLabel(name, pose[:3, 3], QUIET_INK) for name, pose in frames.items())
    # All that is drawn decides the view, so that open and closed hand have the same size.
    view = _view(join([open_hand, *axes]), panel)
    cup = [mesh_triangles(part, CUP_COLOUR) for part in _cup(diameter)]
    held = join([_hand(gripper, _grasp_at_rim(gripper), diameter), *cup])
    return {
        f"open, {1e3 * gripper.max_opening:.0f} mm between the pads; x red, y green, z blue": draw_scene(
            SceneDrawing(join([open_hand, *axes]), labels, view, None), panel
        ),
        "closed": draw_scene(
            SceneDrawing(join([_hand(gripper, DOWN, 0.0, SEE_THROUGH), *axes]), (), view, None), panel
        ),
        f"on a cup of {1e3 * diameter:.0f} mm": draw_scene(
            SceneDrawing(held, (), _view(held, panel), TableSurface(0.0, (0.0, 0.0), 0.25)), panel
        ),
    }


def cup_diameter(gripper: Gripper) -> float:
    """Of the cup that the hand is drawn on [m]: it fits between the open fingers."""
    return max(min(LARGEST_CUP, gripper.max_opening - 2.0 * gripper.clearance), gripper.max_opening / 2)


def _grasp_at_rim(gripper: Gripper) -> Float[np.ndarray, "4 4"]:
    """A hand above the cup, as low as the palm allows, at most 35 mm below the rim [m]."""
    backs = [box.corners()["upper"][2] for box in gripper.palm] or [
        min(box.corners()["lower"][2] for box in gripper.finger)
    ]
    pose = DOWN.copy()
    pose[2, 3] = CUP_HEIGHT - min(0.035, -max(backs) - 0.002)
    return pose


def _cup(diameter: float) -> list[trimesh.Trimesh]:
    """A cup and its handle along x, upright on the table at the origin [m]."""
    radius = diameter / 2
    wall = min(CUP_WALL, radius / 4)
    profile = [(0, 0), (radius, 0), (radius, CUP_HEIGHT), (radius - wall, CUP_HEIGHT), (radius - wall, wall), (0, wall)]
    body = trimesh.creation.revolve(np.array(profile, float), sections=64)
    ring = trimesh.creation.torus(0.022, 0.004, major_sections=48, minor_sections=16)
    ring.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [1.0, 0.0, 0.0]))
    ring.apply_translation([radius, 0.0, CUP_HEIGHT / 2])
    outside = np.linalg.norm(ring.triangles_center[:, :2], axis=1) > radius - wall
    ring.update_faces(outside)
    return [body, ring]


def _hand(
    gripper: Gripper, T_world_grasp: Float[np.ndarray, "4 4"], opening: float, palm_opacity: float = 1.0
) -> Triangles:
    fingers, palm = replace(gripper, palm=()), replace(gripper, finger=())
    return join(
        [
            whole_hand_triangles(fingers, T_world_grasp, opening, FINGER_COLOUR, 1.0),
            whole_hand_triangles(palm, T_world_grasp, opening, PALM_COLOUR, palm_opacity),
        ]
    )


def _axes(T_world_frame: Float[np.ndarray, "4 4"]) -> Triangles:
    """The axes of a frame: x red, y green, z blue."""
    origin = T_world_frame[:3, 3]
    return join(
        [
            _rod(origin, origin + AXIS_LENGTH * T_world_frame[:3, axis], colour)
            for axis, colour in enumerate(AXIS_COLOURS.values())
        ]
    )


def _rod(start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"], colour: Colour) -> Triangles:
    return mesh_triangles(trimesh.creation.cylinder(AXIS_RADIUS, segment=np.stack([start, end]), sections=12), colour)


def _view(drawn: Triangles, panel: tuple[int, int]) -> Perspective:
    return framing_view(drawn.corners.reshape(-1, 3), float(AZIMUTH), float(ELEVATION), panel, margin=0.08)
