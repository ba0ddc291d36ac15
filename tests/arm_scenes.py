"""Boxes on a table before an arm, and hands that come to them from above."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import trimesh
import yaml

from box_objects import predicted
from icgnet.geometry.transforms import make_transform
from icgnet.grasping.grasps import Grasps
from icgnet.inference.prediction import Prediction

if TYPE_CHECKING:
    from icgnet.arm.arm import Arm

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


def link_meshes(arm: "Arm", joints: np.ndarray) -> list[trimesh.Trimesh]:
    """The collision shapes of the links in the frame of the base [m]."""
    poses = arm.link_poses(joints)
    return [shape.mesh.copy().apply_transform(T) for shape, T in zip(arm.link_shapes, poses, strict=True)]


def boxes_seen(meshes: list[trimesh.Trimesh], grasped: tuple[int, ...] = (0,), width: float = 0.04) -> Prediction:
    """A prediction of boxes with one grasp from above on each of some of them, in this order."""
    clouds = [np.asarray(mesh.sample(600, seed=k)) for k, mesh in enumerate(meshes)]
    labels = np.repeat(np.arange(len(meshes)), 600)
    poses = np.array([from_above(meshes[k]) for k in grasped]).reshape(-1, 4, 4)
    count = len(grasped)
    grasps = Grasps(
        poses,
        np.full(count, width),
        np.full(count, width + 0.012),
        np.linspace(0.9, 0.8, count),
        np.array(grasped, dtype=np.int64),
        poses[:, :3, 3],
        np.full(count, 5),
    )
    return replace(predicted(meshes, np.concatenate(clouds), labels), grasps=grasps)


def arm_file(folder: Path) -> Path:
    """A file of the shipped arm, standing where `T_BASE_FRAME` says, in a world that is the frame of the boxes."""
    from icgnet.arm.description import ARMS

    entries = yaml.safe_load((ARMS / "fr3.yaml").read_text())
    base = {"position": (-T_BASE_FRAME[:3, 3]).tolist(), "quaternion": [1, 0, 0, 0]}
    path = folder / "arm.yaml"
    path.write_text(yaml.safe_dump(entries | {"urdf": str(ARMS / "fr3.urdf"), "base": base}))
    return path
