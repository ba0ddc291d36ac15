"""Errors that come from matching two images. Disparity = focal length * baseline / depth, in pixels.

The second camera stands beside the first, along the rows of the image. Numbers of the RealSense D400 family are from
Grunnet-Jepsen et al., "Tuning depth cameras for best performance" and "Subpixel linearity improvement" (Intel), and
Dorodnicov et al., "Projection, texture-mapping and occlusion with Intel RealSense depth cameras" (Intel).
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.sensors.config import BASELINE
from icgnet.sensors.fields import LOSS, image_field
from icgnet.sensors.image import EDGE_STEP, NEIGHBOURS, shifted, slant

RIPPLE_PITCH = (25, 25)
"""Surfaces are wavy over about so many pixels as well: from calibration and the pattern itself."""
PATCH_PITCH = 12
"""Edges are fattened in patches of about this size [pixels]."""
GRAZING_SPREAD = 0.05
"""How raggedly holes at grazing angles begin, as a standard deviation of the cosine."""


def add_disparity_noise(
    depth: Float[np.ndarray, "h w"],
    focal: float,
    sigma: float,
    rng: np.random.Generator,
    baseline: float = BASELINE,
    window: tuple[int, int] = (5, 5),
) -> Float[np.ndarray, "h w"]:
    """Depth with errors of the disparity, alike within some pixels, so that they grow with the depth squared.

    Source: depth error = depth^2 * subpixel / (focal * baseline); Intel names a subpixel error of 0.03 to 0.08 pixels.

    Args:
        depth: depth image [m].
        focal: focal length [pixels].
        sigma: standard deviation of the disparity [pixels].
        rng: source of the draws.
        baseline: distance of the two cameras [m].
        window: neighbours in a column, and in a row, have most of their matching window and so their errors in common
            about as far as this [pixels].
    """
    # Each axis along which samples are interpolated has half of the loss.
    samples = sigma / LOSS ** (sum(each > 1 for each in window) / 2)
    noise = image_field((depth.shape[0], depth.shape[1]), samples, window, rng)
    return depth / np.maximum(1 + depth * noise * np.float32(1 / (focal * baseline)), np.float32(0.1))


def quantise_disparity(
    depth: Float[np.ndarray, "h w"], focal: float, step: float, baseline: float = BASELINE
) -> Float[np.ndarray, "h w"]:
    """Depth rounded to whole steps of the disparity, so that its steps grow with the distance squared.

    Source: the geometry of a stereo pair; the D400 resolves 1/32 pixel.

    Args:
        depth: depth image [m].
        focal: focal length [pixels].
        step: smallest difference of disparities that is resolved [pixels].
        baseline: distance of the two cameras [m].
    """
    measured = depth > 0
    steps = np.float32(focal * baseline / step)
    rounded = np.maximum(np.rint(steps / np.where(measured, depth, np.float32(1.0))), 1)
    return np.where(measured, steps / rounded, np.float32(0.0))


def fatten_edges(
    depth: Float[np.ndarray, "h w"], ids: Int[np.ndarray, "h w"], reach: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    """Depth and ids with near surfaces grown over what is behind them, in patches, by up to `reach` pixels.

    Source: a matching window that holds an edge finds the surface with more texture, mostly the nearer one
    ("foreground fattening"; Scharstein and Szeliski 2002).
    """
    depth, ids = depth.copy(), ids.copy()
    patchy = image_field((depth.shape[0], depth.shape[1]), 1.0, PATCH_PITCH, rng) > 0
    for _ in range(reach):
        for offset in NEIGHBOURS:
            nearer = shifted(depth, offset)
            index = np.flatnonzero((nearer > 0) & (nearer < depth - EDGE_STEP) & patchy)
            ids.ravel()[index] = shifted(ids, offset).ravel()[index]
            depth.ravel()[index] = nearer.ravel()[index]
    return depth, ids


def stereo_shadow(
    depth: Float[np.ndarray, "h w"], focal: float, mirrored: bool = False, baseline: float = BASELINE
) -> Bool[np.ndarray, "h w"]:
    """Which pixels the second camera cannot see, because something nearer is in its way.

    Source: occlusion in a stereo pair; the first camera of the D400 is the left one, so that shadows lie to the left of
    near objects. Whatever is behind a thin object in the order of the row counts as hidden, as matching assumes.

    Args:
        depth: depth image [m].
        focal: focal length [pixels].
        mirrored: the camera is mounted upside down, so that shadows lie to the right.
        baseline: distance of the two cameras [m].
    """
    image = depth[:, ::-1] if mirrored else depth
    column = np.arange(image.shape[1], dtype=np.float32)
    measured = image > 0
    matched = column - np.float32(focal * baseline) / np.where(measured, image, np.float32(np.inf))
    # Farther to the right in this image something lands at the same place, or farther left, in the other one.
    leftmost = np.minimum.accumulate(np.where(measured, matched, np.inf)[:, ::-1], axis=1)[:, ::-1]
    hidden = np.zeros(image.shape, dtype=bool)
    hidden[:, :-1] = measured[:, :-1] & (leftmost[:, 1:] <= matched[:, :-1])
    return hidden[:, ::-1] if mirrored else hidden


def grazing_pixels(
    depth: Float[np.ndarray, "h w"],
    intrinsics: Float[np.ndarray, "3 3"],
    least_cosine: float,
    rng: np.random.Generator,
) -> Bool[np.ndarray, "h w"]:
    """Which pixels see their surface too nearly from its side to be matched; depth edges are among them.

    Source: the two cameras see a steep surface in different widths, and little light comes back from it.

    Args:
        depth: depth image [m].
        intrinsics: camera matrix [pixels].
        least_cosine: of the angle between line of sight and normal, below which pixels are lost (raggedly).
        rng: source of the draws.
    """
    normal, ray = slant(depth, intrinsics)
    ragged = least_cosine + image_field((depth.shape[0], depth.shape[1]), GRAZING_SPREAD, 2, rng)
    return (depth > 0) & (depth < ragged * normal * ray)
