"""Smooth random fields: over an image, and over space."""

import numpy as np
from jaxtyping import Float, Float32

LOSS = 2.0 / 3.0
"""Standard deviation of a bilinear field relative to that of its coarse samples, averaged over the image."""
WAVES = 24
"""Waves that a field over space is summed from."""


def image_field(
    shape: tuple[int, int], sigma: float, pitch: int | tuple[int, int], rng: np.random.Generator
) -> Float32[np.ndarray, "h w"]:
    """Independent Gaussian samples on every `pitch`-th pixel, interpolated bilinearly.

    Args:
        shape: height and width of the image [pixels].
        sigma: standard deviation of the samples; between them it is less, see `LOSS`.
        pitch: distance of the samples [pixels]; two numbers are along the columns and along the rows.
        rng: source of the draws.
    """
    pitches = (pitch, pitch) if isinstance(pitch, int) else pitch
    rows, columns = (np.arange(edge) / distance for edge, distance in zip(shape, pitches, strict=True))
    coarse = rng.standard_normal((int(rows[-1]) + 2, int(columns[-1]) + 2), dtype=np.float32) * np.float32(sigma)
    return stretch(stretch(coarse.T, columns).T, rows)


def space_field(
    points: Float[np.ndarray, "n 3"], sigma: float, length: float, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """A smooth random vector at each point, the same for points that lie together.

    A sum of random waves approximates a Gaussian field whose covariance falls off like exp(-r^2 / (2 length^2)).

    Source: Rahimi and Recht, "Random Features for Large-Scale Kernel Machines", 2007.

    Args:
        points: where the field is asked for [m].
        sigma: standard deviation of each component, in the field's own unit.
        length: how far the field stays alike [m].
        rng: source of the draws.
    """
    waves = rng.standard_normal((3, WAVES)) / length
    phases = rng.uniform(0.0, 2.0 * np.pi, WAVES)
    directions = rng.standard_normal((WAVES, 3)) * (sigma * np.sqrt(2.0 / WAVES))
    # In 32 bits, since nobody asks for a tenth of a micrometre and the cosines are most of the work.
    angles = points.astype(np.float32) @ waves.astype(np.float32) + phases.astype(np.float32)
    return np.cos(angles) @ directions.astype(np.float32)


def stretch(samples: Float32[np.ndarray, "k c"], positions: Float[np.ndarray, "n"]) -> Float32[np.ndarray, "n c"]:
    """Rows at fractional positions between the rows of `samples`."""
    low = positions.astype(np.intp)
    share = (positions - low).astype(np.float32)[:, None]
    return samples[low] * (1 - share) + samples[low + 1] * share
