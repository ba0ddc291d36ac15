"""Depth images, clouds and calibrations from the files that cameras and other programs leave behind."""

import json
import re
import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import scipy.io
import trimesh
import yaml
from jaxtyping import Bool, Float, Real
from PIL import Image

from icgnet.errors import DataError, InputError
from icgnet.geometry.arrays import position, real_array
from icgnet.geometry.camera import check_intrinsics, metric_depth
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import ROS_NAMES, check_pose

IMAGE_SUFFIXES = (".png", ".tif", ".tiff")
TEXT_SUFFIXES = (".xyz", ".txt", ".csv")
SUFFIXES = (*IMAGE_SUFFIXES, ".npz", ".npy", ".ply", *TEXT_SUFFIXES)
CALIBRATION_SUFFIXES = (".json", ".yaml", ".yml", ".npz", ".mat")

LONGEST_REASON = 300
"""So many characters of what a parser says are repeated in a message."""

PLY_HEADER = 65536
"""The header of a PLY file is not longer than this [bytes]."""

POINT_KEYS = ("points", "xyz", "pc", "cloud")
INTRINSICS_KEYS = ("K", "k", "intrinsics", "intrinsic_matrix", "camera_matrix")
DISTORTION_KEYS = ("D", "d", "dist", "distortion", "dist_coeffs", "distortion_coefficients")
DISTORTION_MODELS = ("plumb_bob", "rational_polynomial")
"""Models of ROS whose coefficients are in the order of OpenCV."""
POSE_KEYS = ("camera_pose", "T_world_camera", "T_base_camera", "pose", "transform")
FOCAL_KEYS = (("fx", "fy", "cx", "cy"), ("fx", "fy", "ppx", "ppy"))


@dataclass(frozen=True, eq=False)
class DepthCapture:
    """A depth image and how the camera stood.

    Attributes:
        depth: distance along the camera's z axis [m]; 0 or NaN where nothing was measured.
        intrinsics: camera matrix [pixels].
        camera_pose: T_world_camera, or None when it is not known.
    """

    depth: Real[np.ndarray, "h w"]
    intrinsics: Float[np.ndarray, "3 3"]
    camera_pose: Float[np.ndarray, "4 4"] | None = None


def read_capture(
    path: Path,
    intrinsics: Sequence[str] = (),
    depth_scale: float = 1.0,
    camera_pose: Sequence[str] = (),
    viewpoint: Sequence[float] | None = None,
) -> DepthCapture | PointCloud:
    """A depth capture or a cloud, whichever the file holds.

    Args:
        path: depth image (png, tif, npy), npz with `depth` and `K`, or cloud (ply, npy, npz, xyz).
        intrinsics: four numbers fx fy cx cy, or the name of a file with the camera matrix; needed for a depth image
            unless the npz has it.
        depth_scale: stored depth units per metre.
        camera_pose: T_world_camera as numbers or the name of a file with it, see `read_camera_pose`; it goes before
            one in the npz.
        viewpoint: where the camera stood, in the frame of the cloud [m].

    Raises:
        InputError: no such file, a kind that is not known, or options that do not fit.
        DataError: the file cannot be read.
    """
    if not _is_file(path):
        raise InputError(f"no such input file: {str(path)[:LONGEST_REASON]}")
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"unknown kind of input {path.name!r}; known are {', '.join(SUFFIXES)}")
    content = _named(path, _read_arrays(path))
    if "depth" in content:
        return _depth_capture(path, content, intrinsics, depth_scale, camera_pose, viewpoint)
    if intrinsics or camera_pose:
        raise InputError(f"{path} is a cloud: --intrinsics and --camera-pose are for depth images, give --viewpoint")
    points = real_array(content["points"], f"points in {path}", (None, 3), finite=False)
    eye = content.get("viewpoint") if viewpoint is None else viewpoint
    return PointCloud(points, None if eye is None else position(eye, "viewpoint"), "cloud")


def read_mask(path: Path) -> Bool[np.ndarray, "h w"]:
    """Which pixels of an image are not 0.

    Raises:
        InputError: no such file, or an image with several channels.
        DataError: the file cannot be read.
    """
    if path.suffix.lower() not in IMAGE_SUFFIXES:
        raise InputError(f"unknown kind of mask {path.name!r}; known are {', '.join(IMAGE_SUFFIXES)}")
    mask = _read_arrays(path)["depth"]
    if mask.ndim != 2:
        raise InputError(f"mask {path} must have one channel, got shape {mask.shape}")
    return mask != 0


def read_intrinsics(source: Sequence[str]) -> Float[np.ndarray, "3 3"]:
    """The camera matrix [pixels] from four numbers fx fy cx cy or from a file.

    Files are JSON, YAML, npz or mat with a matrix under K, intrinsics, intrinsic_matrix or camera_matrix (also the
    forms of ROS and Open3D), or with fx, fy, cx, cy.

    Raises:
        InputError: neither of both, or not a camera matrix.
        DataError: the file cannot be read or holds no camera matrix.
    """
    if len(source) == 1:
        return _find_intrinsics(_read_calibration(Path(source[0])), source[0])
    numbers = _numbers(source, 4, "--intrinsics takes fx fy cx cy or one file")
    return _pinhole(numbers)


def read_distortion(source: Sequence[str]) -> Float[np.ndarray, "d"]:
    """Distortion coefficients k1 k2 p1 p2 ... from numbers or from a file; none if a file has none.

    Files are those of `read_intrinsics`, with a list under D, dist, distortion, dist_coeffs or distortion_coefficients.

    Raises:
        InputError: no numbers, or the coefficients of another model of a lens, such as a fisheye.
        DataError: the file cannot be read.
    """
    try:
        return np.array([float(value) for value in source])
    except ValueError:
        pass
    if len(source) != 1:
        raise InputError(f"distortion must be numbers k1 k2 p1 p2 ... or one file, got {reprlib.repr(list(source))}")
    content = _read_calibration(Path(source[0]))
    model = str(content.get("distortion_model", DISTORTION_MODELS[0]))
    if model not in DISTORTION_MODELS:
        raise InputError(f"{source[0]}: distortion_model must be {' or '.join(DISTORTION_MODELS)}, got {model[:40]!r}")
    entry = next((content[key] for key in DISTORTION_KEYS if key in content), ())
    return real_array(
        np.ravel(entry["data"] if isinstance(entry, dict) else entry), f"distortion in {source[0]}", (None,)
    )


def read_camera_pose(source: Sequence[str]) -> Float[np.ndarray, "4 4"]:
    """T_world_camera from 16 numbers, row by row, from 7, x y z [m] qw qx qy qz, or from a file with either.

    Files are npy, txt, JSON, YAML, npz or mat, with the pose alone or under one of `POSE_KEYS`; JSON and YAML may name
    position and orientation as ROS does (see `check_pose`).

    Raises:
        InputError: none of these, not a rigid right-handed transform, or not in metres.
        DataError: the file cannot be read or holds no pose.
    """
    if len(source) != 1:
        usage = "--camera-pose takes 16 numbers (T_world_camera row by row), 7 (x y z qw qx qy qz) or one file"
        numbers = _numbers(source, 7 if len(source) == 7 else 16, usage)
        return check_pose(numbers if len(numbers) == 7 else numbers.reshape(4, 4), "camera pose")
    path = Path(source[0])
    if path.suffix.lower() in (".npy", ".txt"):
        matrix = _read_arrays(path)["array"]
    else:
        content = _read_calibration(path)
        is_pose = any(position in content for position, _ in ROS_NAMES)
        matrix = content if is_pose else _find_pose(content)
    if matrix is None:
        raise DataError(f"{path} holds no camera pose under any of {', '.join(POSE_KEYS)}")
    return check_pose(matrix, f"camera pose in {path}")


def _find_pose(content: Mapping[str, Any]) -> Any:
    """The entry of a file that is the camera's pose, if there is one."""
    return next((content[key] for key in POSE_KEYS if key in content), content.get("matrix"))


def _depth_capture(
    path: Path,
    content: Mapping[str, np.ndarray],
    intrinsics: Sequence[str],
    depth_scale: float,
    camera_pose: Sequence[str],
    viewpoint: Sequence[float] | None,
) -> DepthCapture:
    if viewpoint is not None:
        raise InputError(f"{path} is a depth image: --viewpoint is for clouds, give --camera-pose")
    if intrinsics:
        matrix = read_intrinsics(intrinsics)
    elif any(key in content for key in INTRINSICS_KEYS):
        matrix = _find_intrinsics(content, str(path))
    else:
        raise InputError(f"{path} is a depth image without camera matrix: give --intrinsics fx fy cx cy or a file")
    stored = next((key for key in POSE_KEYS if key in content), None)
    pose = None
    if camera_pose:
        pose = read_camera_pose(camera_pose)
    elif stored is not None:
        pose = check_pose(content[stored], f"{stored} in {path}")
    depth = real_array(content["depth"], f"depth in {path}", (None, None), finite=False)
    return DepthCapture(metric_depth(depth, depth_scale), matrix, pose)


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an input file under their names; `depth` for an image, `array` where the file has no names."""
    suffix = path.suffix.lower()
    if not _is_file(path):
        raise InputError(f"no such file: {str(path)[:LONGEST_REASON]}")
    try:
        if suffix in IMAGE_SUFFIXES:
            with Image.open(path) as image:
                return {"depth": np.asarray(image)}
        if suffix == ".npz":
            return _read_npz(path)
        if suffix == ".ply":
            return {"points": _read_ply(path)}
        if suffix == ".npy":
            return {"array": _read_npy(path)}
        return {"array": np.loadtxt(path, delimiter="," if suffix == ".csv" else None, ndmin=2)}
    except Exception as error:  # there is no end to what the parsers raise on a broken or foreign file
        raise DataError(f"cannot read {path}: {_first_line(error)}") from error


def _named(path: Path, content: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays with the image under `depth` or the cloud under `points`, whatever they were called."""
    if "depth" in content or "points" in content:
        return content
    if "array" not in content:
        key = next((key for key in POINT_KEYS if key in content), None)
        if key is None:
            raise InputError(f"{path} has neither 'depth' nor {', '.join(POINT_KEYS)}; it has {sorted(content)}")
        return {**content, "points": content[key]}
    array = content["array"]
    if array.ndim == 2 and array.shape[1] > 10:
        return {"depth": array}
    if array.ndim == 3 and array.shape[2] == 3:
        array = array.reshape(-1, 3)
    if array.ndim != 2 or array.shape[1] < 3:
        raise InputError(f"{path} must hold points (n, 3) or depth (h, w), got shape {array.shape}")
    # Columns after the third are colours or normals.
    return {"points": array[:, :3]}


def _read_ply(path: Path) -> Float[np.ndarray, "n 3"]:
    content = trimesh.load(path, process=False)
    if not isinstance(content, trimesh.PointCloud | trimesh.Trimesh):
        raise ValueError("it has no vertices")
    vertices = np.asarray(content.vertices, dtype=np.float64)
    with path.open("rb") as file:
        announced = re.search(rb"element vertex (\d+)", file.read(PLY_HEADER))
    if announced and int(announced[1]) != len(vertices):
        raise ValueError(f"it announces {int(announced[1])} vertices and holds {len(vertices)}")
    return vertices


def _read_npy(path: Path) -> np.ndarray:
    content = np.load(path, allow_pickle=False)
    if not isinstance(content, np.ndarray):
        content.close()
        raise ValueError("it is an archive of arrays: call it .npz")
    return content


def _read_npz(path: Path) -> dict[str, np.ndarray]:
    with np.load(path, allow_pickle=False) as saved:
        return {key: saved[key] for key in saved.files}


def _read_calibration(path: Path) -> Mapping[str, Any]:
    """The entries of a calibration file; a file that is a bare matrix has it under `matrix`."""
    suffix = path.suffix.lower()
    if not _is_file(path):
        raise InputError(f"no such calibration file: {str(path)[:LONGEST_REASON]}")
    if suffix not in CALIBRATION_SUFFIXES:
        raise InputError(f"unknown kind of calibration {path.name!r}; known are {', '.join(CALIBRATION_SUFFIXES)}")
    try:
        if suffix == ".npz":
            return _read_npz(path)
        if suffix == ".mat":
            return scipy.io.loadmat(path)
        text = path.read_text()
        content = json.loads(text) if suffix == ".json" else _parse_yaml(text)
    except Exception as error:
        raise DataError(f"cannot read {path}: {_first_line(error)}") from error
    return content if isinstance(content, dict) else {"matrix": content}


def _parse_yaml(text: str) -> Any:
    """The content of a YAML text without aliases, by which a few bytes can mean gigabytes."""
    if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text, yaml.SafeLoader)):
        raise ValueError("aliases (*name) are not allowed here")
    return yaml.safe_load(text)


def _find_intrinsics(content: Mapping[str, Any], source: str) -> Float[np.ndarray, "3 3"]:
    for names in FOCAL_KEYS:
        if all(name in content for name in names):
            return _pinhole(_numbers([content[name] for name in names], 4, f"focal lengths in {source}"))
    entry = next((content[key] for key in INTRINSICS_KEYS if key in content), content.get("matrix"))
    if isinstance(entry, dict):
        entry = entry.get("data")
    if entry is None:
        raise DataError(f"{source} holds no camera matrix under any of {', '.join(INTRINSICS_KEYS)}, nor fx fy cx cy")
    try:
        matrix = np.asarray(entry, dtype=np.float64)
    except Exception as error:  # ragged, text, endless: there is no end to what a file can hold
        raise DataError(f"the camera matrix in {source} is not made of numbers") from error
    if matrix.shape == (9,):
        # Open3D writes columns, ROS rows: the row (0, 0, 1) is the last in both.
        matrix = matrix.reshape(3, 3) if matrix[6] == matrix[7] == 0 else matrix.reshape(3, 3).T
    return check_intrinsics(matrix)


def _pinhole(numbers: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    fx, fy, cx, cy = numbers
    return check_intrinsics(np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]))


def _numbers(values: Sequence[Any], count: int, usage: str) -> Float[np.ndarray, "count"]:
    try:
        numbers = np.array([float(value) for value in values])
    except (TypeError, ValueError) as error:
        raise InputError(f"{usage}, got {reprlib.repr(list(values))}") from error
    if len(numbers) != count:
        raise InputError(f"{usage}, got {len(numbers)} values: {reprlib.repr(list(values))}")
    return numbers


def _is_file(path: Path) -> bool:
    """Whether there is such a file; a name that the system cannot even look for is none."""
    try:
        return path.is_file()
    except OSError:
        return False


def _first_line(error: BaseException) -> str:
    line = (str(error).splitlines() or [type(error).__name__])[0]
    return line if len(line) <= LONGEST_REASON else line[:LONGEST_REASON] + "..."
