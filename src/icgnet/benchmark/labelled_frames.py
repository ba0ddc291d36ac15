"""Real frames with labels, as the user keeps them in a folder (docs/guides/real_captures.md has the formats)."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

from icgnet.errors import DataError, IcgnetError, InputError
from icgnet.geometry.camera import check_depth, check_intrinsics, metric_depth
from icgnet.geometry.transforms import check_pose
from icgnet.inference.capture import DepthCapture, read_capture

DEPTH, ARRAYS = "_depth.png", ".npz"
CAMERA_FILE, SUBSETS_FILE = "camera.json", "subsets.json"
COLOURS = ("_color.jpg", "_color.png")


@dataclass(frozen=True)
class FramePath:
    """Where a frame lies.

    Attributes:
        depth: its depth image, or its npz.
        name: path below the folder that was asked for, without what all frames end with.
    """

    depth: Path
    name: str

    def beside(self, ending: str) -> Path:
        """The file that belongs to the frame and ends so."""
        return self.depth.with_name(Path(self.name).name + ending)


@dataclass(frozen=True, eq=False)
class ClickedObject:
    """An object that somebody clicked on.

    Attributes:
        clicks: pixels (u, v) on it.
        class_name: its class, which the weights need not know; None if it was not said.
        graspable: whether the hand could take it; False if it was not said.
    """

    clicks: Int[np.ndarray, "n 2"]
    class_name: str | None
    graspable: bool


@dataclass(frozen=True, eq=False)
class Clicks:
    """What somebody clicked on in a frame.

    Attributes:
        objects: at least one.
        support: pixels (u, v) on what carries the objects.
        background: pixels (u, v) on what is neither object nor support.
        uncertain: whether there may be objects that nobody clicked on.
    """

    objects: tuple[ClickedObject, ...]
    support: Int[np.ndarray, "n 2"]
    background: Int[np.ndarray, "m 2"]
    uncertain: bool


@dataclass(frozen=True, eq=False)
class LabelledFrame:
    """A depth image, and labels or clicks.

    Attributes:
        name: see `FramePath`.
        subset: what it is counted with.
        depth: distance along the camera's z axis [m], NaN where nothing was measured.
        intrinsics: camera matrix [pixels].
        camera_pose: T_world_camera, or None when it is not known.
        labels: object of each pixel from 1 on without gaps, 0 for none; None if there are clicks.
        clicks: None if there are labels.
        colour: the colour image in the size of the depth image, if there is one.
        camera: name of the camera, if it was said.
    """

    name: str
    subset: str
    depth: Float[np.ndarray, "h w"]
    intrinsics: Float[np.ndarray, "3 3"]
    camera_pose: Float[np.ndarray, "4 4"] | None = None
    labels: Int[np.ndarray, "h w"] | None = None
    clicks: Clicks | None = None
    colour: UInt8[np.ndarray, "h w 3"] | None = field(default=None, repr=False)
    camera: str | None = None


def find_frames(folder: Path) -> list[FramePath]:
    """All frames in a folder and in the folders inside of it.

    Raises:
        InputError: no such folder.
        DataError: it holds no frame.
    """
    if not folder.is_dir():
        raise InputError(f"no such folder: {folder}")
    paths = sorted([*folder.rglob("*" + DEPTH), *folder.rglob("*" + ARRAYS)])
    if not paths:
        raise DataError(f"{folder}: no frame here or in the folders inside: a frame is NAME{DEPTH} or NAME{ARRAYS}")
    names = [path.relative_to(folder).as_posix().removesuffix(DEPTH).removesuffix(ARRAYS) for path in paths]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise DataError(f"{folder / twice}: there is {DEPTH} and {ARRAYS}: keep one of them")
    return [FramePath(path, name) for path, name in zip(paths, names, strict=True)]


def read_frame(path: FramePath, pose: bool = True) -> LabelledFrame:
    """One frame, checked.

    Args:
        path: where it lies.
        pose: whether the camera's pose is given where it is known.

    Raises:
        DataError: a file is missing, cannot be read, or does not fit the others; the message names it.
    """
    camera = {**_read_json(path.depth.with_name(CAMERA_FILE)), **_read_json(path.beside(".json"))}
    try:
        capture = _read_capture(path, camera)
        depth = check_depth(capture.depth)
    except IcgnetError as error:
        raise DataError(f"{path.depth}: {error}") from error
    labels, clicks = path.beside("_labels.png"), path.beside("_clicks.json")
    if labels.is_file() == clicks.is_file():
        found = "both" if labels.is_file() else "neither"
        raise DataError(f"{path.depth}: a frame needs {labels.name} or {clicks.name}, and has {found}")
    colour = next((each for each in map(path.beside, COLOURS) if each.is_file()), None)
    return LabelledFrame(
        path.name,
        _subset(path, camera),
        depth,
        capture.intrinsics,
        capture.camera_pose if pose else None,
        _read_labels(labels, depth.shape) if labels.is_file() else None,
        _read_clicks(clicks, depth.shape) if clicks.is_file() else None,
        None if colour is None else _read_image(colour, "RGB", depth.shape),
        None if camera.get("camera") is None else str(camera["camera"]),
    )


def _read_capture(path: FramePath, camera: Mapping[str, Any]) -> DepthCapture:
    scale = camera.get("depth_scale", 1.0 if path.depth.suffix == ARRAYS else None)
    if isinstance(scale, bool) or not isinstance(scale, int | float):
        raise DataError(
            f"{path.beside('.json').name} or {CAMERA_FILE} must give depth_scale, the units per metre (1000 for mm), "
            f"got {scale!r}"
        )
    if path.depth.suffix == ARRAYS:
        capture = read_capture(path.depth, depth_scale=float(scale))
        if not isinstance(capture, DepthCapture):
            raise DataError("it is a cloud: a frame needs 'depth' [m] and 'K'")
        return capture
    if "K" not in camera:
        raise DataError(f"{path.beside('.json').name} or {CAMERA_FILE} must give K, the camera matrix")
    matrix, pose = camera["K"], camera.get("T_world_camera")
    if isinstance(matrix, list) and len(matrix) == 9:
        matrix = [matrix[:3], matrix[3:6], matrix[6:]]
    return DepthCapture(
        metric_depth(_read_image(path.depth), float(scale)),
        check_intrinsics(matrix),
        None if pose is None else check_pose(pose, "T_world_camera"),
    )


def _subset(path: FramePath, camera: Mapping[str, Any]) -> str:
    """The name in the frame's own file, else the first whose patterns fit, else that of the folder."""
    subset = camera.get("subset")
    file = path.depth.with_name(SUBSETS_FILE)
    for name, patterns in () if subset else _read_json(file).items():
        if not isinstance(patterns, list) or not all(isinstance(each, str) for each in patterns):
            raise DataError(
                f"{file}: {name!r} must be a list of patterns of names, such as ['bin_*'], got {patterns!r}"
            )
        if any(fnmatchcase(Path(path.name).name, each) for each in patterns):
            return name
    return str(subset or path.depth.absolute().parent.name)


def _read_json(path: Path) -> dict[str, Any]:
    """The entries of a file; none if there is no such file."""
    if not path.is_file():
        return {}
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError, RecursionError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    if not isinstance(content, dict):
        raise DataError(f"{path}: must hold names with values ({{...}}), got {type(content).__name__}")
    return content


def _read_image(path: Path, mode: str | None = None, shape: tuple[int, ...] | None = None) -> np.ndarray:
    """The values of an image, if need be converted to a mode and to another height and width."""
    try:
        with Image.open(path) as image:
            converted = image if mode is None else image.convert(mode)
            return np.array(converted if shape is None else converted.resize((shape[1], shape[0])))
    except Exception as error:  # there is no end to what a broken image can raise
        raise DataError(f"{path}: cannot be read: {' '.join(str(error).split())[:300]}") from error


def _read_labels(path: Path, shape: tuple[int, ...]) -> Int[np.ndarray, "h w"]:
    labels = _read_image(path)
    if labels.shape != shape:
        wanted = f"one channel of {shape[0]} x {shape[1]} pixels, as the depth image has"
        raise DataError(f"{path}: labels must have {wanted}, got shape {labels.shape}")
    values = np.unique(labels[labels > 0])
    if not len(values):
        raise DataError(f"{path}: labels no object: pixels of objects are 1, 2, ..., all others 0")
    return np.searchsorted(values, labels, side="right").astype(np.int64)


def _read_clicks(path: Path, shape: tuple[int, ...]) -> Clicks:
    content = _read_json(path)
    objects = content.get("objects")
    if not isinstance(objects, list) or not objects:
        raise DataError(f"{path}: objects must be a list of at least one object, got {objects!r}")
    return Clicks(
        tuple(_clicked(path, number, each, shape) for number, each in enumerate(objects)),
        _pixels(path, "support", content.get("support", []), shape),
        _pixels(path, "background", content.get("background", []), shape),
        bool(content.get("uncertain", False)),
    )


def _clicked(path: Path, number: int, entry: Any, shape: tuple[int, ...]) -> ClickedObject:
    name = f"object {number}"
    if not isinstance(entry, dict) or not entry.get("clicks"):
        raise DataError(f"{path}: {name} must have clicks, a list of pixels [u, v], got {repr(entry)[:80]}")
    class_name, graspable = entry.get("class"), entry.get("graspable") or False
    if not isinstance(class_name, str | None):
        raise DataError(f"{path}: the class of {name} must be a text, got {class_name!r}")
    if not isinstance(graspable, bool):
        raise DataError(f"{path}: graspable of {name} must be true or false, got {graspable!r}")
    return ClickedObject(_pixels(path, name, entry["clicks"], shape), class_name, graspable)


def _pixels(path: Path, name: str, entry: Any, shape: tuple[int, ...]) -> Int[np.ndarray, "n 2"]:
    pixels = entry if isinstance(entry, list) else [entry]
    wrong = next((pixel for pixel in pixels if not _is_inside(pixel, shape)), None)
    if wrong is not None or pixels is not entry:
        raise DataError(
            f"{path}: clicks of {name} must be pixels [u, v] from [0, 0] to [{shape[1] - 1}, {shape[0] - 1}], "
            f"got {repr(wrong or entry)[:80]}"
        )
    return np.round(np.array(pixels, dtype=np.float64)).astype(np.int64).reshape(-1, 2)


def _is_inside(pixel: Any, shape: tuple[int, ...]) -> bool:
    """Whether this is a pixel (u, v) of an image of this height and width."""
    if not isinstance(pixel, list) or len(pixel) != 2:
        return False
    if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in pixel):
        return False
    return 0 <= pixel[0] <= shape[1] - 1 and 0 <= pixel[1] <= shape[0] - 1
