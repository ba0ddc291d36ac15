"""What the predictor found in a scene, and how it is written to a folder and read back."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float, Int, Real
from PIL import Image

from icgnet.errors import DataError, IcgnetError, InputError
from icgnet.geometry.clouds import PointCloud
from icgnet.grasping import selection
from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.objects.classes import check_class_list, class_index
from icgnet.output_folder import output_folder

FORMAT = "icgnet prediction 3"
RESULT_FILE = "result.json"
GRASPS_FILE = "grasps.npz"
CLOUD_FILE = "cloud.npz"
MASK_FILE = "mask.png"
PICTURE_FILE = "picture.png"
MESH_FOLDER = "meshes"

NO_INSTANCE = -1
"""Instance id of points that belong to no object: the table, noise, things that the network left out."""


@dataclass(frozen=True, eq=False)
class DetectedObject:
    """One object found in the scene, in the frame of the prediction.

    Attributes:
        instance_id: number by which grasps and points refer to it.
        score: how sure the network is that this is one whole object, 0 to 1.
        class_name: one of the classes that the weights know, see `Prediction.classes`.
        class_score: probability of that class, given that it is an object.
        points: the input points that belong to it [m].
        extract: makes the complete mesh; called at most once, by `mesh()`.
    """

    instance_id: int
    score: float
    class_name: str
    class_score: float
    points: Float[np.ndarray, "n 3"]
    extract: Callable[[], trimesh.Trimesh]

    def mesh(self) -> trimesh.Trimesh:
        """The complete predicted surface, also where the camera saw nothing [m]; extracted on first use."""
        return self._mesh

    @cached_property
    def _mesh(self) -> trimesh.Trimesh:
        return self.extract()


@dataclass(frozen=True, eq=False)
class Prediction:
    """Everything found in one scene. Coordinates are in the frame `frame_id`, in metres.

    Attributes:
        objects: the objects, numbered from 0.
        grasps: collision-free grasps, best first.
        frame_id: "world" when the camera's pose (of a cloud: its viewpoint) or the table's height was given, else
            "camera".
        rejected: how many candidate grasps were dropped, by reason.
        timings_ms: time per stage [ms].
        cloud: the measured points, and the viewpoint if it is known.
        cloud_instances: instance id of every point of `cloud`, `NO_INSTANCE` for none.
        T_frame_table: pose of the table frame: z up, table plane at z = 0.05 m.
        gripper: the hand that the grasps are for.
        classes: names of all classes that the weights know.
        input_rows: where each point of `cloud` stands in the flattened input.
        input_shape: shape of the input, (n,) for a cloud and (h, w) for a depth image.
    """

    objects: tuple[DetectedObject, ...]
    grasps: Grasps
    frame_id: str
    rejected: dict[str, int]
    timings_ms: dict[str, float]
    cloud: PointCloud
    cloud_instances: Int[np.ndarray, "n"]
    T_frame_table: Float[np.ndarray, "4 4"]
    gripper: Gripper
    classes: tuple[str, ...]
    input_rows: Int[np.ndarray, "n"]
    input_shape: tuple[int, ...]

    @property
    def instance_mask(self) -> Int[np.ndarray, "*s"]:
        """Instance id of every input point or pixel, in the shape of the input."""
        mask = np.full(self.input_shape, NO_INSTANCE, dtype=np.int64)
        mask.ravel()[self.input_rows] = self.cloud_instances
        return mask

    def class_of(self, instance_id: int) -> str:
        """Class name of an object.

        Raises:
            InputError: there is no such object.
        """
        if not 0 <= instance_id < len(self.objects):
            raise InputError(f"no object {instance_id}: the scene has {len(self.objects)}, numbered from 0")
        return self.objects[instance_id].class_name

    def of_instance(self, instance_id: int) -> "Prediction":
        """The same prediction with the grasps of one object only.

        Raises:
            InputError: there is no such object.
        """
        self.class_of(instance_id)
        return replace(self, grasps=selection.of_instances(self.grasps, [instance_id]))

    def of_class(self, class_name: str) -> "Prediction":
        """The same prediction with the grasps of the objects of one class only.

        Raises:
            InputError: the class is not one of `classes`.
        """
        class_index(class_name, self.classes)
        instance_classes = {item.instance_id: item.class_name for item in self.objects}
        return replace(self, grasps=selection.of_class(self.grasps, class_name, instance_classes))

    def in_region(self, lower: Real[np.ndarray, "3"], upper: Real[np.ndarray, "3"]) -> "Prediction":
        """The same prediction with the grasps in a box only, in the frame of the prediction [m].

        Raises:
            InputError: a lower coordinate that is above the upper one.
        """
        return replace(self, grasps=selection.in_region(self.grasps, lower, upper))

    def distinct(self, limit: int | None = None) -> "Prediction":
        """The same prediction without grasps that hardly differ from a better one, `limit` at most."""
        return replace(self, grasps=selection.non_maximum_suppression(self.grasps, limit=limit))

    def best(self) -> Grasps:
        """The grasp to try first; empty when there is none."""
        return self.grasps.select(slice(0, 1))

    def highest(self) -> Grasps:
        """The highest grasp scored above 0.9, else 0.8, else 0.7; empty when there is none: then look again.

        Only grasps that were kept are asked; a search with `select="highest"` checks all of these for collision.

        Paper: "Real World Experiments".
        """
        return selection.ranked(self.grasps, "highest", self.T_frame_table[:3, 2]).select(slice(0, 1))

    def to_dict(self) -> dict[str, Any]:
        """The prediction without clouds and meshes as plain values, for JSON."""
        return {
            "format": FORMAT,
            "frame_id": self.frame_id,
            "T_frame_table": self.T_frame_table.tolist(),
            "gripper": self.gripper.to_dict(),
            "classes": list(self.classes),
            "objects": [_object_entry(item) for item in self.objects],
            "grasps": list(self._grasp_entries()),
            "rejected": self.rejected,
            "timings_ms": {stage: round(time, 3) for stage, time in self.timings_ms.items()},
        }

    def write(self, folder: Path) -> None:
        """Writes result.json, grasps.npz, cloud.npz, meshes/ and, for a depth image, mask.png."""
        meshes = folder / MESH_FOLDER
        meshes.mkdir()
        for item in self.objects:
            item.mesh().export(folder / _mesh_path(item))
        np.savez_compressed(
            folder / GRASPS_FILE,
            grasps=self.grasps.poses,
            width=self.grasps.widths,
            opening=self.grasps.openings,
            score=self.grasps.scores,
            instance_id=self.grasps.instances,
            class_name=np.array([self.class_of(int(i)) for i in self.grasps.instances], dtype=np.str_),
            contact=self.grasps.contacts,
            angle=self.grasps.angles,
            frame_id=self.frame_id,
        )
        viewpoint = np.full(3, np.nan) if self.cloud.viewpoint is None else self.cloud.viewpoint
        np.savez_compressed(
            folder / CLOUD_FILE,
            points=self.cloud.points.astype(np.float32),
            viewpoint=viewpoint,
            instance_id=self.cloud_instances.astype(np.int16),
            input_row=self.input_rows.astype(np.int32),
            input_shape=np.array(self.input_shape),
        )
        if len(self.input_shape) == 2:
            # 0 is no object, k + 1 the object k.
            Image.fromarray((self.instance_mask + 1).astype(np.uint16)).save(folder / MASK_FILE)
        (folder / RESULT_FILE).write_text(json.dumps(self.to_dict(), indent=1) + "\n")

    def save(self, path: str | Path, overwrite: bool = False) -> None:
        """Writes the prediction as a folder that appears whole or not at all; an earlier prediction is replaced.

        Args:
            path: the folder.
            overwrite: whether a folder with other files may be replaced too.

        Raises:
            InputError: something else is in the way.
        """
        with output_folder(Path(path), RESULT_FILE, overwrite) as folder:
            self.write(folder)

    def _grasp_entries(self) -> Iterator[dict[str, Any]]:
        grasps = self.grasps
        for g in range(len(grasps)):
            instance_id = int(grasps.instances[g])
            yield {
                "pose": grasps.poses[g].tolist(),
                "width": float(grasps.widths[g]),
                "opening": float(grasps.openings[g]),
                "score": float(grasps.scores[g]),
                "instance_id": instance_id,
                "class_name": self.class_of(instance_id),
                "contact": grasps.contacts[g].tolist(),
                "approach_angle": float(APPROACH_ANGLES[grasps.angles[g]]),
            }


def _mesh_path(item: DetectedObject) -> str:
    return f"{MESH_FOLDER}/{item.instance_id:02d}_{item.class_name}.ply"


def _object_entry(item: DetectedObject) -> dict[str, Any]:
    return {
        "instance_id": item.instance_id,
        "score": float(item.score),
        "class_name": item.class_name,
        "class_score": float(item.class_score),
        "points": len(item.points),
        "lower": item.points.min(axis=0).tolist(),
        "upper": item.points.max(axis=0).tolist(),
        "mesh": _mesh_path(item),
    }


def load_prediction(path: str | Path) -> Prediction:
    """The prediction that `Prediction.save` wrote.

    Raises:
        DataError: not such a folder, one of another version, or a file in it is missing or broken.
    """
    folder = Path(path)
    try:
        result = json.loads((folder / RESULT_FILE).read_text())
        given = result.get("format") if isinstance(result, dict) else None
        if given != FORMAT:
            raise DataError(f"{folder / RESULT_FILE} is not of the format {FORMAT!r} but {given!r}: predict again")
        with np.load(folder / CLOUD_FILE) as saved:
            cloud_file = dict(saved)
        with np.load(folder / GRASPS_FILE) as saved:
            grasp_file = dict(saved)
        return _assemble(folder, result, cloud_file, grasp_file)
    except IcgnetError:
        raise
    except Exception as error:  # there is no end to what a broken file can raise
        raise DataError(f"{folder} is not a saved prediction: {type(error).__name__} {error}") from error


def _assemble(
    folder: Path, result: dict[str, Any], cloud_file: dict[str, np.ndarray], grasp_file: dict[str, np.ndarray]
) -> Prediction:
    viewpoint = cloud_file["viewpoint"]
    points = cloud_file["points"].astype(np.float64)
    instances = cloud_file["instance_id"].astype(np.int64)
    objects = [
        DetectedObject(
            instance_id=entry["instance_id"],
            score=entry["score"],
            class_name=entry["class_name"],
            class_score=entry["class_score"],
            points=points[instances == entry["instance_id"]],
            extract=_MeshFile(folder / entry["mesh"]),
        )
        for entry in result["objects"]
    ]
    return Prediction(
        objects=tuple(objects),
        grasps=Grasps(
            poses=grasp_file["grasps"],
            widths=grasp_file["width"],
            openings=grasp_file["opening"],
            scores=grasp_file["score"],
            instances=grasp_file["instance_id"],
            contacts=grasp_file["contact"],
            angles=grasp_file["angle"],
        ),
        frame_id=result["frame_id"],
        rejected=result["rejected"],
        timings_ms=result["timings_ms"],
        cloud=PointCloud(points, None if np.isnan(viewpoint).any() else viewpoint, result["frame_id"]),
        cloud_instances=instances,
        T_frame_table=np.array(result["T_frame_table"]),
        gripper=Gripper.from_dict(result["gripper"]),
        classes=check_class_list(result["classes"]),
        input_rows=cloud_file["input_row"].astype(np.int64),
        input_shape=tuple(int(size) for size in cloud_file["input_shape"]),
    )


@dataclass(frozen=True)
class _MeshFile:
    path: Path

    def __call__(self) -> trimesh.Trimesh:
        try:
            mesh = trimesh.load_mesh(self.path, process=False)
        except Exception as error:
            raise DataError(f"cannot read the mesh {self.path}: {error}") from error
        return mesh
