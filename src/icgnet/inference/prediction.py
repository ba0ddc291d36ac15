"""What the predictor found in a scene, and how it is written to a folder and read back."""

import json
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float, Int
from PIL import Image

from icgnet.errors import DataError, InputError
from icgnet.geometry.arrays import described, real_array, real_number
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import check_transform
from icgnet.grasping import selection
from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.inference.rejections import REASONS, Rejections
from icgnet.objects.classes import check_class_list, class_index
from icgnet.output_folder import output_folder

FORMAT = "icgnet prediction 4"
RESULT_FILE = "result.json"
GRASPS_FILE = "grasps.npz"
REJECTED_FILE = "rejected.npz"
CLOUD_FILE = "cloud.npz"
MASK_FILE = "mask.png"
PICTURE_FILE = "picture.png"
MESH_FOLDER = "meshes"
LARGEST_SIDE = 10**8
"""No input has more points or pixels."""
LARGEST_COUNT = 1e12
"""No search drops more grasps."""

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

    def __getstate__(self) -> dict[str, Any]:
        """Everything with the mesh itself in place of the network that makes it: so objects can be pickled."""
        return self.__dict__ | {"extract": _KnownMesh(self.mesh())}


@dataclass(frozen=True)
class SupportPlane:
    """A plane that may carry the objects, in the frame of the prediction.

    Attributes:
        normal: unit vector, upwards or towards the camera.
        height: of the plane above the origin of the frame, along the normal [m].
        share: of all measured points that lie on it.
        area: that is seen of it [m^2].
        tilt_deg: angle of the normal against the z axis of the world or, in the camera's frame, against the direction
            towards the camera [degrees].
    """

    normal: tuple[float, ...]
    height: float
    share: float
    area: float
    tilt_deg: float


@dataclass(frozen=True, eq=False)
class Prediction:
    """Everything found in one scene. Coordinates are in the frame `frame_id`, in metres.

    Attributes:
        objects: the objects, numbered from 0.
        grasps: collision-free grasps, best first.
        frame_id: "world", or what the caller calls it, when the camera's pose (of a cloud: its viewpoint) or the
            table's height was given, else "camera".
        rejected: how many candidate grasps were dropped, by reason.
        timings_ms: time per stage [ms].
        cloud: the measured points, and the viewpoint if it is known.
        cloud_instances: instance id of every point of `cloud`, `NO_INSTANCE` for none.
        T_frame_table: pose of the table frame: z up, table plane at z = 0.05 m.
        gripper: the hand that the grasps are for.
        classes: names of all classes that the weights know.
        input_rows: where each point of `cloud` stands in the flattened input.
        input_shape: shape of the input, (n,) for a cloud and (h, w) for a depth image.
        left_out: how many points and objects were not looked at, because there were too many (as in noise) or because
            the time was up, and how many things were taken for a part of the table or of what encloses it.
        supports: the plane that was taken for the table, then others for which nearly as much speaks; none if the
            height of the table was given.
        warnings: what the caller should know about this result, one sentence each.
        rejections: the same as `rejected` for each object, and the best grasps that were dropped; empty if unknown.
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
    left_out: dict[str, int] = field(default_factory=dict)
    supports: tuple[SupportPlane, ...] = ()
    warnings: tuple[str, ...] = ()
    rejections: Rejections = field(default_factory=Rejections.empty)

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
        return self._with_grasps(selection.of_instances(self.grasps, [instance_id]))

    def of_class(self, class_name: str) -> "Prediction":
        """The same prediction with the grasps of the objects of one class only.

        Raises:
            InputError: the class is not one of `classes`.
        """
        class_index(class_name, self.classes)
        instance_classes = {item.instance_id: item.class_name for item in self.objects}
        return self._with_grasps(selection.of_class(self.grasps, class_name, instance_classes))

    def in_region(self, lower: Any, upper: Any) -> "Prediction":
        """The same prediction with the grasps in a box only, its corners [3] in the frame of the prediction [m].

        Raises:
            InputError: no three numbers each, NaN, or a lower coordinate that is above the upper one.
        """
        corners = [real_array(corner, "corner of the region", (3,), finite=False) for corner in (lower, upper)]
        if np.isnan(corners).any():
            raise InputError(f"corners of the region must be numbers, got {lower} and {upper}")
        return self._with_grasps(selection.in_region(self.grasps, *corners))

    def _with_grasps(self, chosen: Grasps) -> "Prediction":
        """The same with some of the grasps: nothing that was dropped explains why an object has none of these."""
        lost = np.setdiff1d(self.grasps.instances, chosen.instances)
        return replace(self, grasps=chosen, rejections=self.rejections.without(lost))

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

    def to_dict(self, meshes: bool = False) -> dict[str, Any]:
        """The prediction without clouds and meshes as plain values, for JSON.

        Args:
            meshes: whether to name the files that `write` puts the meshes into.
        """
        return {
            "format": FORMAT,
            "frame_id": self.frame_id,
            "T_frame_table": self.T_frame_table.tolist(),
            "gripper": self.gripper.to_dict(),
            "classes": list(self.classes),
            "objects": [
                _object_entry(item, self.rejections.of_object(item.instance_id), meshes) for item in self.objects
            ],
            "grasps": list(self._grasp_entries()),
            "rejected": self.rejected,
            "left_out": self.left_out,
            "supports": [asdict(plane) for plane in self.supports],
            "warnings": list(self.warnings),
            "timings_ms": {stage: round(time, 3) for stage, time in self.timings_ms.items()},
        }

    def write(self, folder: Path) -> None:
        """Writes result.json, grasps.npz, rejected.npz, cloud.npz, meshes/ and, for a depth image, mask.png."""
        meshes = folder / MESH_FOLDER
        meshes.mkdir()
        for item in self.objects:
            item.mesh().export(folder / _mesh_path(item))
        np.savez_compressed(folder / GRASPS_FILE, **self._grasp_arrays(self.grasps))
        dropped = self.rejections
        reasons = np.array([REASONS[reason] for reason in dropped.reasons], dtype=np.str_)
        np.savez_compressed(folder / REJECTED_FILE, **self._grasp_arrays(dropped.grasps), reason=reasons)
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
        (folder / RESULT_FILE).write_text(json.dumps(self.to_dict(meshes=True), indent=1) + "\n")

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

    @staticmethod
    def load(path: str | Path) -> "Prediction":
        """The prediction that `save` wrote.

        Raises:
            DataError: not such a folder, one of another version, or a file in it is missing, broken or edited to
                something that no prediction holds.
        """
        folder = Path(path)
        try:
            result = json.loads((folder / RESULT_FILE).read_text())
            given = result.get("format") if isinstance(result, dict) else None
            if given != FORMAT:
                raise DataError(
                    f"{folder / RESULT_FILE} is not of the format {FORMAT!r} but {described(given)}: predict again"
                )
            with np.load(folder / CLOUD_FILE) as saved:
                cloud_file = dict(saved)
            with np.load(folder / GRASPS_FILE) as saved:
                grasp_file = dict(saved)
            rejected_file = None
            if (folder / REJECTED_FILE).exists():  # older versions wrote none
                with np.load(folder / REJECTED_FILE) as saved:
                    rejected_file = dict(saved)
            return _assemble(folder, result, cloud_file, grasp_file, rejected_file)
        except DataError:
            raise
        except Exception as error:  # there is no end to what a broken file can raise
            reason = " ".join(str(error).split())[:300]
            raise DataError(f"{folder} is not a saved prediction: {type(error).__name__} {reason}") from error

    def _grasp_arrays(self, grasps: Grasps) -> dict[str, Any]:
        return {
            "grasps": grasps.poses,
            "width": grasps.widths,
            "opening": grasps.openings,
            "score": grasps.scores,
            "instance_id": grasps.instances,
            "class_name": np.array([self.class_of(int(i)) for i in grasps.instances], dtype=np.str_),
            "contact": grasps.contacts,
            "angle": grasps.angles,
            "frame_id": self.frame_id,
        }

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
    class_name = re.sub(r"[^A-Za-z0-9_-]", "_", item.class_name)
    return f"{MESH_FOLDER}/{item.instance_id:02d}_{class_name[:60]}.ply"


def _object_entry(item: DetectedObject, rejected: dict[str, int], mesh: bool) -> dict[str, Any]:
    return {
        "instance_id": item.instance_id,
        "score": float(item.score),
        "class_name": item.class_name,
        "class_score": float(item.class_score),
        "points": len(item.points),
        "lower": item.points.min(axis=0).tolist(),
        "upper": item.points.max(axis=0).tolist(),
        **({"rejected": rejected} if rejected else {}),
        **({"mesh": _mesh_path(item)} if mesh else {}),
    }


def _assemble(
    folder: Path,
    result: dict[str, Any],
    cloud_file: dict[str, np.ndarray],
    grasp_file: dict[str, np.ndarray],
    rejected_file: dict[str, np.ndarray] | None,
) -> Prediction:
    """The prediction of files whose content may be anything; every value is checked.

    Raises:
        IcgnetError, KeyError, TypeError, ValueError: a value is missing, or none that a prediction holds.
    """
    frame_id, objects = result["frame_id"], result["objects"]
    _require(isinstance(frame_id, str) and frame_id, "frame_id", frame_id)
    _require(isinstance(objects, list), "objects", objects)
    points = real_array(cloud_file["points"], "points", (None, 3))
    shape = tuple(_whole(cloud_file["input_shape"], "input_shape", (None,), 1, LARGEST_SIDE).tolist())
    _require(len(shape) in (1, 2) and math.prod(shape) <= LARGEST_SIDE, "input_shape", shape)
    rows = _whole(cloud_file["input_row"], "input_row", (len(points),), 0, math.prod(shape) - 1)
    instances = _whole(cloud_file["instance_id"], "instance_id", (len(points),), NO_INSTANCE, len(objects) - 1)
    viewpoint = real_array(cloud_file["viewpoint"], "viewpoint", (3,), finite=False)
    _require(np.isfinite(viewpoint).all() or np.isnan(viewpoint).all(), "viewpoint", viewpoint.tolist())
    return Prediction(
        objects=tuple(
            _object(folder, entry, number, result["classes"], points[instances == number])
            for number, entry in enumerate(objects)
        ),
        grasps=_grasps(grasp_file, len(objects)),
        frame_id=frame_id,
        rejected={name: int(_number(count, name, 0.0, math.inf)) for name, count in result["rejected"].items()},
        timings_ms={name: _number(time, name, 0.0, math.inf) for name, time in result["timings_ms"].items()},
        cloud=PointCloud(points, None if np.isnan(viewpoint).any() else viewpoint, frame_id),
        cloud_instances=instances,
        T_frame_table=check_transform(result["T_frame_table"], "T_frame_table"),
        gripper=Gripper.from_dict(result["gripper"]),
        classes=check_class_list(result["classes"]),
        input_rows=rows,
        input_shape=shape,
        left_out={name: int(_number(count, name, 0.0, math.inf)) for name, count in result["left_out"].items()},
        supports=tuple(map(_support_plane, result["supports"])),
        warnings=_texts(result["warnings"], "warnings"),
        rejections=Rejections.empty() if rejected_file is None else _rejections(rejected_file, objects),
    )


def _support_plane(entry: dict[str, Any]) -> SupportPlane:
    normal = tuple(real_array(entry["normal"], "normal", (3,)).tolist())
    return SupportPlane(
        normal=normal,
        height=_number(entry["height"], "height", -math.inf, math.inf),
        share=_number(entry["share"], "share", 0.0, 1.0),
        area=_number(entry["area"], "area", 0.0, math.inf),
        tilt_deg=_number(entry["tilt_deg"], "tilt_deg", 0.0, 180.0),
    )


def _texts(values: Any, name: str) -> tuple[str, ...]:
    _require(isinstance(values, list) and all(isinstance(each, str) for each in values), name, values)
    return tuple(values)


def _object(
    folder: Path, entry: dict[str, Any], number: int, classes: list[str], points: Float[np.ndarray, "n 3"]
) -> DetectedObject:
    _require(entry["instance_id"] == number, f"instance_id of object {number}", entry["instance_id"])
    _require(entry["class_name"] in classes, f"class_name of object {number}", entry["class_name"])
    _require(len(points) > 0, f"points of object {number}", "none")
    mesh = folder / entry["mesh"]
    _require(mesh.resolve().is_relative_to(folder.resolve()), f"mesh of object {number} (outside of the folder)", mesh)
    return DetectedObject(
        instance_id=number,
        score=_number(entry["score"], "score", 0.0, 1.0),
        class_name=entry["class_name"],
        class_score=_number(entry["class_score"], "class_score", 0.0, 1.0),
        points=points,
        extract=_MeshFile(mesh),
    )


def _rejections(saved: dict[str, np.ndarray], objects: list[dict[str, Any]]) -> Rejections:
    """Counts stand with the objects, of whose entries all have some or none."""
    known = [entry["rejected"] for entry in objects if "rejected" in entry]
    _require(len(known) in (0, len(objects)), "rejected of the objects", f"known of {len(known)} only")
    grasps = _grasps(saved, len(objects))
    names = np.asarray(saved["reason"])
    _require(names.shape == (len(grasps),) and np.isin(names, REASONS).all(), "reason", names.tolist())
    counts = [[int(_number(entry[name], name, 0.0, LARGEST_COUNT)) for name in REASONS] for entry in known]
    return Rejections(
        counts=np.array(counts, dtype=np.int64).reshape(-1, len(REASONS)),
        grasps=grasps,
        reasons=np.array([REASONS.index(name) for name in names.tolist()], dtype=np.int64),
    )


def _grasps(saved: dict[str, np.ndarray], objects: int) -> Grasps:
    poses = real_array(saved["grasps"], "grasps", (None, 4, 4))
    count = len(poses)
    for pose in poses:
        check_transform(pose, "grasps")
    return Grasps(
        poses=poses,
        widths=_within(saved["width"], "width", count, math.inf),
        openings=_within(saved["opening"], "opening", count, math.inf),
        scores=_within(saved["score"], "score", count, 1.0),
        instances=_whole(saved["instance_id"], "instance_id", (count,), 0, objects - 1),
        contacts=real_array(saved["contact"], "contact", (count, 3)),
        angles=_whole(saved["angle"], "angle", (count,), 0, len(APPROACH_ANGLES) - 1),
    )


def _within(value: Any, name: str, count: int, most: float) -> Float[np.ndarray, "g"]:
    numbers = real_array(value, name, (count,))
    _require(((numbers >= 0) & (numbers <= most)).all(), name, f"numbers outside of 0 to {most:g}")
    return numbers


def _whole(value: Any, name: str, shape: tuple[int | None, ...], least: int, most: int) -> Int[np.ndarray, "..."]:
    array = np.asarray(value)
    _require(array.dtype.kind in "iu", name, f"values of type {array.dtype.name}")
    numbers = real_array(array, name, shape).astype(np.int64)
    _require(((numbers >= least) & (numbers <= most)).all(), name, f"numbers outside of {least} to {most}")
    return numbers


def _number(value: Any, name: str, least: float, most: float) -> float:
    number = real_number(value, name, "", math.inf)
    _require(least <= number <= most, name, value)
    return number


def _require(holds: Any, name: str, value: Any) -> None:
    """Raises ValueError unless a condition on a saved value holds."""
    if not holds:
        raise ValueError(f"{name} cannot be {described(value)}")


@dataclass(frozen=True)
class _MeshFile:
    path: Path

    def __call__(self) -> trimesh.Trimesh:
        try:
            mesh = trimesh.load_mesh(self.path, process=False)
        except Exception as error:
            raise DataError(f"cannot read the mesh {self.path}: {error}") from error
        return mesh


@dataclass(frozen=True, eq=False)
class _KnownMesh:
    mesh: trimesh.Trimesh

    def __call__(self) -> trimesh.Trimesh:
        return self.mesh
