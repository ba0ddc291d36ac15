"""Which errors a sensor makes and how large they are; nothing heavy is imported here."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError


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
BASELINE = 0.050
"""Distance of the two cameras of the RealSense D435 [m]."""


@dataclass(frozen=True)
class SensorNoise:
    """How much of which error, in the order in which they happen.

    Attributes:
        fattening: pixels by which near surfaces grow over what is behind them.
        shadow: above 0, pixels are lost that the second camera, or the light of the projector, cannot see.
        grazing: cosine between line of sight and normal below which pixels are lost.
        spots: round holes in the image.
        dark: share of the objects that send too little light back from a part of them.
        multipath: share of the light that surfaces send on to each other.
        wiggle: amplitude of an error that goes up and down with the distance [m].
        shot_noise: standard deviation for a bright surface at 1 m, seen from the front [m].
        blending: standard deviation of the spread of a point's light [pixels].
        wandering: standard deviation by which pixels of depth edges are displaced [pixels].
        disparity_noise: standard deviation of the disparity [pixels].
        ripple: the same over a larger distance, as waves of flat surfaces [pixels].
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
        baseline: distance of the two cameras, or of camera and projector [m].
        window: errors of the disparity are alike within about so many pixels of a column, and of a row.
        colour: where the depth image is warped to that of a colour camera: how far that is from the camera, towards the
            second one or the projector [m]. Only the shadows know of it, since pixels must be seen from all places.
        one_of: if there are any, one of these is drawn for each picture, and all else here is not used.
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
    dark: Amount = NEVER
    multipath: Amount = NEVER
    wiggle: Amount = NEVER
    shot_noise: Amount = NEVER
    blending: Amount = NEVER
    wandering: Amount = NEVER
    ripple: Amount = NEVER
    baseline: float = BASELINE
    window: tuple[int, int] = (5, 5)
    colour: float = 0.0
    one_of: tuple["SensorNoise", ...] = ()

    def __post_init__(self) -> None:
        matched = any(each != NEVER for each in (self.disparity_noise, self.ripple, self.disparity_step))
        if matched and not self.baseline > 0.0:
            raise InputError(f"errors of the disparity need a baseline above 0 m, got {self.baseline:g}")

    def pick(self, rng: np.random.Generator) -> "SensorNoise":
        """The noise of one picture: one of several, or this itself, which takes no draw."""
        return self.one_of[rng.integers(len(self.one_of))] if self.one_of else self


RARELY_DARK = Amount(0.1, 0.5, probability=0.25)
STEREO = SensorNoise(
    fattening=Amount(0.6, 1.8),
    shadow=exactly(1.0),
    grazing=Amount(0.0, 0.08),
    spots=up_to(1.2),
    dark=RARELY_DARK,
    disparity_noise=Amount(0.02, 0.12),
    ripple=Amount(0.03, 0.15),
    disparity_step=exactly(1 / 32),
    smoothing=Amount(0.0, 2.0),
    flying=up_to(0.4),
    depth_unit=exactly(0.001),
    window=(4, 9),
    colour=-0.015,
)
"""A RealSense D400 from 0.35 to 1.4 m, its depth aligned to its colour."""
D415 = replace(STEREO, baseline=0.055, depth_unit=exactly(0.0001))
"""A D415 that stores depth as finely as it can be told to."""
STRUCTURED_LIGHT = SensorNoise(
    shadow=exactly(1.0),
    grazing=Amount(0.05, 0.15),
    spots=up_to(0.7),
    dark=RARELY_DARK,
    wandering=Amount(0.6, 1.1),
    disparity_noise=Amount(0.08, 0.11),
    ripple=Amount(0.0, 0.03),
    disparity_step=exactly(1 / 8),
    depth_unit=exactly(0.001),
    baseline=0.075,
    window=(5, 8),
    colour=0.025,
)
"""A Kinect of 2010, or another camera with the sensor of Primesense, its depth aligned to its colour."""
PHOXI = replace(
    STRUCTURED_LIGHT,
    dark=Amount(0.2, 0.6),
    wandering=Amount(0.6, 1.2),
    disparity_noise=Amount(0.05, 0.10),
    ripple=Amount(0.10, 0.20),
    disparity_step=NEVER,
    depth_unit=exactly(0.0001),
    baseline=0.2,
    colour=0.0,
    window=(1, 1),
)
"""A Photoneo PhoXi, which finds each pixel by itself in a sequence of patterns."""
TIME_OF_FLIGHT = SensorNoise(
    shadow=exactly(1.0),
    grazing=Amount(0.02, 0.10),
    spots=up_to(1.2),
    dark=RARELY_DARK,
    multipath=Amount(0.1, 0.5),
    wiggle=up_to(0.004),
    shot_noise=Amount(0.0015, 0.0035),
    blending=Amount(0.5, 0.7),
    flying=Amount(0.1, 0.6),
    field=Amount(0.0005, 0.0015),
    depth_unit=exactly(0.001),
    baseline=0.0,
    colour=0.032,
)
"""A Kinect of 2013, or an Azure Kinect, its depth aligned to its colour; the light comes from beside the lens."""

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
    "stereo": STEREO,
    "structured_light": STRUCTURED_LIGHT,
    "time_of_flight": TIME_OF_FLIGHT,
    "wide": SensorNoise(one_of=(STEREO, STRUCTURED_LIGHT, TIME_OF_FLIGHT)),
}
"""Presets by name: none; the paper's Gaussian; the benchmark's hard setting; a D415 or D435 at arm's length; all, for
training; then the three kinds of cameras over whole tables, and one of them for each picture."""


@dataclass(frozen=True)
class CameraModel:
    """A depth camera at its own resolution.

    Attributes:
        name: as in `CAMERAS`.
        shape: height and width of the depth image [pixels].
        focal: focal length of the depth image [pixels].
        noise: what it does to a picture; it knows the baseline.
    """

    name: str
    shape: tuple[int, int]
    focal: float
    noise: SensorNoise

    @property
    def intrinsics(self) -> Float[np.ndarray, "3 3"]:
        """Camera matrix [pixels], with the optical axis through the middle of the image."""
        height, width = self.shape
        return np.array([[self.focal, 0.0, (width - 1) / 2], [0.0, self.focal, (height - 1) / 2], [0.0, 0.0, 1.0]])


CAMERAS = {
    camera.name: camera
    for camera in (
        CameraModel("d435", (720, 1280), 640.0, STEREO),
        CameraModel("d435_vga", (480, 640), 385.0, STEREO),
        CameraModel("d415", (720, 1280), 925.0, D415),
        CameraModel("d415_vga", (480, 640), 615.0, D415),
        CameraModel("kinect_v1", (480, 640), 580.0, STRUCTURED_LIGHT),
        CameraModel("primesense", (480, 640), 540.0, STRUCTURED_LIGHT),
        CameraModel("phoxi", (772, 1032), 1105.0, PHOXI),
        CameraModel("kinect_v2", (424, 512), 365.0, TIME_OF_FLIGHT),
        CameraModel("azure_kinect", (576, 640), 504.0, TIME_OF_FLIGHT),
    )
}
"""Cameras by name."""
