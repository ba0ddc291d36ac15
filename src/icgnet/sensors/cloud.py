"""Errors on the points of a cloud."""

import numpy as np
from jaxtyping import Bool, Float

from icgnet.sensors.fields import space_field

BLOCK_SIZE = 0.02
DEFORMATION_LENGTH = 0.05
"""How far neighbouring points move alike when the cloud is deformed [m]."""


def jitter(points: Float[np.ndarray, "n 3"], sigma: float, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Points with independent Gaussian noise on each coordinate [m].

    Paper: "Observations", N(0, 0.002). The benchmark's own noise has a sigma of 0.0008.
    """
    return points + np.float32(sigma) * rng.standard_normal(points.shape, dtype=np.float32)


def deform(points: Float[np.ndarray, "n 3"], sigma: float, rng: np.random.Generator) -> Float[np.ndarray, "n 3"]:
    """Points moved by a smooth random field with a standard deviation of `sigma` [m] along each axis.

    Source: elastic deformation (Simard et al. 2003); it stands for what calibration and lens distortion leave over.
    Paper: "Observations". Differs: a field of random waves instead of splines between displaced grid points.
    """
    return points + space_field(points, sigma, DEFORMATION_LENGTH, rng)


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
