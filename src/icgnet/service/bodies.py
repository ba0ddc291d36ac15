"""Reads what a request sends: a PNG, an npz or JSON. Nothing of it is trusted, and no file is opened by its name."""

import base64
import binascii
import io
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from PIL import Image

from icgnet.errors import DataError, InputError
from icgnet.geometry.arrays import described, real_array, truth_array
from icgnet.geometry.camera import metric_depth
from icgnet.service.options import OPTIONS, Option, checked_options

PNG, NPZ, JSON = "image/png", "application/x-npz", "application/json"
LARGEST_JSON = 8_000_000
"""Larger texts are refused: as objects they take up to twenty times their size [bytes]."""
MOST_ENTRIES = 64
"""An npz has no more files."""
LARGEST_ITEM = 16
"""No number of an array is longer [bytes]."""
LARGEST_OPTION = 64
"""Numbers in an array that is no image, mask or cloud."""
NPZ_OPTIONS = {"K": "intrinsics", "intrinsics": "intrinsics", "camera_pose": "camera_pose", "viewpoint": "viewpoint"}
"""What is read of an npz beside `depth`, `points` and `mask`, and the option that it gives."""


@dataclass(frozen=True, eq=False)
class Ask:
    """What one request asks.

    Attributes:
        depth: [h w] depth image [m], or None for a cloud.
        points: [n 3] cloud [m], or None for a depth image.
        mask: [h w] true where objects may be, or None.
        options: checked values of `icgnet.service.options.OPTIONS`, or of another table.
    """

    depth: np.ndarray | None
    points: np.ndarray | None
    mask: np.ndarray | None
    options: dict[str, Any]


def read_ask(
    kind: str, body: bytes, query: dict[str, Any], max_points: int, table: Mapping[str, Option] = OPTIONS
) -> Ask:
    """The content of a request.

    Args:
        kind: media type of the body: `PNG`, `NPZ` or `JSON`.
        body: its bytes.
        query: options of the query string; they take the place of those in the body.
        max_points: how many points or pixels are taken.
        table: the options that there are.

    Raises:
        InputError: values that are missing, unknown, of another kind or too many.
        DataError: the body is broken or of another kind than it says.
    """
    match kind:
        case "image/png":
            content: dict[str, Any] = {"depth": _read_png(body, "depth", max_points)}
        case "application/x-npz":
            content = _read_npz(body, max_points)
        case _:
            content = _read_json(body, max_points)
    depth, points, mask = (content.pop(name, None) for name in ("depth", "points", "mask"))
    options = checked_options({**content, **query}, table)
    if (depth is None) == (points is None):
        raise InputError("the body must hold either depth or points, got " + ("neither" if depth is None else "both"))
    if points is not None:
        _refuse(options, mask, "a cloud", "intrinsics", "depth_scale", "camera_pose", "level_table")
        cloud = real_array(points, "points", (None, 3), finite=False)
        if len(cloud) > max_points:
            raise InputError(f"points must be at most {max_points}, got {len(cloud)}")
        return Ask(None, cloud, None, options)
    _refuse(options, None, "a depth image", "viewpoint")
    if "intrinsics" not in options:
        raise InputError("a depth image needs intrinsics: fx,fy,cx,cy [pixels] or the 3 x 3 matrix")
    image = metric_depth(depth, options.get("depth_scale", 1.0))
    if image.size > max_points:
        raise InputError(f"depth must have at most {max_points} pixels, got {image.size}")
    return Ask(image, None, None if mask is None else truth_array(mask, "mask", image.shape), options)


def _refuse(options: dict[str, Any], mask: Any, what: str, *names: str) -> None:
    given = [name for name in names if name in options] + ["mask"] * (mask is not None)
    if given:
        raise InputError(f"{given[0]} does not go with {what}")


def _read_png(content: bytes, name: str, max_points: int) -> np.ndarray:
    """The pixels of a grey PNG, of 16 bits if they are depth; its size is looked at before it is unpacked."""
    try:
        with Image.open(io.BytesIO(content), formats=("PNG",)) as image:
            if math.prod(image.size) > max_points:
                raise InputError(f"{name} must have at most {max_points} pixels, got {image.width} x {image.height}")
            valid = ("I;16", "I;16B", "I") if name == "depth" else ("1", "L", "I;16", "I;16B", "I")
            if image.mode not in valid:
                bits = "16 bits" if name == "depth" else "at most 16 bits"
                raise InputError(f"{name} must be a PNG with one channel of {bits}, got one of mode {image.mode}")
            return np.asarray(image)
    except InputError:
        raise
    except Exception as error:  # there is no end to what a broken picture can raise
        raise DataError(f"{name} is not a readable PNG: {_reason(error)}") from error


def _read_npz(content: bytes, max_points: int) -> dict[str, Any]:
    """The arrays that a request may hold; what else is in the archive is not unpacked."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            entries = {entry.filename.removesuffix(".npy"): entry for entry in archive.infolist()[:MOST_ENTRIES]}
            wanted = [name for name in ("depth", "points", "mask", *NPZ_OPTIONS) if name in entries]
            arrays = {name: _read_array(archive, entries[name], name, max_points) for name in wanted}
    except (InputError, DataError):
        raise
    except Exception as error:  # nor to what a broken archive can raise
        raise DataError(f"the body is not a readable npz: {_reason(error)}") from error
    return {NPZ_OPTIONS.get(name, name): array for name, array in arrays.items()}


def _read_array(archive: zipfile.ZipFile, entry: zipfile.ZipInfo, name: str, max_points: int) -> np.ndarray:
    """One array, unpacked only if it is of plain numbers and no larger than it may be."""
    most = LARGEST_OPTION if name in NPZ_OPTIONS else 3 * max_points if name == "points" else max_points
    largest = most * LARGEST_ITEM
    if entry.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise DataError(f"{name} in the npz is packed in an unknown way ({entry.compress_type})")
    with archive.open(entry) as packed:
        version = np.lib.format.read_magic(packed)
        if version != (1, 0):  # later ones have headers of up to 4 GB, which are unpacked before they are looked at
            raise DataError(f"{name} in the npz is of version {version}; known is (1, 0)")
        shape, is_fortran, dtype = np.lib.format.read_array_header_1_0(packed)
        if any(length < 0 for length in shape):  # a negative size would unpack everything
            raise DataError(f"{name} in the npz has shape {shape}"[:200])
        if dtype.kind not in "biuf":
            raise InputError(f"{name} must be plain numbers, got {dtype}"[:200])
        size = math.prod(shape) * dtype.itemsize
        if size > largest:
            raise InputError(f"{name} must have at most {most} numbers, got shape {shape}"[:200])
        numbers = packed.read(size + 1)
    if len(numbers) != size:
        raise DataError(
            f"{name} in the npz announces {size} bytes and holds {'more' if len(numbers) > size else 'less'}"
        )
    return np.frombuffer(numbers, dtype).reshape(shape, order="F" if is_fortran else "C")


def _read_json(content: bytes, max_points: int) -> dict[str, Any]:
    if len(content) > LARGEST_JSON:
        raise InputError(f"JSON must be at most {LARGEST_JSON} bytes, got {len(content)}: send an npz")
    try:
        values = json.loads(content)
    except Exception as error:  # text that is no UTF-8, endless nesting, numbers of a million digits
        raise DataError(f"the body is not readable JSON: {_reason(error)}") from error
    if not isinstance(values, dict):
        raise InputError(f"JSON must be an object, got {described(values)}")
    for name in ("depth", "mask"):
        if values.get(name) is not None:
            values[name] = _read_png(_of_base64(values[name], name), name, max_points)
    return values


def _of_base64(value: Any, name: str) -> bytes:
    try:
        return base64.b64decode(value, validate=True)
    except (binascii.Error, TypeError, ValueError) as error:
        raise InputError(f"{name} must be a PNG in base64, got {described(value)}") from error


def _reason(error: BaseException) -> str:
    return " ".join((str(error) or type(error).__name__).split())[:200]
