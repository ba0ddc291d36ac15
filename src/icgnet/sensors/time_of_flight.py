"""Errors of cameras that measure how long light takes, from the phase with which modulated light comes back.

The light that a pixel gets back falls with the distance squared and with the cosine of the incidence.
"""

import numpy as np
from jaxtyping import Float, Int

from icgnet.sensors.fields import stretch
from icgnet.sensors.image import EDGE_STEP, NEIGHBOURS, shifted, slant
from icgnet.simulation.camera import NOTHING

WIGGLE_PERIOD = 0.31
"""Distance after which the error of a modulation that is not quite a sine repeats [m]: a quarter of the range of 120
MHz, the highest frequency of the second Kinect."""
LEAST_COSINE = 0.1
"""Surfaces are not seen more from their side than this: pixels at depth edges have no incidence of their own."""
DIMMEST = 0.25
"""Objects send back from this share of the light to all of it."""
FILTER_GAIN = 256.0 / 70.0
"""Takes back by how much weights 1, 4, 6, 4, 1 along rows and along columns, which the errors are averaged with, make
them smaller."""
BOUNCE_ANGLE = 0.012
"""Light bounces between patches of this size, seen from the camera [rad]."""
RINGS = (1, 2, 4, 8, 16)
"""Distances of the patches from which light bounces to a patch [patches]; each ring has eight."""


def add_shot_noise(
    depth: Float[np.ndarray, "h w"],
    ids: Int[np.ndarray, "h w"],
    intrinsics: Float[np.ndarray, "3 3"],
    sigma: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "h w"]:
    """Depth with errors that are the larger the less light comes back, alike within what the camera's filter averages.

    Standard deviation: `sigma` times the distance [m], over the root of the cosine of the incidence and of the share of
    light that the object sends back.

    Source: Lange and Seitz, "Solid-state time-of-flight range camera" (2001): the phase of light that is counted in
    photons errs as one over the root of their number.

    Args:
        depth: depth image [m].
        ids: what each pixel shows; the objects (0 and above) are more or less bright.
        intrinsics: camera matrix [pixels].
        sigma: standard deviation for a bright surface seen from the front at 1 m [m].
        rng: source of the draws.
    """
    objects = max(int(ids.max()) + 1, 0)
    brightness = np.append(rng.uniform(DIMMEST, 1.0, objects), 1.0).astype(np.float32)
    normal, ray = slant(depth, intrinsics)
    cosine = np.maximum(depth / np.maximum(normal * ray, np.float32(1e-9)), np.float32(LEAST_COSINE))
    light = brightness[np.where(ids >= 0, ids, objects)] * cosine
    noise = rng.standard_normal(depth.shape, dtype=np.float32)
    for axis in (0, 0, 1, 1):
        noise = _spread(noise, np.float32(0.25), axis)
    noise *= np.float32(FILTER_GAIN)
    return depth * np.maximum(1 + np.float32(sigma) * noise / np.sqrt(light), np.float32(0.1))


def wiggle(depth: Float[np.ndarray, "h w"], amplitude: float, rng: np.random.Generator) -> Float[np.ndarray, "h w"]:
    """Depth with an error that goes up and down with the distance.

    Source: the harmonics of a modulation that is no pure sine ("wiggling"; Lindner and Kolb 2006). Some millimetres are
    left after the calibration of the second Kinect.

    Args:
        depth: depth image [m].
        amplitude: of the error [m].
        rng: source of the draws; decides on the phase.
    """
    phase = np.float32(rng.uniform(0.0, 2.0 * np.pi))
    error = np.float32(amplitude) * np.sin(depth * np.float32(2.0 * np.pi / WIGGLE_PERIOD) + phase)
    return np.where(depth > 0, depth + error, np.float32(0.0))


def blend_edges(
    depth: Float[np.ndarray, "h w"], ids: Int[np.ndarray, "h w"], sigma: float
) -> tuple[Float[np.ndarray, "h w"], Int[np.ndarray, "h w"]]:
    """Depth and ids of pixels that get light from their neighbours as well, so that pixels at edges lie between.

    Pixels that come to lie between two things belong to nothing.

    Source: "flying pixels"; the phase of mixed light lies between the phases, weighted by the light of each surface.

    Args:
        depth: depth image [m].
        ids: what each pixel shows.
        sigma: standard deviation of the spread of a point's light [pixels], at most 0.7.
    """
    side = np.float32(sigma**2 / 2.0)
    light = np.where(depth > 0, 1 / np.maximum(depth, np.float32(1e-3)) ** 2, np.float32(0.0))
    moment = light * depth
    for axis in (0, 1):
        light, moment = _spread(light, side, axis), _spread(moment, side, axis)
    blended = np.where(depth > 0, moment / np.maximum(light, np.float32(1e-9)), np.float32(0.0))
    flying = np.flatnonzero(np.abs(blended - depth) > EDGE_STEP)
    apart = np.zeros(len(flying), dtype=bool)
    for offset in NEIGHBOURS:
        apart |= shifted(ids, offset).ravel()[flying] != ids.ravel()[flying]
    owners = ids.copy()
    owners.ravel()[flying[apart]] = NOTHING
    return blended, owners


def add_multipath(
    depth: Float[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], albedo: float
) -> Float[np.ndarray, "h w"]:
    """Depth with what light adds that came by way of another surface: walls of corners bend away from each other.

    One bounce between matt patches. The camera sees the mean of the direct and the longer way, weighted by their light.

    Source: Fuchs, "Multipath interference compensation in time-of-flight camera images" (2010); Jimenez et al. 2014.
    Differs: only patches within about ten degrees are asked, in eight directions and at five distances.

    Args:
        depth: depth image [m].
        intrinsics: camera matrix [pixels].
        albedo: share of the light that the surfaces send on.
    """
    pitch = max(1, round(float(intrinsics[0, 0]) * BOUNCE_ANGLE))
    rows, columns = (np.arange(0, edge + 2 * pitch, pitch) for edge in depth.shape)
    coarse = np.ix_(np.minimum(rows, depth.shape[0] - 1), np.minimum(columns, depth.shape[1] - 1))
    (fx, _, cx), (_, fy, cy), _ = intrinsics
    rays = np.ones((3, len(rows), len(columns)), dtype=np.float32)
    rays[0], rays[1] = (coarse[1] - cx) / fx, (coarse[0] - cy) / fy
    error = _longer_way(rays * depth[coarse], pitch / float(fx), albedo) / np.sqrt(_along(rays, rays))
    fine = stretch(stretch(error.T, np.arange(depth.shape[1]) / pitch).T, np.arange(depth.shape[0]) / pitch)
    return np.where(depth > 0, depth + fine, np.float32(0.0))


def _longer_way(points: Float[np.ndarray, "3 h w"], angle: float, albedo: float) -> Float[np.ndarray, "h w"]:
    """How much farther than they are patches seem to be [m], for their points [m] in the camera frame.

    Args:
        points: of patches side by side; at the camera itself where nothing was measured.
        angle: size of a patch, seen from the camera [rad].
        albedo: share of the light that the surfaces send on.
    """
    normals = np.cross(np.gradient(points, axis=1), np.gradient(points, axis=2), axis=0)
    normals /= np.maximum(np.sqrt(_along(normals, normals)), np.float32(1e-9))
    distance = np.sqrt(_along(points, points))
    cosine = np.maximum(-_along(normals, points) / np.maximum(distance, 1e-3), LEAST_COSINE)
    light, moment = np.zeros_like(distance), np.zeros_like(distance)
    reach = max(RINGS)
    padded = [np.pad(each, [(0, 0)] + [(reach, reach)] * 2) for each in (points, normals, distance[None])]
    for ring in RINGS:
        # A ring stands for all patches from 0.7 to 1.4 of its radius, an eighth of them for each direction.
        solid_angle = np.float32(1.5 * np.pi * (ring * angle) ** 2 / 8.0)
        for row, column in np.ndindex(3, 3):
            if (row, column) != (1, 1):
                first = reach + (row - 1) * ring, reach + (column - 1) * ring
                down, across = (slice(start, start + size) for start, size in zip(first, distance.shape, strict=True))
                other, other_normal, (other_distance,) = (each[:, down, across] for each in padded)
                way = other - points
                length = np.maximum(np.sqrt(_along(way, way)), np.float32(1e-3))
                leaving = np.maximum(_along(normals, way), 0.0) / length
                arriving = np.maximum(-_along(other_normal, way), 0.0) / length
                share = leaving * arriving / (length * length) * (other_distance > 0)
                share *= np.float32(albedo / np.pi) * solid_angle * distance * distance / cosine
                light += share
                moment += share * np.maximum(other_distance + length - distance, 0.0) / 2
    return moment / (1 + light)


def _along(one: Float[np.ndarray, "3 h w"], other: Float[np.ndarray, "3 h w"]) -> Float[np.ndarray, "h w"]:
    """Dot product of each pair of vectors."""
    return one[0] * other[0] + one[1] * other[1] + one[2] * other[2]


def _spread(image: Float[np.ndarray, "h w"], side: np.float32, axis: int) -> Float[np.ndarray, "h w"]:
    """The image, of which each pixel gives the share `side` to the neighbours before and behind it."""
    before, after = [slice(None)] * 2, [slice(None)] * 2
    before[axis], after[axis] = slice(None, -1), slice(1, None)
    flow = (image[tuple(after)] - image[tuple(before)]) * side
    result = image.copy()
    result[tuple(before)] += flow
    result[tuple(after)] -= flow
    return result
