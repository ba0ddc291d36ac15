"""What a depth image itself tells of its sensor: noise of flat parts, steps, holes, and what edges look like.

Every length is in pixels of the sensor's own image, also where the image was warped into that of another camera.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from icgnet.geometry.camera import pixel_rays

WINDOW, LARGE_WINDOW = 15, 45
"""Edges of the windows to which planes are fitted [pixels]."""
STRIDE = 0.5
"""Distance of neighbouring windows, in edges."""
ROUGH = 0.012
"""A window from whose plane points stand off more than this times the depth squared (root mean square) is not flat."""
FEWEST_WINDOWS = 20
LAG = 4
"""The correlation is asked for one pixel and this many pixels apart."""
JUMP = 0.03
"""Depth edges are steps of at least this [m]."""
ALIKE = 0.02
"""Depths around a hole that differ by less than this belong to one surface [m]."""
FAR = 2.0
"""What is farther away is background and does not count [m]."""
WIDEST_HOLE = 100
"""Wider holes have other reasons, such as what was cut away [pixels]."""
BESIDE, STEADY = 6, 3
"""The surfaces at an edge are looked at this many measured pixels beside it, where they must be steady for so many."""
BETWEEN = 0.15
"""A pixel between two surfaces is farther than this share of the step from either ..."""
APART = 0.1
"""... and this far from the pixels beside it, unlike those of a curved side."""
FEWEST_EDGES = 20


@dataclass(frozen=True)
class FrameMeasures:
    """Of one depth image; None where it shows too little of something.

    Attributes:
        smaller: by how much the image is smaller than the sensor's own.
        distance: median depth [m].
        tilt: median angle between line of sight and normal of flat parts [degrees].
        noise: median standard deviation from the plane of a window of 15 pixels, over the depth squared [mm/m^2].
        ripple: the same for windows of 45 pixels.
        alike_1: correlation of the errors of pixels one apart in a row.
        alike_4: the same four apart.
        alike_down: the same four apart in a column.
        step: mean difference between neighbouring depths that occur near the median depth [mm].
        holes: share of pixels without depth, in holes that are not wider than 100 pixels.
        holes_inside: share of pixels without depth in the middle of surfaces.
        holes_shadow: pixels without depth at an edge, on the side of objects that has more of them, mean.
        holes_lit: the same on the other side.
        shadow_baseline: baseline at which shadows would be as wide as the difference of the sides [m].
        flying: pixels between the surfaces at an edge, mean over both sides.
        ragged: standard deviation by which edges of neighbouring rows are displaced [pixels].
    """

    smaller: int
    distance: float
    tilt: float | None
    noise: float | None
    ripple: float | None
    alike_1: float | None
    alike_4: float | None
    alike_down: float | None
    step: float | None
    holes: float
    holes_inside: float
    holes_shadow: float | None
    holes_lit: float | None
    shadow_baseline: float | None
    flying: float | None
    ragged: float | None


@dataclass(frozen=True, eq=False)
class FrameSamples:
    """The single values that most of the measures are medians and means of.

    Attributes:
        noise: [n] of each flat window [mm/m^2].
        alike: [n] correlation of the errors of pixels four apart, of each flat window.
        holes: [m] pixels without depth at each edge.
        flying: [m] pixels between the surfaces of each edge.
    """

    noise: Float[np.ndarray, "n"]
    alike: Float[np.ndarray, "n"]
    holes: Float[np.ndarray, "m"]
    flying: Float[np.ndarray, "m"]


@dataclass(frozen=True, eq=False)
class Edges:
    """Depth edges along the rows of an image.

    Attributes:
        row: [n] row of each.
        place: [n] column of the last pixel of the nearer surface.
        right: [n] whether the nearer surface lies to the left, so that this is the right side of an object.
        near: [n] depth of the nearer surface [m].
        far: [n] depth of the other one [m].
        holes: [n] pixels without depth around the edge.
        flying: [n] pixels between the surfaces.
    """

    row: Int[np.ndarray, "n"]
    place: Int[np.ndarray, "n"]
    right: Bool[np.ndarray, "n"]
    near: Float[np.ndarray, "n"]
    far: Float[np.ndarray, "n"]
    holes: Int[np.ndarray, "n"]
    flying: Int[np.ndarray, "n"]


def measure_frame(
    depth: Float[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], focal: float
) -> tuple[FrameMeasures, FrameSamples]:
    """All measures of an image.

    Args:
        depth: depth image [m], 0 or NaN where nothing was measured.
        intrinsics: camera matrix of the image [pixels].
        focal: focal length of the sensor's own image [pixels].
    """
    depth = np.where((depth > 0) & (depth < FAR), depth, 0.0)
    distance = float(np.median(depth[depth > 0])) if (depth > 0).any() else 0.0
    scale = focal / float(intrinsics[0, 0])
    near, far = (max(1, round(lag / scale)) for lag in (1, LAG))
    lags = ((0, near), (0, far), (far, 0))
    noise, tilt, alike = flat_windows(depth, intrinsics, max(7, round(WINDOW / scale)), lags)
    ripple, _, _ = flat_windows(depth, intrinsics, max(7, round(LARGE_WINDOW / scale)), lags)
    flat = len(noise) >= FEWEST_WINDOWS
    edges = find_edges(depth)
    left, right = (edges.right == side for side in (False, True))
    enough = min(left.sum(), right.sum()) >= FEWEST_EDGES
    lit, shadow = sorted((edges.holes[left].mean(), edges.holes[right].mean())) if enough else (0.0, 0.0)
    shaded = right if enough and edges.holes[right].mean() > edges.holes[left].mean() else left
    wide = (1 / edges.near - 1 / edges.far)[shaded] * float(intrinsics[0, 0])
    measures = FrameMeasures(
        max(1, round(scale)),
        distance,
        float(np.median(tilt)) if flat else None,
        float(np.median(noise)) if flat else None,
        float(np.median(ripple)) if len(ripple) >= FEWEST_WINDOWS else None,
        float(np.median(alike[:, 0])) if flat else None,
        float(np.median(alike[:, 1])) if flat else None,
        float(np.median(alike[:, 2])) if flat else None,
        depth_step(depth, distance),
        *holes(depth),
        float(shadow * scale) if enough else None,
        float(lit * scale) if enough else None,
        float(np.median((edges.holes[shaded] - lit) / wide)) if enough else None,
        float(edges.flying.mean() * scale) if enough else None,
        _raggedness(edges, max(1, round(1 / scale)), scale),
    )
    return measures, FrameSamples(noise, alike[:, 1], edges.holes * scale, edges.flying * scale)


def flat_windows(
    depth: Float[np.ndarray, "h w"], intrinsics: Float[np.ndarray, "3 3"], edge: int, lags: tuple[tuple[int, int], ...]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"], Float[np.ndarray, "n l"]]:
    """Of each flat window: noise [mm/m^2], angle to the line of sight [degrees], correlations at each lag."""
    step = max(1, round(edge * STRIDE))
    windows = np.lib.stride_tricks.sliding_window_view(depth, (edge, edge))[::step, ::step].reshape(-1, edge, edge)
    rays = pixel_rays(intrinsics, (depth.shape[0], depth.shape[1]))
    slopes = np.lib.stride_tricks.sliding_window_view(rays, (edge, edge), axis=(0, 1))[::step, ::step]
    slopes = np.moveaxis(slopes, 2, -1).reshape(-1, edge, edge, 3)
    whole = (windows > 0).all(axis=(1, 2))
    windows, slopes = windows[whole], slopes[whole]
    # On a plane the inverse depth is linear in the rays.
    inverse = (1 / windows).reshape(len(windows), edge * edge, 1)
    design = slopes.reshape(len(windows), edge * edge, 3)
    gram = design.swapaxes(1, 2) @ design
    normals = np.linalg.solve(gram, design.swapaxes(1, 2) @ inverse)
    errors = windows - 1 / np.maximum((design @ normals).reshape(windows.shape), 1e-3)
    mean = windows.mean(axis=(1, 2))
    noise = np.sqrt((errors**2).mean(axis=(1, 2))) / mean**2
    flat = (noise > 0) & (noise < ROUGH)
    errors, middle = errors[flat], slopes[flat][:, edge // 2, edge // 2]
    cosine = np.einsum("ni,ni->n", normals[flat, :, 0], middle)
    cosine /= np.linalg.norm(normals[flat, :, 0], axis=1) * np.linalg.norm(middle, axis=1)
    power = (errors**2).mean(axis=(1, 2))
    alike = [
        (errors[:, down:, right:] * errors[:, : edge - down, : edge - right]).mean(axis=(1, 2)) / power
        for down, right in lags
    ]
    return 1000 * noise[flat], np.degrees(np.arccos(np.clip(cosine, -1, 1))), np.stack(alike, axis=1)


def depth_step(depth: Float[np.ndarray, "h w"], distance: float) -> float | None:
    """Mean difference of neighbouring depths [mm] among all that occur within 3 % of a distance [m]."""
    levels = np.unique(np.round(depth[np.abs(depth - distance) < 0.03 * distance], 5))
    return None if len(levels) < 3 else float(1000 * (levels[-1] - levels[0]) / (len(levels) - 1))


def holes(depth: Float[np.ndarray, "h w"]) -> tuple[float, float]:
    """Share of pixels without depth between measured ones in the same row, and of those of them on one surface."""
    rows, columns = np.nonzero(depth)
    values = depth[rows, columns]
    gap = np.diff(columns) - 1
    hole = (np.diff(rows) == 0) & (gap > 0) & (gap <= WIDEST_HOLE)
    inside = hole & (np.abs(np.diff(values)) < ALIKE)
    pixels = max(1, int(gap[hole].sum()) + len(values))
    return float(gap[hole].sum() / pixels), float(gap[inside].sum() / pixels)


def find_edges(depth: Float[np.ndarray, "h w"]) -> Edges:
    """The depth edges along rows between steady surfaces nearer than `FAR`; holes and flying pixels may lie on them."""
    found = []
    for row in range(depth.shape[0]):
        columns = np.flatnonzero(depth[row])
        if len(columns) <= 2 * (BESIDE + STEADY):
            continue
        values = depth[row, columns]
        jump = np.abs(np.diff(values))
        index = np.arange(BESIDE + STEADY, len(jump) - BESIDE - STEADY)
        around = np.lib.stride_tricks.sliding_window_view(jump, 2 * BESIDE + 1).max(axis=1)
        index = index[(jump[index] > JUMP / 3) & (jump[index] == around[index - BESIDE])]
        before, after = index - BESIDE, index + 1 + BESIDE
        step = values[after] - values[before]
        steady = np.abs(values[before] - values[before - STEADY]) < 0.2 * np.abs(step)
        steady &= np.abs(values[after] - values[after + STEADY]) < 0.2 * np.abs(step)
        holes = columns[after] - columns[before] - (2 * BESIDE + 1)
        kept = (np.abs(step) > JUMP) & steady & (holes <= WIDEST_HOLE)
        for first, last, hole in zip(before[kept], after[kept], holes[kept], strict=True):
            part = values[first : last + 1] if values[last] > values[first] else values[last : first - 1 : -1]
            share = (part - part[0]) / (part[-1] - part[0])
            apart = np.diff(share) > APART
            flying = (share[1:-1] > BETWEEN) & (share[1:-1] < 1 - BETWEEN) & apart[1:] & apart[:-1]
            nearest, farthest = np.flatnonzero(share < BETWEEN)[-1], np.flatnonzero(share > 1 - BETWEEN)[0]
            right = bool(values[last] > values[first])
            place = columns[first + nearest if right else last - nearest]
            found.append((row, place, right, part[nearest], part[farthest], hole, flying.sum()))
    row, place, right, near, far, holes, flying = np.array(found).T if found else np.zeros((7, 0))
    whole = (each.astype(np.int64) for each in (row, place, holes, flying))
    row, place, holes, flying = whole
    return Edges(row, place, right > 0, near, far, holes, flying)


def _raggedness(edges: Edges, distance: int, scale: float) -> float | None:
    """From how much the place of an edge differs from the middle of the places some rows above and below [pixels]."""
    places: dict[tuple[int, bool], list[int]] = {}
    for row, right, place in zip(edges.row.tolist(), edges.right.tolist(), edges.place.tolist(), strict=True):
        places.setdefault((row, right), []).append(place)
    bends = []
    for (row, right), here in places.items():
        others = [places.get((row + side * distance, right), []) for side in (-1, 1)]
        for place in here:
            above, below = ([each for each in other if abs(each - place) <= 4 * distance] for other in others)
            if len(above) == len(below) == 1:
                bends.append(above[0] - 2 * place + below[0])
    if len(bends) < FEWEST_EDGES:
        return None
    # Of three independent places with standard deviation s, this difference has one of sqrt(6) s.
    return float(np.std(bends) / np.sqrt(6.0) * scale)
