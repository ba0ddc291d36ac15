"""Boxes on a table before an arm, and hands that come to them from above."""

import numpy as np
import trimesh

from icgnet.geometry.transforms import make_transform

T_BASE_FRAME = make_transform(np.eye(3), np.array([0.35, -0.15, -0.05]))
"""The arm stands on the table, the middle of the workspace (0.15, 0.15) half a metre in front of it."""
DROP = np.array([0.3, 0.4, 0.15])


def box(size: tuple[float, float, float], x: float = 0.15, y: float = 0.15, z: float | None = None) -> trimesh.Trimesh:
    """A box that stands on the table of the workspace, or with its middle at height z [m]."""
    return trimesh.creation.box(size).apply_translation([x, y, 0.05 + size[2] / 2 if z is None else z])


def from_above(mesh: trimesh.Trimesh, tips: float = 0.02) -> np.ndarray:
    """A hand over the middle of a box, closing along y, its tips this far below the top [m]."""
    x, y, _ = mesh.centroid
    return make_transform(np.diag([-1.0, 1.0, -1.0]), np.array([x, y, mesh.bounds[1, 2] - tips]))
