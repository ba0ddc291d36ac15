"""Pinhole cameras: intrinsics, depth images and poses that look at a scene.

Camera frame as in OpenCV: x right, y down, z forward. Pixel centres have integer coordinates, so pixel (u, v)
looks along ((u - cx) / fx, (v - cy) / fy, 1).
"""

from typing import Any

import numpy as np
from jaxtyping import Float, Real

from icgnet.errors import InputError
from icgnet.geometry.arrays import real_array
from icgnet.geometry.transforms import make_transform

DEFAULT_SHAPE = (480, 640)
DEFAULT_INTRINSICS = np.array([[540.0, 0.0, 320.0], [0.0, 540.0, 240.0], [0.0, 0.0, 1.0]])
DEFAULT_INTRINSICS.setflags(write=False)

# A table-top camera stands between these distances [m]; a median outside of them is the wrong unit.
NEAREST_MEDIAN = 0.02
FARTHEST_MEDIAN = 20.0
FARTHEST_PIXEL = 1000.0
"""Beyond this [m] a sensor has not measured anything."""
SHORTEST_FOCAL, LARGEST_INTRINSIC = 1.0, 1e6
"""Cameras have focal lengths and centres between these [pixels]."""


def check_intrinsics(intrinsics: Any) -> Float[np.ndarray, "3 3"]:
    """Intrinsics as float64, after checking that they describe a pinhole camera.

    Args:
        intrinsics: [3 3] matrix ((fx, skew, cx), (0, fy, cy), (0, 0, 1)) [pixels].

    Raises:
        InputError: another shape, values that are not finite, a focal length that is not positive (which includes
            every singular matrix), or numbers where the zeros and the one belong.
    """
    matrix = real_array(intrinsics, "intrinsics", (3, 3))
    if matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
        raise InputError(
            f"intrinsics must have focal lengths above 0 pixels (else they are singular), "
            f"got fx = {matrix[0, 0]:g}, fy = {matrix[1, 1]:g}"
        )
    if matrix[0, 0] < SHORTEST_FOCAL or matrix[1, 1] < SHORTEST_FOCAL or np.abs(matrix).max() > LARGEST_INTRINSIC:
        raise InputError(
            f"intrinsics must be in pixels, focal lengths from {SHORTEST_FOCAL:g} and nothing above "
            f"{LARGEST_INTRINSIC:g}, got {matrix.tolist()}"
        )
    if not np.allclose(matrix[[1, 2, 2, 2], [0, 0, 1, 2]], (0, 0, 0, 1)):
        raise InputError(f"intrinsics must be ((fx, skew, cx), (0, fy, cy), (0, 0, 1)), got {matrix.tolist()}")
    return matrix


def metric_depth(raw: Any, scale: float) -> Float[np.ndarray, "h w"]:
    """Depth in metres from the stored values of a sensor.

    Args:
        raw: depth as the sensor stores it, for example 16-bit millimetres.
        scale: stored units per metre (1000 for millimetres).

    Raises:
        InputError: a scale that is not a positive number, or no image of real numbers.
    """
    if not (np.isfinite(scale) and scale > 0):
        raise InputError(f"depth scale must be a positive number of units per metre (1000 for mm), got {scale}")
    with np.errstate(over="ignore"):
        return real_array(raw, "depth", (None, None), finite=False) / scale


def check_depth(depth: Any) -> Float[np.ndarray, "h w"]:
    """Depth [m] as float64 with NaN wherever nothing was measured.

    That is where it is 0, negative, masked, not finite or beyond `FARTHEST_PIXEL`.

    Args:
        depth: [h w] distance along the camera's z axis [m].

    Raises:
        InputError: not an image with one channel of real numbers, no pixel measured, or a median that shows another
            unit.
    """
    image = real_array(depth, "depth", (None, None), finite=False)
    image[~(np.isfinite(image) & (image > 0))] = np.nan
    measured = image[~np.isnan(image)]
    if measured.size == 0:
        raise InputError(f"depth holds no measured pixel: all {image.size} are 0, negative or not finite")
    median = np.median(measured)
    if median > FARTHEST_MEDIAN:
        raise InputError(
            f"median depth is {median:g} m, which looks like millimetres: give --depth-scale 1000 (units per metre)"
        )
    if median < NEAREST_MEDIAN:
        raise InputError(f"median depth is {median:g} m, nearer than any camera sees: was the scale applied twice?")
    image[image > FARTHEST_PIXEL] = np.nan
    return image


def pixel_rays(intrinsics: Float[np.ndarray, "3 3"], shape: tuple[int, int]) -> Float[np.ndarray, "h w 3"]:
    """Viewing direction of every pixel centre in the camera frame, scaled to z = 1.

    Args:
        intrinsics: camera matrix [pixels].
        shape: height and width of the image [pixels].
    """
    height, width = shape
    (fx, skew, cx), (_, fy, cy), _ = intrinsics
    rays = np.ones((height, width, 3))
    rays[..., 1] = ((np.arange(height) - cy) / fy)[:, None]
    rays[..., 0] = (np.arange(width) - cx - skew * rays[..., 1]) / fx
    return rays


def unproject(depth: Real[np.ndarray, "h w"], intrinsics: Real[np.ndarray, "3 3"]) -> Float[np.ndarray, "h w 3"]:
    """Points [m] in the camera frame, one per pixel, NaN where nothing was measured.

    Args:
        depth: distance along the camera's z axis [m]; 0, negative or not finite means not measured.
        intrinsics: camera matrix [pixels].

    Raises:
        InputError: see `check_depth` and `check_intrinsics`.
    """
    checked = check_depth(depth)
    height, width = checked.shape
    points = pixel_rays(check_intrinsics(intrinsics), (height, width))
    points *= checked[..., None]
    return points


def look_at(
    eye: Float[np.ndarray, "3"],
    target: Float[np.ndarray, "3"],
    up: Float[np.ndarray, "3"] | None = None,
) -> Float[np.ndarray, "4 4"]:
    """T_world_camera of a camera at `eye` whose optical axis goes through `target`.

    Args:
        eye: camera centre in the world [m].
        target: the point in the image centre, in the world [m].
        up: direction that is up in the image; world z if None. When the camera looks along it (straight down),
            world x is to the right in the image instead.

    Raises:
        InputError: eye and target are the same point.
    """
    forward = np.asarray(target, dtype=np.float64) - eye
    distance = np.linalg.norm(forward)
    if not distance > 1e-9:
        raise InputError(f"camera and target must be apart to define a view, both are at {np.asarray(eye).tolist()}")
    forward /= distance
    right = np.cross(forward, (0.0, 0.0, 1.0) if up is None else up)
    if np.linalg.norm(right) < 1e-6:
        # Any direction across the view will do; the axis that is most across it is never degenerate.
        axis = np.eye(3)[0 if abs(forward[0]) < 0.9 else 1]
        right = axis - forward * (axis @ forward)
    right /= np.linalg.norm(right)
    return make_transform(np.column_stack([right, np.cross(forward, right), forward]), eye)


def sphere_pose(
    target: Float[np.ndarray, "3"], radius: float, polar: float, azimuth: float
) -> Float[np.ndarray, "4 4"]:
    """T_world_camera of a camera on a sphere around `target`, looking at it.

    Continuous in both angles, also straight above the target, where `look_at` cannot know the azimuth.

    Args:
        target: centre of the sphere in the world [m].
        radius: distance of the camera [m].
        polar: angle from world z [rad]; 0 looks straight down, pi / 2 is level with the target.
        azimuth: angle about world z from world x [rad].
    """
    outward = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    right = np.array([-np.sin(azimuth), np.cos(azimuth), 0.0])
    return make_transform(np.column_stack([right, np.cross(-outward, right), -outward]), target + radius * outward)
