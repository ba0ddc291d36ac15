"""Clouds of tables with boxes, in the frame of a camera."""

import numpy as np

from icgnet.geometry.camera import look_at
from icgnet.geometry.transforms import invert_transform, transform_points

TOP_VIEW = look_at(np.array([0.1, 0.0, 0.7]), np.array([0.0, 0.0, 0.0]))
SIDE_VIEW = look_at(np.array([0.6, 0.1, 0.25]), np.array([0.0, 0.0, 0.05]))


def box_faces(rng: np.random.Generator, lower: list, upper: list, viewpoint: np.ndarray, count: int) -> np.ndarray:
    """Points on those faces of a box that can be seen."""
    lower, upper = np.array(lower), np.array(upper)
    faces = []
    for axis in range(3):
        side = upper if viewpoint[axis] > upper[axis] else lower
        face = rng.uniform(lower, upper, (count, 3))
        face[:, axis] = side[axis]
        faces.append(face)
    return np.concatenate(faces)


def cluttered_table(rng: np.random.Generator, T_world_camera: np.ndarray, on_objects: float = 0.3) -> np.ndarray:
    """A table at z = 0 with two boxes, in the camera frame, with noise of 1 mm."""
    viewpoint = T_world_camera[:3, 3]
    count = 20000
    table = np.column_stack([rng.uniform(-0.4, 0.4, (count, 2)), np.zeros(count)])
    per_face = int(count * on_objects / (1 - on_objects) / 6)
    boxes = [
        box_faces(rng, [-0.1, -0.1, 0.0], [0.0, 0.1, 0.15], viewpoint, per_face),
        box_faces(rng, [0.1, -0.05, 0.0], [0.2, 0.05, 0.06], viewpoint, per_face),
    ]
    points = np.concatenate([table, *boxes])
    points += rng.normal(0, 0.001, points.shape)
    return transform_points(invert_transform(T_world_camera), points)
