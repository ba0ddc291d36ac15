"""What depth sensors do to a depth image and to the cloud from it; drawn anew at every training visit.

Each model is one small function. Depth images [m] hold 0 where nothing was measured, along the camera's z axis.
`SensorNoise` says how much of which; `corrupt_depth` and `corrupt_points` apply it in the order light meets it.

Paper: "Observations" (Gaussian noise and erased 2 cm regions). Differs: no elastic deformation, because it moves the
surface but not the grasp labels by millimetres; the sensor models of the field's benchmarks instead.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int


@dataclass(frozen=True)
class SensorNoise:
    """How much of which noise a visit gets. A `*_probability` is the chance that a visit has this noise at all.

    Attributes:
        gaussian: points get independent noise with a sigma drawn from 0 to this [m].
        gain: relative standard deviation of one factor on the whole depth image.
        field_probability: of a smooth error field over the image.
        field: largest sigma of that field [m].
        quantisation_probability: of stereo quantisation.
        disparity_step: largest step of the disparity [pixels].
        flying_probability: of flying pixels at depth edges.
        holes_probability: of round holes in the image.
        block_probability: of erased blocks.
        block_share: share of the 2 cm blocks that are erased then.
        drop: largest share of points that are dropped one by one.
    """

    gaussian: float = 0.0
    gain: float = 0.0
    field_probability: float = 0.0
    field: float = 0.0
    quantisation_probability: float = 0.0
    disparity_step: float = 0.25
    flying_probability: float = 0.0
    holes_probability: float = 0.0
    block_probability: float = 0.0
    block_share: float = 0.2
    drop: float = 0.0


NOISES = {
    "clean": SensorNoise(),
    "gaussian": SensorNoise(gaussian=0.002),
    "dex": SensorNoise(gain=1000**-0.5, field_probability=0.5, field=0.005),
    # A gain of 3 % moves the table by 2 cm; whoever knows the table's height takes it out, and 0.4 % is what stays.
    "mixed": SensorNoise(
        gaussian=0.002,
        gain=0.004,
        field_probability=0.25,
        field=0.005,
        quantisation_probability=0.25,
        flying_probability=0.4,
        holes_probability=0.3,
        block_probability=0.25,
        drop=0.3,
    ),
}
"""Presets by name: clean, gaussian (the published one), dex (the benchmark's hard setting), mixed (for training)."""

BLOCK_SIZE = 0.02
STEREO_BASELINE = 0.055
FIELD_PIXELS = 4
EDGE_STEP = 0.008


def corrupt_depth(
    depth: Float[np.ndarray, "h w"],
    focal: float,
    noise: SensorNoise,
    rng: np.random.Generator,
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """The depth image [m] as a sensor would deliver it, and which of its pixels fly between two surfaces.

    Args:
        depth: true depth, 0 where nothing is hit [m].
        focal: focal length [pixels].
        noise: how much of which.
        rng: source of the draws.
    """
    flying = np.zeros(depth.shape, dtype=bool)
    # Every decision is drawn whether it is used or not: a stronger noise then keeps the other draws as they are.
    with_field, with_steps, with_flying, with_holes = rng.random(4)
    strength = rng.random()
    if with_flying < noise.flying_probability:
        depth, flying = add_flying_pixels(depth, rng)
    if noise.gain > 0:
        depth = apply_gain(depth, noise.gain, rng)
    if with_field < noise.field_probability:
        depth = add_error_field(depth, noise.field * strength**0.5, rng)
    if with_steps < noise.quantisation_probability:
        depth = quantise_disparity(depth, focal, noise.disparity_step * strength)
    if with_holes < noise.holes_probability:
        depth = cut_holes(depth, rng)
    return depth, flying


def corrupt_points(
    points: Float[np.ndarray, "n 3"], noise: SensorNoise, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "m 3"], Int[np.ndarray, "m"]]:
    """The points [m] that are left, with noise on their positions, and their indices in the input."""
    keep = rng.random(len(points)) >= noise.drop * rng.random()
    if rng.random() < noise.block_probability:
        keep &= ~erased_blocks(points, noise.block_share, rng)
    index = np.flatnonzero(keep)
    sigma = noise.gaussian * rng.random()
    return points[index] + sigma * rng.standard_normal((len(index), 3)), index


def apply_gain(depth: Float[np.ndarray, "h w"], relative: float, rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Depth times one Gamma-distributed factor with mean 1 and standard deviation `relative`.

    Source: the multiplicative part of the Dex-Net 2.0 depth noise, Gamma(1000, 0.001), relative = 0.0316.
    """
    return depth * rng.gamma(relative**-2, relative**2)


def add_error_field(
    depth: Float[np.ndarray, "h w"], sigma: float, rng: np.random.Generator
) -> Float[np.ndarray, "h w"]:
    """Depth plus a smooth Gaussian field: drawn at a quarter of the resolution, interpolated with cubics.

    Source: the additive part of the Dex-Net 2.0 depth noise; sigma 5 mm there.
    """
    rows, columns = (cubic_upsampling(size, FIELD_PIXELS) for size in depth.shape)
    field = rows @ rng.normal(0.0, sigma, (rows.shape[1], columns.shape[1])) @ columns.T
    return np.where(depth > 0, depth + field, 0.0)


@lru_cache(maxsize=2048)
def cubic_upsampling(size: int, factor: int) -> Float[np.ndarray, "size k"]:
    """Weights of the coarse samples at each of `size` fine positions (Keys' cubic convolution, a = -0.5)."""
    position = np.arange(size) / factor
    # One more sample on either side, so that the four that a cubic needs always exist.
    distance = np.abs(position[:, None] + 1.0 - np.arange(int(position[-1]) + 4))
    near = 1.5 * distance**3 - 2.5 * distance**2 + 1.0
    far = -0.5 * distance**3 + 2.5 * distance**2 - 4.0 * distance + 2.0
    return np.where(distance <= 1.0, near, np.where(distance < 2.0, far, 0.0))


def quantise_disparity(depth: Float[np.ndarray, "h w"], focal: float, step: float) -> Float[np.ndarray, "h w"]:
    """Depth rounded to whole steps of the disparity, so that its steps grow with the distance squared.

    Source: the geometry of a stereo pair, disparity = focal * baseline / depth.

    Args:
        depth: depth image [m].
        focal: focal length [pixels].
        step: smallest difference of disparities that is resolved [pixels].
    """
    if step <= 0:
        return depth
    measured = depth > 0
    disparity = focal * STEREO_BASELINE / np.where(measured, depth, 1.0)
    rounded = np.maximum(np.round(disparity / step), 1.0) * step
    return np.where(measured, focal * STEREO_BASELINE / rounded, 0.0)


def add_flying_pixels(
    depth: Float[np.ndarray, "h w"], rng: np.random.Generator
) -> tuple[Float[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]:
    """Depth with some pixels at depth edges somewhere between the two surfaces, and which pixels these are.

    Source: time-of-flight and stereo cameras average over a pixel that sees two surfaces.
    """
    shift = ((0, 1), (1, 0), (0, -1), (-1, 0))[rng.integers(4)]
    other = np.roll(depth, shift, axis=(0, 1))
    edge = (np.abs(other - depth) > EDGE_STEP) & (depth > 0) & (other > 0)
    edge[[0, -1]] = False
    edge[:, [0, -1]] = False
    flying = edge & (rng.random(depth.shape) < 0.6 * rng.random())
    mix = rng.random(depth.shape)
    return np.where(flying, mix * depth + (1 - mix) * other, depth), flying


def cut_holes(depth: Float[np.ndarray, "h w"], rng: np.random.Generator, most: int = 8) -> Float[np.ndarray, "h w"]:
    """Depth with up to `most` round holes where nothing is measured.

    Source: glossy and dark spots, from which a depth camera gets no light back.
    """
    height, width = depth.shape
    mask = np.ones(depth.shape, dtype=bool)
    v, u = np.ogrid[:height, :width]
    for _ in range(rng.integers(1, most + 1)):
        radius = min(height, width) * rng.uniform(0.01, 0.05)
        centre_v, centre_u = rng.uniform(0, height), rng.uniform(0, width)
        mask &= (v - centre_v) ** 2 + (u - centre_u) ** 2 > radius**2
    return np.where(mask, depth, 0.0)


def erased_blocks(points: Float[np.ndarray, "n 3"], share: float, rng: np.random.Generator) -> Bool[np.ndarray, "n"]:
    """Which points lie in an erased block: space is cut into cubes of 2 cm, each erased with probability `share`.

    Paper: "Observations", p = 0.2.
    """
    blocks = np.floor((points + rng.uniform(0, BLOCK_SIZE, 3)) / BLOCK_SIZE).astype(np.int64)
    if len(blocks) == 0:
        return np.zeros(0, dtype=bool)
    blocks -= blocks.min(axis=0)
    key = np.ravel_multi_index(tuple(blocks.T), tuple(blocks.max(axis=0) + 1))
    return (rng.random(key.max() + 1) < share)[key]
