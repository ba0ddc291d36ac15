"""A made-up prediction of shapes whose place and size are known exactly."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import make_transform, transform_points
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.prediction import NO_INSTANCE, DetectedObject, Prediction
from icgnet.objects.classes import CLASSES

VIEWPOINT = np.array([0.45, -0.25, 0.5])


def _hand_over(centre: np.ndarray, height: float) -> np.ndarray:
    """A hand that comes from straight above and closes along world y."""
    return make_transform(np.diag([-1.0, 1.0, -1.0]), np.array([centre[0], centre[1], height - 0.015]))


@pytest.fixture(scope="session")
def make_prediction() -> Callable[..., Prediction]:
    """Makes a prediction of a ball and a box, in the frame that `T_frame_table` says."""

    def make(
        T_frame_table: np.ndarray | None = None, names: tuple[str, str] = ("ball", "box"), grasps_each: int = 3
    ) -> Prediction:
        T = np.eye(4) if T_frame_table is None else T_frame_table
        ball = trimesh.creation.icosphere(subdivisions=3, radius=0.035).apply_translation([0.08, 0.12, 0.085])
        box = trimesh.creation.box([0.05, 0.04, 0.08]).apply_translation([0.21, 0.18, 0.09])
        objects, points, instances, grasps = [], [], [], []
        for k, mesh in enumerate((ball, box)):
            cloud, _ = trimesh.sample.sample_surface(mesh, 1500, seed=k)
            poses = np.zeros((grasps_each, 4, 4))
            for g in range(grasps_each):
                poses[g] = _hand_over(mesh.centroid, mesh.bounds[1, 2] + 0.02 * g)
            grasps.append(
                Grasps(
                    poses,
                    np.full(grasps_each, 0.05),
                    np.full(grasps_each, 0.062),
                    np.linspace(0.95 - 0.1 * k, 0.5, grasps_each),
                    np.full(grasps_each, k),
                    poses[:, :3, 3],
                    np.full(grasps_each, 5),
                )
            )
            placed = mesh.copy().apply_transform(T)
            points_in_frame = transform_points(T, cloud)
            objects.append(DetectedObject(k, 0.8, names[k], 0.9, points_in_frame, lambda placed=placed: placed))
            points.append(cloud)
            instances.append(np.full(len(cloud), k))
        stray = np.column_stack([np.full(20, 0.28), np.linspace(0.02, 0.28, 20), np.full(20, 0.06)])
        cloud = transform_points(T, np.concatenate([*points, stray]))
        return Prediction(
            objects=tuple(objects),
            grasps=Grasps.concatenate(grasps).transformed(T).sorted(),
            frame_id="camera",
            rejected={},
            timings_ms={"encode": 120.0, "grasps": 80.0},
            cloud=PointCloud(cloud, transform_points(T, VIEWPOINT), "camera"),
            cloud_instances=np.concatenate([*instances, np.full(20, NO_INSTANCE)]),
            T_frame_table=T,
            gripper=load_gripper("franka"),
            classes=CLASSES,
            input_rows=np.arange(len(cloud)),
            input_shape=(len(cloud),),
        )

    return make
