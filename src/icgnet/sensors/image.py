"""Errors that any depth camera makes. Depth images [m] hold 0 where nothing was measured, along the optical axis."""

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.sensors.fields import image_field
from icgnet.simulation.camera import NOTHING

FIELD_PITCH = 4
"""The error field of the Dex-Net model is drawn at a quarter of the resolution [pixels]."""
EDGE_STEP = 0.008
"""Neighbouring pixels whose depths differ by more belong to two surfaces [m]."""
NEIGHBOURS = ((0, 1), (1, 0), (0, -1), (-1, 0))


def apply_gain(depth: Float[np.ndarray, "h w"], relative: float, rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Depth times one Gamma-distributed factor with mean 1 and standard deviation `relative`.

    Source: the multiplicative part of the Dex-Net 2.0 noise (Mahler et al. 2017), Gamma(1000, 0.001), relative 0.0316.
    """
    return depth * np.float32(rng.gamma(relative**-2, relative**2))


def add_error_field(
    depth: Float[np.ndarray, "h w"], sigma: float, rng: np.random.Generator
) -> Float[np.ndarray, "h w"]:
    """Depth plus Gaussian errors [m] drawn for every fourth pixel, interpolated bilinearly.

    Source: the additive part of the Dex-Net 2.0 noise as the grasping benchmarks use it, sigma 5 mm. Dex-Net itself
    interpolates with cubics.
    """
    return np.where(depth > 0, depth + image_field(_shape(depth), sigma, FIELD_PITCH, rng), np.float32(0.0))


def round_depth(depth: Float[np.ndarray, "h w"], unit: float) -> Float[np.ndarray, "h w"]:
    """Depth in whole units [m].

    Source: depth cameras store 16-bit integers, in millimetres unless they are told otherwise.
    """
    return np.rint(depth * np.float32(1.0 / unit)) * np.float32(unit)


def fly_pixels(
    depth: Float[np.ndarray, "h w"], ids: Int[np.ndarray, "h w"], share: float, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    """Depth and ids with some pixels at depth edges somewhere between the two surfaces.

    Pixels between two objects, or an object and the table, belong to nothing then.

    Source: cameras average over a pixel, or a matching window, that sees two surfaces.

    Args:
        depth: depth image [m].
        ids: what each pixel shows.
        share: of the edge pixels that fly.
        rng: source of the draws; also decides on which two sides of things pixels fly.
    """
    result, owners = depth.copy(), ids.copy()
    right, down = rng.choice((-1, 1), 2)
    for offset in ((0, int(right)), (int(down), 0)):
        other = shifted(depth, offset)
        index = np.flatnonzero((np.abs(other - depth) > EDGE_STEP) & (depth > 0) & (other > 0))
        index = index[rng.random(len(index)) < share]
        mix = rng.random(len(index), dtype=np.float32)
        result.ravel()[index] = mix * depth.ravel()[index] + (1 - mix) * other.ravel()[index]
        between = index[shifted(ids, offset).ravel()[index] != ids.ravel()[index]]
        owners.ravel()[between] = NOTHING
    return result, owners


def smooth(depth: Float[np.ndarray, "h w"], passes: int, step: float = EDGE_STEP) -> Float[np.ndarray, "h w"]:
    """Depth averaged with its neighbours in the row, then in the column, wherever no depth edge lies between them.

    Source: the edge-preserving spatial filter of the RealSense library, which rounds creases and keeps edges.
    Differs: an average of three pixels a pass instead of the domain transform of Gastal and Oliveira (2011).

    Args:
        depth: depth image [m].
        passes: how often; the result looks about this many pixels to each side.
        step: larger differences between neighbours are edges [m].
    """
    for _ in range(passes):
        for axis in (0, 1):
            depth = _smooth_along(depth, axis, step)
    return depth


def round_spots(shape: tuple[int, int], count: int, rng: np.random.Generator) -> Bool[np.ndarray, "h w"]:
    """A mask of `count` round spots where nothing is measured.

    Source: glossy and dark spots, from which a depth camera gets no light back.
    """
    mask = np.zeros(shape, dtype=bool)
    v, u = np.ogrid[: shape[0], : shape[1]]
    for _ in range(count):
        radius = min(shape) * rng.uniform(0.01, 0.05)
        centre_v, centre_u = rng.uniform(0, shape[0]), rng.uniform(0, shape[1])
        mask |= (v - centre_v) ** 2 + (u - centre_u) ** 2 <= radius**2
    return mask


def shifted(
    image: Float[np.ndarray, "h w"] | Int[np.ndarray, "h w"], offset: tuple[int, int]
) -> Float[np.ndarray, "h w"] | Int[np.ndarray, "h w"]:
    """The image moved by one row or column; the row or column that is left behind keeps its values."""
    result = image.copy()
    to, start = [slice(None)] * 2, [slice(None)] * 2
    for axis, step in enumerate(offset):
        if step:
            to[axis] = slice(1, None) if step > 0 else slice(None, -1)
            start[axis] = slice(None, -1) if step > 0 else slice(1, None)
    result[tuple(to)] = image[tuple(start)]
    return result


def slant(
    depth: Float[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"]
) -> tuple[Float[np.ndarray, "h w"], Float[np.ndarray, "h w"]]:
    """Lengths of the normal and of the ray at each pixel, whose product with each other is the depth [m] itself.

    So the depth over the product of the lengths is the cosine of the angle between line of sight and normal.

    Args:
        depth: depth image [m].
        intrinsics: camera matrix [pixels].
    """
    dv, du = np.gradient(depth)
    (fx, _, cx), (_, fy, cy), _ = intrinsics.astype(np.float32)
    u, v = np.arange(depth.shape[1], dtype=np.float32) - cx, np.arange(depth.shape[0], dtype=np.float32)[:, None] - cy
    along = depth + u * du + v * dv
    normal = np.sqrt((fx * du) ** 2 + (fy * dv) ** 2 + along * along)
    return normal, np.sqrt((u / fx) ** 2 + (v / fy) ** 2 + 1)


def _smooth_along(depth: Float[np.ndarray, "h w"], axis: int, step: float) -> Float[np.ndarray, "h w"]:
    before, after = [slice(None)] * 2, [slice(None)] * 2
    before[axis], after[axis] = slice(None, -1), slice(1, None)
    difference = depth[tuple(after)] - depth[tuple(before)]
    difference[np.abs(difference) > step] = 0.0
    # Moving a third of the way to each neighbour is the mean of the three.
    difference *= np.float32(1.0 / 3.0)
    result = depth.copy()
    result[tuple(before)] += difference
    result[tuple(after)] -= difference
    return result


def _shape(depth: Float[np.ndarray, "h w"]) -> tuple[int, int]:
    return depth.shape[0], depth.shape[1]
