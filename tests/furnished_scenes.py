"""Rooms, bins and shelves with boxes in them, as a depth camera sees them."""

import numpy as np
import trimesh

from icgnet.geometry.camera import look_at, unproject
from icgnet.geometry.clouds import PointCloud
from icgnet.simulation.camera import SceneRenderer

INTRINSICS = np.array([[150.0, 0.0, 80.0], [0.0, 150.0, 60.0], [0.0, 0.0, 1.0]])
SHAPE = (120, 160)
NOISE = 0.001

Scene = tuple[PointCloud, np.ndarray]
"""A cloud in the frame of the camera, and T_world_camera."""


def box(lower: tuple[float, float, float], upper: tuple[float, float, float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=np.array([lower, upper], dtype=float))


def depth_cloud(
    meshes: list[trimesh.Trimesh], eye: np.ndarray, target: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> Scene:
    """What a camera sees of some meshes, with noise."""
    pose = look_at(eye, np.array(target))
    mesh = trimesh.util.concatenate(meshes)
    renderer = SceneRenderer(np.asarray(mesh.triangles), np.zeros(len(mesh.faces), dtype=np.int64), table_height=None)
    depth = np.asarray(renderer.render(INTRINSICS, SHAPE, pose).depth, dtype=np.float64)
    depth = np.where(np.isfinite(depth) & (depth > 0), depth, np.nan)
    depth += np.random.default_rng(1).normal(0.0, NOISE, depth.shape)
    points = unproject(depth, INTRINSICS).reshape(-1, 3)
    return PointCloud(points[np.isfinite(points).all(axis=1)], np.zeros(3), "camera"), pose


def boxes_on(height: float, count: int, spread: float, seed: int = 0) -> list[trimesh.Trimesh]:
    """Some boxes that stand at a height."""
    rng = np.random.default_rng(seed)
    corners = np.column_stack([rng.uniform(-spread, spread, (count, 2)), np.full(count, height)])
    return [box(tuple(corner), tuple(corner + rng.uniform(0.03, 0.08, 3))) for corner in corners]


def plate(size: tuple[float, float, float], angle: float, axis: tuple[int, int, int], at: tuple) -> trimesh.Trimesh:
    """A thin box turned about an axis and moved."""
    mesh = trimesh.creation.box(size)
    mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, axis))
    return mesh.apply_translation(at)


def bin_scene(slope_deg: float, view: str, depth: float = 0.1) -> Scene:
    """A bin of 0.4 x 0.3 m with walls that lean outwards."""
    width, length, angle = 0.4, 0.3, np.deg2rad(slope_deg)
    lean, along = 0.5 * depth * np.tan(angle), 4 * 0.5 * depth * np.tan(angle)
    walls = []
    for side in (-1.0, 1.0):
        tall, middle = depth / np.cos(angle), 0.005 + depth / 2
        walls.append(
            plate((0.004, length + along, tall), side * angle, (0, 1, 0), (side * (width / 2 + lean), 0, middle))
        )
        walls.append(
            plate((width + along, 0.004, tall), -side * angle, (1, 0, 0), (0, side * (length / 2 + lean), middle))
        )
    base = [box((-width / 2, -length / 2, 0.0), (width / 2, length / 2, 0.005))]
    eye = np.array([0.05, -0.05, 0.75]) if view == "above" else np.array([0.05, -0.45, 0.7])
    return depth_cloud([*base, *walls, *boxes_on(0.005, 6, 0.1)], eye)


def low_table(height: float) -> Scene:
    """A table of 0.8 x 0.6 m in a room, with boxes on it."""
    legs = [
        box((x - 0.02, y - 0.02, 0.0), (x + 0.02, y + 0.02, height - 0.03))
        for x in (-0.38, 0.38)
        for y in (-0.28, 0.28)
    ]
    room = [box((-3, -3, -0.02), (3, 3, 0.0)), box((-0.4, -0.3, height - 0.03), (0.4, 0.3, height))]
    eye = np.array([0.3, -1.2, height + 0.9])
    return depth_cloud([*room, *legs, *boxes_on(height, 6, 0.22)], eye, (0.0, 0.0, height))


def wall_behind() -> Scene:
    """A table that ends at a wall."""
    room = [box((-0.5, -0.4, -0.03), (0.5, 0.4, 0.0)), box((-1.5, 0.42, -1.0), (1.5, 0.45, 1.5))]
    return depth_cloud([*room, *boxes_on(0.0, 6, 0.25)], np.array([0.0, -0.8, 0.6]))


def shelf() -> Scene:
    """Two boards with a back and sides, seen from the front."""
    boards = [box((-0.5, 0, -0.02), (0.5, 0.3, 0.0)), box((-0.5, 0, 0.33), (0.5, 0.3, 0.35))]
    sides = [box((x - 0.01, 0, -0.4), (x + 0.01, 0.3, 0.7)) for x in (-0.51, 0.51)]
    back = [box((-0.5, 0.3, -0.4), (0.5, 0.32, 0.7))]
    things = [mesh.apply_translation((0.0, 0.1, 0.0)) for mesh in boxes_on(0.0, 5, 0.09)]
    return depth_cloud([*boards, *sides, *back, *things], np.array([0.0, -0.6, 0.25]), (0.0, 0.15, 0.05))


def pile() -> Scene:
    """Turned boxes that fill the picture."""
    rng = np.random.default_rng(2)
    things = []
    for _ in range(160):
        mesh = trimesh.creation.box(rng.uniform(0.04, 0.09, 3))
        mesh.apply_transform(trimesh.transformations.random_rotation_matrix(rng.uniform(size=3)))
        things.append(mesh.apply_translation(rng.uniform((-0.35, -0.35, -0.15), (0.35, 0.35, 0.05))))
    return depth_cloud(things, np.array([0.0, -0.05, 0.6]))
