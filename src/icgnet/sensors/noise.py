"""The sensor of a training visit: which errors it makes and how large they are, drawn anew every time.

`SensorNoise` says how much of which; `corrupt_depth` and `corrupt_points` apply it in the order light meets it. Each
model is a small function of `icgnet.sensors`, which names its source; docs/guides/sensor_noise.md shows them.

Paper: "Observations" (Gaussian noise, elastic deformation, erased 2 cm regions). Differs: sensor models as well.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.sensors.cloud import deform, erased_blocks, jitter
from icgnet.sensors.config import NEVER, Amount, SensorNoise
from icgnet.sensors.image import add_error_field, apply_gain, fly_pixels, round_depth, round_spots, smooth
from icgnet.sensors.stereo import (
    RIPPLE_PITCH,
    add_disparity_noise,
    fatten_edges,
    grazing_pixels,
    quantise_disparity,
    stereo_shadow,
)
from icgnet.sensors.structured_light import dark_pixels, wander_edges
from icgnet.sensors.time_of_flight import add_multipath, add_shot_noise, blend_edges, wiggle
from icgnet.simulation.camera import DepthImage


def corrupt_depth(
    image: DepthImage, intrinsics: Float[np.ndarray, "3 3"], noise: SensorNoise, rng: np.random.Generator
) -> DepthImage:
    """The image as a sensor would deliver it; pixels between two surfaces get the id `NOTHING`.

    Args:
        image: true depth [m] and ids.
        intrinsics: camera matrix [pixels].
        noise: how much of which.
        rng: source of the draws.
    """
    noise = noise.pick(rng)
    depth, ids, focal = image.depth, image.ids, float(intrinsics[0, 0])
    lost = _lost_pixels(image, intrinsics, noise, rng)
    if albedo := _draw(noise.multipath, rng):
        depth = add_multipath(depth, intrinsics, albedo)
    if amplitude := _draw(noise.wiggle, rng):
        depth = wiggle(depth, amplitude, rng)
    if sigma := _draw(noise.shot_noise, rng):
        depth = add_shot_noise(depth, ids, intrinsics, sigma, rng)
    if spread := _draw(noise.blending, rng):
        depth, ids = blend_edges(depth, ids, spread)
    if reach := round(noise.fattening.draw(rng)):
        depth, ids = fatten_edges(depth, ids, reach, rng)
    if sigma := _draw(noise.wandering, rng):
        depth, ids = wander_edges(depth, ids, sigma, rng)
    if sigma := noise.disparity_noise.draw(rng):
        depth = add_disparity_noise(depth, focal, sigma, rng, noise.baseline, noise.window)
    if sigma := _draw(noise.ripple, rng):
        depth = add_disparity_noise(depth, focal, sigma, rng, noise.baseline, RIPPLE_PITCH)
    if step := noise.disparity_step.draw(rng):
        depth = quantise_disparity(depth, focal, step, noise.baseline)
    if passes := round(noise.smoothing.draw(rng)):
        depth = smooth(depth, passes)
    if share := noise.flying.draw(rng):
        depth, ids = fly_pixels(depth, ids, share, rng)
    if relative := noise.gain.draw(rng):
        depth = apply_gain(depth, relative, rng)
    if sigma := noise.field.draw(rng):
        depth = add_error_field(depth, sigma, rng)
    if unit := noise.depth_unit.draw(rng):
        depth = round_depth(depth, unit)
    return DepthImage(np.where(lost, np.float32(0.0), depth), ids)


def _draw(amount: Amount, rng: np.random.Generator) -> float:
    """One value; an error that is never there takes no draw, so that presets without it keep their pictures."""
    return 0.0 if amount == NEVER else amount.draw(rng)


def _lost_pixels(
    image: DepthImage, intrinsics: Float[np.ndarray, "3 3"], noise: SensorNoise, rng: np.random.Generator
) -> Bool[np.ndarray, "h w"]:
    """Where nothing is measured; decided on the true depth [m]."""
    depth = image.depth
    lost = np.zeros(depth.shape, dtype=bool)
    if noise.shadow.draw(rng):
        mirrored = bool(rng.random() < 0.5)
        for place in (noise.baseline - noise.colour, -noise.colour):
            if place:
                lost |= stereo_shadow(depth, float(intrinsics[0, 0]), mirrored != (place < 0), abs(place))
    if cosine := noise.grazing.draw(rng):
        lost |= grazing_pixels(depth, intrinsics, cosine, rng)
    if count := round(noise.spots.draw(rng)):
        lost |= round_spots((depth.shape[0], depth.shape[1]), count, rng)
    if share := _draw(noise.dark, rng):
        lost |= dark_pixels(depth, image.ids, share, rng)
    return lost


def corrupt_points(
    points: Float[np.ndarray, "n 3"], noise: SensorNoise, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "m 3"], Int[np.ndarray, "m"]]:
    """The points [m] that are left, with noise on their positions, and their indices in the input.

    A noise that is one of several must be picked before, since image and points are spoiled by the same one.
    """
    keep = np.ones(len(points), dtype=bool)
    if share := noise.drop.draw(rng):
        keep &= rng.random(len(points)) >= share
    if share := noise.blocks.draw(rng):
        keep &= ~erased_blocks(points, share, rng)
    index = np.flatnonzero(keep)
    points = points[index]
    if sigma := noise.deformation.draw(rng):
        points = deform(points, sigma, rng)
    if sigma := noise.gaussian.draw(rng):
        points = jitter(points, sigma, rng)
    return points, index
