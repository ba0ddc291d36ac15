"""A capture as its camera sees it: the relief of the depth image, the objects in their colours, their numbers."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float, Int, Real
from PIL import Image

from icgnet.viewer.annotate import Label, write_labels
from icgnet.viewer.palette import instance_colour, instance_colours

WIDTH = 960
"""Of the picture [pixels]; depth images are drawn larger or smaller."""
TINT = 0.6
"""How much of an object's colour covers the relief."""
STEEP = 2.0
"""Slope of depth, in distances to the neighbouring pixel, at which the relief is darkest."""
UNMEASURED = 0.25


def camera_picture(
    depth: Real[np.ndarray, "h w"],
    intrinsics: Float[np.ndarray, "3 3"],
    instances: Int[np.ndarray, "h w"],
    names: Mapping[int, str],
) -> Image.Image:
    """The picture of one capture.

    Args:
        depth: depth image [m]; 0 or NaN where nothing was measured.
        intrinsics: camera matrix [pixels].
        instances: object at each pixel, below 0 for none.
        names: label of each object.
    """
    grey = np.repeat(relief(depth, intrinsics)[..., None], 3, axis=2)
    tinted = (1.0 - TINT) * grey + TINT * instance_colours(instances.ravel()).reshape(*instances.shape, 3)
    pixels = np.where((instances >= 0)[..., None], tinted, grey)
    image = Image.fromarray((255 * pixels).round().astype(np.uint8))
    scale = WIDTH / image.width
    image = image.resize((WIDTH, round(scale * image.height)), Image.Resampling.LANCZOS)
    labels = []
    for number, name in names.items():
        rows, columns = np.nonzero(instances == number)
        if len(rows):
            nearest = np.argmin((rows - np.median(rows)) ** 2 + (columns - np.median(columns)) ** 2)
            at = (scale * (float(columns[nearest]) + 0.5), scale * (float(rows[nearest]) + 0.5))
            labels.append(Label(name, at, instance_colour(number)))
    write_labels(image, labels)
    return image


def relief(depth: Real[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "h w"]:
    """Brightness from 0 to 1: what is tilted against the view is darker, what was not measured is dark."""
    measured = np.nan_to_num(np.asarray(depth, dtype=np.float64), posinf=0.0, neginf=0.0)
    known = measured > 0
    steps = np.where(known, measured, 1.0) / np.array([intrinsics[1, 1], intrinsics[0, 0]])[:, None, None]
    slopes = np.array([np.gradient(measured, axis=axis) for axis in (0, 1)]) / steps
    tilt = np.minimum(np.linalg.norm(slopes, axis=0) / STEEP, 1.0)
    return np.where(known, 0.95 - 0.5 * tilt, UNMEASURED)
