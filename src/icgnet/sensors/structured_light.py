"""Errors of cameras that find a projected pattern: as a stereo pair's, and these.

The projector stands where the second camera of a pair would, so that its light casts the shadows. Numbers of the
Kinect of 2010 are from Khoshelham and Elberink, "Accuracy and resolution of Kinect depth data for indoor mapping
applications" (2012), and Nguyen, Izadi and Lovell, "Modeling Kinect sensor noise for improved 3D reconstruction and
tracking" (2012).
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.sensors.fields import image_field
from icgnet.sensors.image import EDGE_STEP

WANDER_PITCH = 2
"""Pixels of an edge wander together with their neighbours this far away [pixels]."""
DARK_PITCH = 8
"""Size of the patches from which too little light comes back [pixels]."""


def wander_edges(
    depth: Float[np.ndarray, "h w"], ids: Int[np.ndarray, "h w"], sigma: float, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    """Depth and ids with ragged edges: pixels show what really is a little beside them, where that is another surface.

    Source: the lateral noise of Nguyen et al. 2012, 0.8 to 1 pixels at all distances.

    Args:
        depth: depth image [m].
        ids: what each pixel shows.
        sigma: standard deviation of the displacement along rows and along columns [pixels].
        rng: source of the draws.
    """
    height, width = depth.shape
    down, right = (np.rint(image_field((height, width), sigma, WANDER_PITCH, rng)).astype(np.int32) for _ in range(2))
    rows = np.clip(np.arange(height, dtype=np.int32)[:, None] + down, 0, height - 1)
    source = rows * np.int32(width) + np.clip(np.arange(width, dtype=np.int32) + right, 0, width - 1)
    moved = depth.ravel()[source]
    # What is one surface, slanted or not, stays as it is.
    other = (np.abs(moved - depth) > EDGE_STEP) & (moved > 0) & (depth > 0)
    return np.where(other, moved, depth), np.where(other, ids.ravel()[source], ids)


def dark_pixels(
    depth: Float[np.ndarray, "h w"], ids: Int[np.ndarray, "h w"], share: float, rng: np.random.Generator
) -> Bool[np.ndarray, "h w"]:
    """Which pixels of dark or shiny objects send too little light back; patches of them, up to the whole object.

    Source: black plastic, metal and glass in the pictures of all active cameras.

    Args:
        depth: depth image [m].
        ids: what each pixel shows; only objects (0 and above) are dark.
        share: of the objects that are dark.
        rng: source of the draws.
    """
    count = max(int(ids.max()) + 1, 0)
    # A level in the distribution of the field below which a pixel is lost; nothing is below that of the bright ones.
    levels = np.where(rng.random(count) < share, rng.uniform(-1.0, 1.0, count), -np.inf)
    if not np.isfinite(levels).any():
        return np.zeros(depth.shape, dtype=bool)
    patches = image_field((depth.shape[0], depth.shape[1]), 1.0, DARK_PITCH, rng)
    level = np.append(levels, -np.inf)[np.where(ids >= 0, ids, count)]
    return (depth > 0) & (patches < level)
