"""An object set of one box and one ball, of which everything is known."""

from functools import partial

import numpy as np
import trimesh

from icgnet.errors import InputError
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import make_transform
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.prediction import DetectedObject, Prediction
from icgnet.objects.classes import CLASSES
from icgnet.objects.kinds import Kind, Split
from icgnet.objects.model import ObjectModel
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.scene import PlacedObject, Scene

EDGE, RADIUS = 0.06, 0.03


class BoxAndBall(ObjectSet):
    """A box with edges of 6 cm, and a ball of 3 cm radius that is drawn with a smaller one inside."""

    def __init__(self) -> None:
        super().__init__("box and ball")

    def names(self, kind: Kind, split: Split) -> tuple[str, ...]:
        return ("ball", "box")

    def class_name(self, key: str) -> str:
        if key not in ("ball", "box"):
            raise InputError(f"no object {key!r}")
        return key

    def fingerprint(self, key: str) -> str:
        return key

    def _load(self, key: str) -> ObjectModel:
        if key == "box":
            mesh = trimesh.creation.box((EDGE, EDGE, EDGE))
            return ObjectModel(key, key, mesh, (mesh,))
        sphere = partial(trimesh.creation.icosphere, subdivisions=4)
        mesh = trimesh.util.concatenate([sphere(radius=RADIUS), sphere(radius=RADIUS / 2)])
        return ObjectModel(key, key, mesh, (mesh.convex_hull,))


def placed(*objects: tuple[str, tuple[float, float, float]]) -> Scene:
    """Objects of scale 1, upright, with these centres [m]."""
    return Scene(
        "packed", tuple(PlacedObject(name, 1.0, make_transform(np.eye(3), np.array(at))) for name, at in objects)
    )


def predicted(meshes: list[trimesh.Trimesh], points: np.ndarray, labels: np.ndarray) -> Prediction:
    """A prediction of these shapes, in a cloud whose points belong to them."""
    return Prediction(
        objects=tuple(
            DetectedObject(number, 0.8, "box", 0.9, points[labels == number], lambda mesh=mesh: mesh)
            for number, mesh in enumerate(meshes)
        ),
        grasps=Grasps.empty(),
        frame_id="world",
        rejected={},
        timings_ms={},
        cloud=PointCloud(points, None, "world"),
        cloud_instances=labels,
        T_frame_table=np.eye(4),
        gripper=load_gripper(),
        classes=CLASSES,
        input_rows=np.arange(len(points)),
        input_shape=(len(points),),
    )
