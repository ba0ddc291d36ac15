"""Made-up predictions of shapes whose place and size are known exactly."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import make_transform, transform_points
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.prediction import NO_INSTANCE, DetectedObject, Prediction, SupportPlane
from icgnet.inference.rejections import REASONS, Rejections
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


@pytest.fixture(scope="session")
def rejecting_prediction(make_prediction) -> Prediction:
    """A ball with grasps and a box without: 40 had low scores, two would have hit what was measured beside it."""
    return without_grasps(make_prediction(np.diag([-1.0, -1.0, 1.0, 1.0])), (1,))


def without_grasps(found: Prediction, instances: tuple[int, ...]) -> Prediction:
    """The same with all grasps of some objects dropped: the worst of each for its score, the others for points."""
    is_lost = np.isin(found.grasps.instances, instances)
    lost = found.grasps.select(is_lost)
    worst = np.array([g == np.flatnonzero(lost.instances == lost.instances[g])[-1] for g in range(len(lost))])
    lost = replace(lost, scores=np.where(worst, 0.04, lost.scores))
    reasons = np.where(worst, REASONS.index("low_score"), REASONS.index("points"))
    dropped = Rejections.of_grasps(lost, reasons, len(found.objects))
    dropped.counts[list(instances), REASONS.index("low_score")] = 40
    return replace(found, grasps=found.grasps.select(~is_lost), rejections=dropped, rejected=dropped.total())


@pytest.fixture(scope="session")
def crowded_prediction() -> Prediction:
    """Twenty cubes in rows on a table with a second level beside it; every other one has no grasp."""
    cubes, points, instances, poses = [], [], [], []
    for k in range(20):
        cube = trimesh.creation.box([0.05, 0.05, 0.05]).apply_translation([0.12 * (k % 5), 0.12 * (k // 5), 0.075])
        cloud, _ = trimesh.sample.sample_surface(cube, 200, seed=k)
        cubes.append(DetectedObject(k, 0.8, "box", 0.9, cloud, lambda cube=cube: cube))
        points.append(cloud)
        instances.append(np.full(200, k))
        poses.append(_hand_over(cube.centroid, 0.1))
    across = np.stack(np.meshgrid(np.linspace(-0.2, 0.7, 60), np.linspace(-0.2, 0.6, 60)), axis=-1).reshape(-1, 2)
    table = np.column_stack([across, np.where(across[:, 0] > 0.6, 0.0, 0.05)])
    poses = np.repeat(np.array(poses), 3, axis=0)
    poses[:, 2, 3] += np.tile([0.0, 0.01, 0.02], 20)
    count = len(poses)
    grasps = Grasps(
        poses,
        np.full(count, 0.05),
        np.full(count, 0.062),
        np.linspace(0.9, 0.3, count),
        np.repeat(np.arange(20), 3),
        poses[:, :3, 3],
        np.full(count, 5),
    )
    cloud = np.concatenate([*points, table])
    up = (0.0, 0.0, 1.0)
    found = Prediction(
        objects=tuple(cubes),
        grasps=grasps,
        frame_id="base_link",
        rejected={},
        timings_ms={"encode": 120.0},
        cloud=PointCloud(cloud, VIEWPOINT, "base_link"),
        cloud_instances=np.concatenate([*instances, np.full(len(table), NO_INSTANCE)]),
        T_frame_table=np.eye(4),
        gripper=load_gripper("franka"),
        classes=CLASSES,
        input_rows=np.arange(len(cloud)),
        input_shape=(len(cloud),),
        left_out={"background": 1},
        supports=(SupportPlane(up, 0.05, 0.4, 0.6, 0.0), SupportPlane(up, 0.0, 0.1, 0.1, 0.0)),
        warnings=("the table was a close choice",),
    )
    return without_grasps(found, tuple(range(1, 20, 2)))
