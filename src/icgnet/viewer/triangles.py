"""Everything that is drawn, as triangles: meshes, hands, and the points of a cloud as small discs."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

from icgnet.geometry.transforms import transform_points
from icgnet.grasping.gripper import Box, Gripper

CREASE_COSINE = 0.82
"""Corners whose faces differ by more than the angle of this cosine (35 degrees) are drawn as an edge."""
DISC_CORNERS = 6
BREADTH, THICKNESS, STEM = 0.008, 0.005, 0.035
"""Of the bars that a hand is drawn with, and the length of its stem [m]."""

Colour = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Triangles:
    """Coloured triangles, world frame.

    Attributes:
        corners: the three corners of each [m].
        normals: unit normals at the corners, interpolated for shading.
        colours: sRGB in [0, 1].
        opacities: 1 hides what is behind, 0 is invisible.
    """

    corners: Float[np.ndarray, "t 3 3"]
    normals: Float[np.ndarray, "t 3 3"]
    colours: Float[np.ndarray, "t 3"]
    opacities: Float[np.ndarray, "t"]

    def __len__(self) -> int:
        return len(self.corners)


def join(parts: Sequence[Triangles]) -> Triangles:
    """All triangles of the parts."""
    if not parts:
        return Triangles(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros(0))
    return Triangles(
        np.concatenate([part.corners for part in parts]),
        np.concatenate([part.normals for part in parts]),
        np.concatenate([part.colours for part in parts]),
        np.concatenate([part.opacities for part in parts]),
    )


def mesh_triangles(mesh: trimesh.Trimesh, colour: Colour, opacity: float = 1.0) -> Triangles:
    """A mesh in one colour, smooth except at creases."""
    flat = np.asarray(mesh.face_normals, float)
    smooth = np.asarray(mesh.vertex_normals, float)[mesh.faces]
    creased = np.einsum("tkd,td->tk", smooth, flat) < CREASE_COSINE
    normals = np.where(creased[..., None], flat[:, None], smooth)
    return _painted(np.asarray(mesh.triangles, float), normals, colour, opacity)


def hand_triangles(
    gripper: Gripper, T_world_grasp: Float[np.ndarray, "4 4"], opening: float, colour: Colour, opacity: float = 1.0
) -> Triangles:
    """A gripper at a grasp, drawn slim (see `slim_hand_mesh`), with its pads `opening` [m] apart."""
    return _flat_triangles(slim_hand_mesh(gripper, opening).apply_transform(T_world_grasp), colour, opacity)


def whole_hand_triangles(
    gripper: Gripper, T_world_grasp: Float[np.ndarray, "4 4"], opening: float, colour: Colour, palm_opacity: float
) -> Triangles:
    """A gripper at a grasp as large as it is, its pads `opening` [m] apart; the palm may be see-through."""
    boxes = gripper.boxes(opening)
    palm, fingers = boxes[: len(gripper.palm)], boxes[len(gripper.palm) :]
    parts = ((palm, palm_opacity), (fingers, 1.0))
    return join(
        [_flat_triangles(_boxes_mesh(own).apply_transform(T_world_grasp), colour, each) for own, each in parts if own]
    )


def hand_mesh(gripper: Gripper, opening: float) -> trimesh.Trimesh:
    """The boxes of a gripper with its pads `opening` [m] apart, grasp frame."""
    return _boxes_mesh(gripper.boxes(opening))


def slim_hand_mesh(gripper: Gripper, opening: float) -> trimesh.Trimesh:
    """The same drawn thin, so that a dozen hands do not hide the scene: pads, a bar and a stem; grasp frame."""
    rear = min(box.centre[2] - box.size[2] / 2 for box in gripper.finger)
    finger = Box((0.0, opening / 2 + THICKNESS / 2, rear / 2), (BREADTH, THICKNESS, -rear))
    bar = Box((0.0, 0.0, rear - THICKNESS / 2), (BREADTH, opening + 2 * THICKNESS, THICKNESS))
    stem = Box((0.0, 0.0, rear - THICKNESS - STEM / 2), (BREADTH, THICKNESS, STEM))
    return _boxes_mesh((finger, finger.mirrored(), bar, stem))


def _boxes_mesh(boxes: Sequence[Box]) -> trimesh.Trimesh:
    meshes = [trimesh.creation.box(box.size).apply_translation(box.centre) for box in boxes]
    offsets = 8 * np.arange(len(meshes))[:, None, None]
    faces = np.stack([mesh.faces for mesh in meshes]) + offsets
    return trimesh.Trimesh(np.concatenate([mesh.vertices for mesh in meshes]), faces.reshape(-1, 3), process=False)


def disc_triangles(
    points: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    colours: Float[np.ndarray, "n 3"],
    radius: float,
) -> Triangles:
    """The points of a cloud as discs of this radius [m], each lying in the surface that its normal describes."""
    rim = _around(normals, DISC_CORNERS)
    rim = points[:, None] + radius * rim
    fan = np.stack([np.zeros(DISC_CORNERS - 2, int), np.arange(1, DISC_CORNERS - 1), np.arange(2, DISC_CORNERS)], 1)
    corners = rim[:, fan].reshape(-1, 3, 3)
    per_disc = len(fan)
    return Triangles(
        corners,
        np.repeat(normals, 3 * per_disc, axis=0).reshape(-1, 3, 3),
        np.repeat(colours, per_disc, axis=0),
        np.ones(len(corners)),
    )


def needle_triangles(
    points: Float[np.ndarray, "n 3"],
    directions: Float[np.ndarray, "n 3"],
    colours: Float[np.ndarray, "n 3"],
    length: float,
    radius: float,
) -> Triangles:
    """Three-sided spikes that stand on points and show directions (unit vectors); length and radius in [m]."""
    rim = radius * _around(directions, 3) + points[:, None]
    tips = np.repeat((points + length * directions)[:, None], 3, axis=1)
    corners = np.stack([rim, np.roll(rim, -1, axis=1), tips], axis=2)
    flat = np.cross(corners[:, :, 1] - corners[:, :, 0], corners[:, :, 2] - corners[:, :, 0])
    flat /= np.maximum(np.linalg.norm(flat, axis=2, keepdims=True), 1e-12)
    normals = np.repeat(flat[:, :, None], 3, axis=2)
    count = 3 * len(points)
    return Triangles(
        corners.reshape(-1, 3, 3), normals.reshape(-1, 3, 3), np.repeat(colours, 3, axis=0), np.ones(count)
    )


def _around(axes: Float[np.ndarray, "n 3"], count: int) -> Float[np.ndarray, "n k 3"]:
    """Unit vectors at right angles to each axis, `count` of them, evenly spread."""
    across = np.cross(axes, np.where(np.abs(axes[:, :1]) < 0.8, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    along = np.cross(axes, across)
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return np.cos(angles)[:, None] * across[:, None] + np.sin(angles)[:, None] * along[:, None]


def moved(triangles: Triangles, T_a_b: Float[np.ndarray, "4 4"]) -> Triangles:
    """The triangles of frame b in frame a."""
    corners = transform_points(T_a_b, triangles.corners)
    return Triangles(corners, triangles.normals @ T_a_b[:3, :3].T, triangles.colours, triangles.opacities)


def _flat_triangles(mesh: trimesh.Trimesh, colour: Colour, opacity: float) -> Triangles:
    flat = np.repeat(np.asarray(mesh.face_normals, float)[:, None], 3, axis=1)
    return _painted(np.asarray(mesh.triangles, float), flat, colour, opacity)


def _painted(
    corners: Float[np.ndarray, "t 3 3"], normals: Float[np.ndarray, "t 3 3"], colour: Colour, opacity: float
) -> Triangles:
    count = len(corners)
    return Triangles(corners, normals, np.tile(colour, (count, 1)), np.full(count, float(opacity)))
