"""A wrong depth scale, taken out by a table whose height is known."""

import numpy as np
from jaxtyping import Float

from icgnet.geometry.camera import pixel_rays

LARGEST_ERROR = 0.15
"""Scales whose logarithm is farther from 0 than this are not looked for: 0.86 to 1.16."""
BIN = 0.002
WINDOW = 5
"""The ratio that most pixels share is looked for in bins of this width, so many of them at once."""
FEWEST_SHARE = 0.05
"""At least this share of the measured pixels must agree, otherwise no table is seen."""
SMALLEST_ERROR = 0.005
"""Depth whose scale is right within this is left alone."""


def levelled_depth(
    depth: Float[np.ndarray, "h w"],
    intrinsics: Float[np.ndarray, "3 3"],
    T_world_camera: Float[np.ndarray, "4 4"],
    table_height: float,
) -> Float[np.ndarray, "h w"] | None:
    """The depth times its `depth_scale` [m]; the same array where that is 1 within 0.5 %, None where no table is seen.

    Args:
        depth: along the camera's z axis [m], 0 or NaN where nothing was measured.
        intrinsics: camera matrix [pixels].
        T_world_camera: pose of the camera, z up in the world.
        table_height: of the table plane in the world [m].
    """
    scale = depth_scale(depth, intrinsics, T_world_camera, table_height)
    if scale is None:
        return None
    return depth if abs(scale - 1.0) < SMALLEST_ERROR else scale * depth


def depth_scale(
    depth: Float[np.ndarray, "h w"],
    intrinsics: Float[np.ndarray, "3 3"],
    T_world_camera: Float[np.ndarray, "4 4"],
    table_height: float,
) -> float | None:
    """Factor on the depth that brings the table to its known height; None where too little of a table is seen.

    Every pixel that shows the table asks for the same factor, what stands on it for larger ones: the factor that most
    pixels ask for is taken. Large level tops of objects are the table's rivals, so most of what is seen must be table.

    Args:
        depth: along the camera's z axis [m], 0 or NaN where nothing was measured.
        intrinsics: camera matrix [pixels].
        T_world_camera: pose of the camera, z up in the world.
        table_height: of the table plane in the world [m].
    """
    measured = np.isfinite(depth) & (depth > 0)
    slopes = pixel_rays(intrinsics, depth.shape)[measured] @ T_world_camera[2, :3]
    down = slopes < -1e-3
    expected = (table_height - T_world_camera[2, 3]) / slopes[down]
    with np.errstate(divide="ignore", invalid="ignore"):
        errors = np.log(expected / depth[measured][down])
    errors = errors[np.abs(errors) < LARGEST_ERROR]
    if len(errors) < max(1.0, FEWEST_SHARE * measured.sum()):
        return None
    counts, edges = np.histogram(errors, bins=round(2 * LARGEST_ERROR / BIN), range=(-LARGEST_ERROR, LARGEST_ERROR))
    together = np.convolve(counts, np.ones(WINDOW), mode="valid")
    first = int(together.argmax())
    if together[first] < FEWEST_SHARE * measured.sum():
        return None
    inside = (errors >= edges[first]) & (errors <= edges[first + WINDOW])
    return float(np.exp(np.median(errors[inside])))
