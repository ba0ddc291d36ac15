"""Depth in metres and camera matrix from a depth image and a camera info of ROS."""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.geometry.camera import check_intrinsics

if TYPE_CHECKING:
    from icgnet.ros2.messages import CameraInfo, Image

ENCODINGS = {"16UC1": ("u2", 1000.0), "mono16": ("u2", 1000.0), "32FC1": ("f4", 1.0)}
"""Encoding of a depth image -> type of a pixel, and units per metre (REP 118)."""


def depth_of(image: "Image") -> Float[np.ndarray, "h w"]:
    """Depth along the camera's z axis [m]; 0 and NaN stay what they are, not measured.

    Raises:
        InputError: an encoding that is not of depth, or fewer bytes than the size of the image needs.
    """
    if image.encoding not in ENCODINGS:
        raise InputError(
            f"encoding {image.encoding!r} of the image is no depth; known are 16UC1 and mono16 (mm) and 32FC1 (m)"
        )
    kind, units = ENCODINGS[image.encoding]
    pixel = np.dtype((">" if image.is_bigendian else "<") + kind)
    data, step = np.asarray(image.data, dtype=np.uint8), image.step
    if not image.height or not image.width or step < pixel.itemsize * image.width or len(data) < step * image.height:
        raise InputError(
            f"an image of {image.width} x {image.height} pixels of {pixel.itemsize} bytes with {step} bytes a row "
            f"cannot have {len(data)} bytes"
        )
    rows = data[: step * image.height].reshape(image.height, step)[:, : pixel.itemsize * image.width]
    return np.ascontiguousarray(rows).view(pixel).astype(np.float64) / units


def intrinsics_of(info: "CameraInfo", width: int, height: int) -> Float[np.ndarray, "3 3"]:
    """Camera matrix [pixels] of rectified images of this size, less what binning and the region of interest take away.

    That is the left part of P; K, which is of images before they are rectified, where a driver leaves P empty.

    Raises:
        InputError: K is zero or no camera matrix, or the camera info is for images of another size.
    """
    if not any(info.k):
        raise InputError("K of the camera info is zero: the camera is not calibrated")
    roi = info.roi
    full = (roi.width or info.width, roi.height or info.height)
    binning = (max(1, info.binning_x), max(1, info.binning_y))
    size = (full[0] // binning[0], full[1] // binning[1])
    if size != (width, height):
        raise InputError(f"the camera info is for {size[0]} x {size[1]} pixels, the image has {width} x {height}")
    P = np.array(info.p, dtype=np.float64).reshape(3, 4)
    K = P[:, :3].copy() if P[0, 0] else np.array(info.k, dtype=np.float64).reshape(3, 3)
    K[0, 2] -= roi.x_offset
    K[1, 2] -= roi.y_offset
    for axis, count in enumerate(binning):
        K[axis] /= count  # as image_geometry does, without half a pixel
    return check_intrinsics(K)
