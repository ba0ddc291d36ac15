"""Which errors a sensor makes and how large they are; nothing heavy is imported here."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Amount:
    """A number that is drawn evenly from `least` to `most`, or 0: it is there with the given probability only."""

    least: float = 0.0
    most: float = 0.0
    probability: float = 1.0

    def draw(self, rng: np.random.Generator) -> float:
        """One value; takes the same number of draws from `rng` whatever the amount is."""
        present, position = rng.random(2)
        return self.least + position * (self.most - self.least) if present < self.probability else 0.0


def exactly(value: float, probability: float = 1.0) -> Amount:
    """Always this value, or 0."""
    return Amount(value, value, probability)


def up_to(most: float, probability: float = 1.0) -> Amount:
    """Anything from 0 to this value."""
    return Amount(0.0, most, probability)


NEVER = Amount()


@dataclass(frozen=True)
class SensorNoise:
    """How much of which error, in the order in which they happen.

    Attributes:
        fattening: pixels by which near surfaces grow over what is behind them.
        shadow: above 0, pixels that the second camera of a stereo pair cannot see are lost.
        grazing: cosine between line of sight and normal below which pixels are lost.
        spots: round holes in the image.
        disparity_noise: standard deviation of the disparity [pixels].
        disparity_step: smallest step of the disparity [pixels].
        smoothing: passes of an edge-preserving filter.
        flying: share of the pixels at depth edges that lie between the surfaces.
        gain: relative standard deviation of one factor on the whole image.
        field: standard deviation of a smooth error field over the image [m].
        depth_unit: depth is stored in whole multiples of this [m].
        drop: share of points that are dropped one by one.
        blocks: share of the 2 cm blocks that are erased.
        deformation: standard deviation of a smooth displacement of the cloud [m].
        gaussian: standard deviation of independent noise on the points [m].
    """

    fattening: Amount = NEVER
    shadow: Amount = NEVER
    grazing: Amount = NEVER
    spots: Amount = NEVER
    disparity_noise: Amount = NEVER
    disparity_step: Amount = NEVER
    smoothing: Amount = NEVER
    flying: Amount = NEVER
    gain: Amount = NEVER
    field: Amount = NEVER
    depth_unit: Amount = NEVER
    drop: Amount = NEVER
    blocks: Amount = NEVER
    deformation: Amount = NEVER
    gaussian: Amount = NEVER


NOISES = {
    "clean": SensorNoise(),
    "gaussian": SensorNoise(gaussian=up_to(0.002)),
    "dex": SensorNoise(gain=exactly(1000**-0.5), field=exactly(0.005, probability=0.5)),
    # The disparity noise spans from a D415 on a textured wall to a D435 in the field; see the guide for its sources.
    "realsense": SensorNoise(
        fattening=Amount(1.0, 2.0),
        shadow=exactly(1.0),
        grazing=Amount(0.10, 0.20),
        spots=up_to(4.0),
        disparity_noise=Amount(0.05, 0.25),
        disparity_step=exactly(1 / 32),
        smoothing=Amount(0.0, 2.0),
        flying=up_to(0.4),
        depth_unit=exactly(0.001),
    ),
    # A gain of 3 % moves the table by 2 cm; whoever knows the table's height takes it out, and 0.4 % is what stays.
    "mixed": SensorNoise(
        fattening=Amount(1.0, 2.0, 0.2),
        shadow=exactly(1.0, 0.4),
        grazing=Amount(0.05, 0.25, 0.4),
        spots=Amount(1.0, 8.0, 0.3),
        disparity_noise=up_to(0.25, 0.4),
        disparity_step=up_to(0.25, 0.25),
        smoothing=Amount(1.0, 2.0, 0.3),
        flying=up_to(0.6, 0.4),
        gain=exactly(0.004),
        field=up_to(0.005, 0.25),
        depth_unit=exactly(0.001, 0.3),
        drop=up_to(0.3),
        blocks=exactly(0.2, 0.25),
        deformation=up_to(0.001, 0.3),
        gaussian=up_to(0.002),
    ),
}
"""Presets by name: none; the paper's Gaussian; the benchmark's hard setting; a D415 or D435; all, for training."""
