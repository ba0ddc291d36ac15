"""What carries the objects: the plane of a table, of the floor of a bin, of a shelf board, found among several."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.spatial import ConvexHull, KDTree

from icgnet.errors import InputError, TableNotFoundError
from icgnet.geometry.plane import Plane, refined_plane

SAMPLE = 4000
"""Points that planes are looked for in."""
PATCHES, PATCH_POINTS = 400, 24
"""Every hypothesis is the plane through a point and its nearest neighbours, which lie on one surface far more often
than three points of anywhere do."""
TOLERANCE = 0.006
"""How far a point of a plane may be from it [m]."""
RELATIVE_TOLERANCE = 0.01
"""The same at most, as a share of the extent of the cloud."""
FINEST, NOISE_RATIO, FLAT_PATCHES = 0.0025, 3.0, 0.3
"""Planes are fitted to points within a tolerance that follows the noise of the flat patches, but is this at least [m]:
a wider one is met by slanted planes through two levels."""
ALIGNED, FLAT_SHARE = 0.95, 0.5
"""Share of the patches on a plane whose normals must be as alike to its own (cosine); it is smaller in a heap."""
MOST_CANDIDATES = 10
SMALLEST_SHARE, LEAST_SHARE = 0.03, 0.08
"""Share of the sampled points that a candidate must hold, and of all points that a support must hold."""
CELL, FEWEST_IN_CELL, FARTHEST = 0.02, 3, 3.0
"""Extents are measured in cells of this pitch [m] with at least so many points, up to so far from their middle [m]."""
SMALLEST_PIECE = 0.05
"""Pieces of a plane smaller than this share of the largest one are stray points at its height."""

STANDING_HEIGHT = 0.3
"""Points up to this far above a plane, inside of its outline, stand on it [m]."""
STANDING_WEIGHT, MOST_STANDING, BELOW_WEIGHT = 2.0, 0.25, 1.0
"""What such a point counts, next to 1 for a point of the plane, up to which share of all points; and what one counts
against it that is seen below."""
BELOW = 0.02
"""Points so far below a plane, seen so far inside of its outline, are seen through it, if it were there [m]."""
LARGEST_TILT = np.deg2rad(10.0)
"""A support tilted more than this against a given world [rad] means that the camera's pose is wrong; a smaller tilt, of
a pose that is not exact, is followed."""
NOTABLE_TILT = np.deg2rad(3.0)
"""A tilt that is followed, and spoken of [rad]."""
STEEPEST_VIEW = np.deg2rad(80.0)
"""Between a support's normal and the direction towards the camera [rad], when no pose tells what is up."""
DOWNWARD, DOWNWARD_FACTOR = 0.3, 0.6
"""Without a pose: a normal that points down in the picture by more than this belongs to a wall, mostly."""

FURNITURE, FLOOR = 0.10, 0.02
"""A plane of this area [m^2] is no object: what stands on it does not stand on the plane below, which carries it. One
that is enclosed, as the floor of a bin by its walls, need not be as large."""
RIM = 0.02
"""How far around an outline it is looked whether things rise or fall away there [m]."""
ENCLOSED = 0.35
"""Share of the cells around an enclosed plane in which things rise."""
STEP = 0.015
"""Least height of such a plane above the other [m]."""
CARRIED_SHARE, SEEN_THROUGH, LEAST_SCORE = 0.01, 0.02, 0.15
"""Share of all points that must stand on it; of those that may be seen below it, inside of its outline; and what must
speak for it, compared with the other."""
SMALLEST_SUPPORT = 0.12
"""A lone plane narrower than this, with nothing on it, is a face of an object [m]."""
FLATTEST_WALL, SMALLEST_WALL, OUTSIDE = np.deg2rad(35.0), 0.015, 0.8
"""Planes steeper than this [rad] and larger than this [m^2], that share of them beside the support, are walls."""
CLOSE_CALL = 0.5
"""Planes that speak so much for themselves, compared with the one that was chosen, are rivals."""
SAME_ANGLE, SAME_HEIGHT = np.deg2rad(8.0), 0.02
"""Planes that differ by less are one [rad, m]."""


@dataclass(frozen=True, eq=False)
class Support:
    """A plane that may carry the objects.

    Attributes:
        plane: in the frame of the cloud, normal towards the camera or upwards.
        middle: the median of its points [m].
        share: of all points that lie on it.
        area: that is seen of it [m^2].
        standing: share of all points that stand on it.
        below: share of all points that are seen through it, if it were there.
        enclosed: share of what is around it that rises above it.
        tilt: angle of its normal against the z axis of the world or, without a pose, against the direction towards the
            camera [rad].
        score: what speaks for it, see `find_support`.
        outline: where it is.
        rivals: other planes for which nearly as much speaks.
        walls: planes around it that rise from it.
    """

    plane: Plane
    middle: Float[np.ndarray, "3"]
    share: float
    area: float
    standing: float
    below: float
    enclosed: float
    tilt: float
    score: float
    outline: "Outline"
    rivals: tuple["Support", ...] = ()
    walls: tuple[Plane, ...] = ()

    def doubts(self, level: bool) -> tuple[str, ...]:
        """What the caller should know: a tilt against a world said to be level, and a sentence on each rival."""
        tilted = (
            f"the table is tilted by {np.rad2deg(self.tilt):.1f} degrees against the z axis of the world, which is "
            "followed: is the camera pose exact?",
        )
        return (tilted if level and self.tilt > NOTABLE_TILT else ()) + tuple(
            f"the table was a close choice: the plane taken holds {self.share:.0%} of the points (tilt "
            f"{np.rad2deg(self.tilt):.0f} degrees), another one {each.share:.0%} (tilt {np.rad2deg(each.tilt):.0f} "
            f"degrees, {100 * np.abs(self.plane.height(each.middle)):.0f} cm away); name the table by its height or a "
            "mask if the result is wrong"
            for each in self.rivals
        )


def find_support(
    points: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    level: bool,
) -> Support:
    """The plane that carries the objects.

    Of several planes the one counts that holds many points, has many standing on it inside of its outline and none
    seen below it there. With a given world it is level, otherwise it faces the camera. A large plane that carries
    things is preferred to the one that it stands on: a table to the floor of the room.

    Args:
        points: finite points [m].
        viewpoint: camera centre in the same frame [m], if it is known.
        rng: draws the points.
        level: whether the frame's z axis points up.

    Raises:
        TableNotFoundError: no plane could be a support.
        InputError: `level`, but the only support is tilted by more than 10 degrees.
    """
    extent = float(np.linalg.norm(np.subtract(*np.percentile(points, (95, 5), axis=0))))
    # As a share of the extent of the cloud, so that a small ball is not taken for a plane.
    tolerance = min(TOLERANCE, RELATIVE_TOLERANCE * extent)
    planes = _planes(points, viewpoint, rng, tolerance, upwards=level)
    candidates = [_judged(plane, points, viewpoint, tolerance, level) for plane in planes]
    steepest = LARGEST_TILT if level else STEEPEST_VIEW
    usable = [each for each in candidates if each.tilt <= steepest and each.score > 0 and each.share > LEAST_SHARE]
    if not usable:
        tilted = max(candidates, key=lambda each: each.score, default=None)
        if level and tilted is not None and tilted.score > 0.2:
            raise InputError(
                f"the table found is tilted by {np.rad2deg(tilted.tilt):.0f} degrees against the z axis of the world: "
                "correct the camera pose, or leave it out"
            )
        raise TableNotFoundError(_nothing(candidates, points))
    best = max(usable, key=lambda each: each.score)
    while above := [each for each in usable if _carries_instead(each, best)]:
        best = max(above, key=lambda each: each.score)
    if best.standing < CARRIED_SHARE / 2 and best.area < SMALLEST_SUPPORT**2:
        raise TableNotFoundError(_nothing(candidates, points))
    others = [each for each in usable if each.score > CLOSE_CALL * best.score and not _is_same(each, best, points)]
    walls = [each.plane for each in candidates if _is_wall(each, best, points)]
    return replace(best, rivals=tuple(sorted(others, key=lambda each: -each.score)), walls=tuple(walls))


def _nothing(candidates: list[Support], points: Float[np.ndarray, "n 3"]) -> str:
    share = max((each.share for each in candidates), default=0.0)
    return (
        f"no table found: the largest plane that could carry objects holds {share:.0%} of the points; show more of the "
        "table, crop the input to it (--mask), or give the camera pose and the height of the table (--table-height)"
    )


def _planes(
    points: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    coarsest: float,
    upwards: bool,
) -> list[Plane]:
    """The largest planes, each of them without the points of the larger ones."""
    sample = points[rng.permutation(len(points))[:SAMPLE]]
    anchors = sample[: min(PATCHES, len(sample))]
    _, near = KDTree(sample).query(anchors, k=min(PATCH_POINTS, len(sample)))
    patches = sample[near]
    middles = patches.mean(axis=1)
    centred = patches - middles[:, None]
    scatter, directions = np.linalg.eigh(np.einsum("hki,hkj->hij", centred, centred) / centred.shape[1])
    normals = directions[:, :, 0]
    noise = float(np.sqrt(np.quantile(np.maximum(scatter[:, 0], 0.0), FLAT_PATCHES)))
    tolerance = min(max(NOISE_RATIO * noise, FINEST), coarsest)
    up = normals[:, 2] if upwards or viewpoint is None else np.einsum("hd,hd->h", normals, viewpoint - middles)
    normals *= np.where(up < 0, -1.0, 1.0)[:, None]
    distance = (normals @ sample.T - np.einsum("hd,hd->h", normals, middles)[:, None]) / (2 * tolerance)
    weight = np.maximum(1.0 - distance**2, 0.0)  # a plane through two levels is worse than one along either
    left = np.ones(len(sample), dtype=bool)
    found = []
    for _ in range(MOST_CANDIDATES):
        best = int((weight @ left).argmax())
        if ((weight[best] > 0) & left).sum() < max(3, SMALLEST_SHARE * len(sample)):
            break
        start = Plane(normals[best], float(-normals[best] @ middles[best]))
        plane = refined_plane(refined_plane(start, sample[left], 1.5 * tolerance), points, tolerance)
        on_it = np.abs(plane.height(middles)) < 2.0 * tolerance
        if on_it.any() and np.mean(np.abs(normals[on_it] @ plane.normal) > ALIGNED) > FLAT_SHARE:
            found.append(plane)
        # Also those near the hypothesis, should the refined plane have moved away from them.
        left &= (np.abs(plane.height(sample)) > 2.0 * tolerance) & (weight[best] == 0)
    return found


def _judged(
    plane: Plane,
    points: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"] | None,
    tolerance: float,
    level: bool,
) -> Support:
    """What speaks for a plane."""
    height = plane.height(points)
    on = np.abs(height) < tolerance
    middle = np.median(points[on], axis=0) if on.any() else -plane.offset * plane.normal
    outline = Outline.of(plane, points[on])
    inside = outline.beyond(points) <= 0
    standing = inside & (height > TOLERANCE + tolerance) & (height < STANDING_HEIGHT)
    below = (height < -BELOW) & (outline.beyond(crossings(plane, points, viewpoint)) <= -BELOW)
    if level or viewpoint is None:
        tilt, factor = float(np.arccos(np.clip(plane.normal[2], -1.0, 1.0))), 1.0
    else:
        towards = viewpoint - middle
        tilt = float(np.arccos(np.clip(plane.normal @ towards / np.linalg.norm(towards), -1.0, 1.0)))
        factor = DOWNWARD_FACTOR if plane.normal[1] > DOWNWARD else 1.0  # the camera's y axis points down
    score = (on & inside).mean() + STANDING_WEIGHT * min(standing.mean(), MOST_STANDING) - BELOW_WEIGHT * below.mean()
    return Support(
        plane,
        middle,
        float(on.mean()),
        outline.area,
        float(standing.mean()),
        float(below.mean()),
        outline.enclosed(points, height),
        tilt,
        factor * float(score),
        outline,
    )


def crossings(
    plane: Plane, points: Float[np.ndarray, "n 3"], viewpoint: Float[np.ndarray, "3"] | None
) -> Float[np.ndarray, "n 3"]:
    """Where the lines of sight to points below a plane cross it; right above them if the viewpoint is not known."""
    if viewpoint is None or (eye := float(plane.height(viewpoint))) <= 0:
        return points
    height = plane.height(points)
    share = np.clip(height / (height - eye), 0.0, 1.0)
    return points + share[:, None] * (viewpoint - points)


def _carries_instead(upper: Support, lower: Support) -> bool:
    """Whether things stand on the upper plane, which itself stands on the lower one and is too large for an object."""
    if upper is lower or upper.plane.normal @ lower.plane.normal < np.cos(SAME_ANGLE):
        return False
    step = float(lower.plane.height(upper.middle))
    is_large = upper.area > (FLOOR if upper.enclosed > ENCLOSED else FURNITURE)
    is_there = upper.below < SEEN_THROUGH and upper.score > LEAST_SCORE * lower.score
    return bool(step > STEP and is_large and is_there and upper.standing > CARRIED_SHARE)


def _is_wall(one: Support, support: Support, points: Float[np.ndarray, "n 3"]) -> bool:
    """Whether a plane rises from the support, nearly all of it outside of its outline, and is no face of an object."""
    if one is support or one.plane.normal @ support.plane.normal > np.cos(FLATTEST_WALL):
        return False
    own = points[np.abs(one.plane.height(points)) < TOLERANCE]
    return bool(one.area > SMALLEST_WALL and np.mean(support.outline.beyond(own) > 0) > OUTSIDE)


def _is_same(one: Support, other: Support, points: Float[np.ndarray, "n 3"]) -> bool:
    """Whether two planes are one within the error of a fit, where the points of the first are."""
    if one is other:
        return True
    own = points[np.abs(one.plane.height(points)) < TOLERANCE]
    is_parallel = one.plane.normal @ other.plane.normal > np.cos(SAME_ANGLE)
    return bool(is_parallel and np.median(np.abs(other.plane.height(own))) < SAME_HEIGHT)


@dataclass(frozen=True, eq=False)
class Outline:
    """Where a plane is, as far as it is seen: the convex hull of its pieces, in the axes of the plane.

    Objects hide what lies between the pieces, and so do their shadows.

    Attributes:
        axes: [2 3] unit vectors in the plane.
        sides: outward unit normal and offset of each side of the hull; none if nothing is seen of the plane.
        area: what is seen of the plane [m^2].
    """

    axes: Float[np.ndarray, "2 3"]
    sides: Float[np.ndarray, "s 3"]
    area: float

    @staticmethod
    def of(plane: Plane, points: Float[np.ndarray, "n 3"]) -> "Outline":
        """The outline of a plane from its own points; pieces much smaller than the largest are none of it."""
        across = np.eye(3)[np.abs(plane.normal).argmin()]
        x = across - plane.normal * (across @ plane.normal)
        x /= np.linalg.norm(x)
        axes = np.stack([x, np.cross(plane.normal, x)])
        places = points @ axes.T
        nothing = Outline(axes, np.zeros((0, 3)), 0.0)
        if len(places) == 0:
            return nothing
        places = places[np.abs(places - np.median(places, axis=0)).max(axis=1) < FARTHEST]
        lower = places.min(axis=0)
        cells = np.floor((places - lower) / CELL).astype(np.int64)
        counts = np.zeros(cells.max(axis=0) + 1, dtype=np.int64)
        np.add.at(counts, tuple(cells.T), 1)
        # Objects and their shadows cut a table in pieces; stray points at its height elsewhere are small pieces.
        closed = ndimage.binary_closing(np.pad(counts >= FEWEST_IN_CELL, 2), np.ones((3, 3)))[2:-2, 2:-2]
        pieces = np.zeros(closed.shape, dtype=np.int32)
        ndimage.label(closed, structure=np.ones((3, 3)), output=pieces)
        sizes = np.bincount(pieces.ravel())
        sizes[0] = 0
        large = sizes >= max(1.0, SMALLEST_PIECE * sizes.max())
        if not large.any():
            return nothing
        of_hull = np.argwhere(large[pieces])[:, None] + np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
        hull = ConvexHull(lower + CELL * of_hull.reshape(-1, 2))
        area = float((large[pieces] & (counts >= FEWEST_IN_CELL)).sum()) * CELL**2
        return Outline(axes, hull.equations, area)

    def beyond(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """How far points lie outside of the hull, along the plane [m]; negative inside."""
        places = points @ self.axes.T
        distance = np.full(len(points), -np.inf if len(self.sides) else np.inf)
        for side in self.sides:
            np.maximum(distance, places @ side[:2] + side[2], out=distance)
        return distance

    def enclosed(self, points: Float[np.ndarray, "n 3"], height: Float[np.ndarray, "n"]) -> float:
        """Share of the rim around the hull, of what is seen there, in which things rise above the plane.

        Args:
            points: the whole cloud [m].
            height: of the points above the plane [m].
        """
        if len(self.sides) == 0:
            return 0.0
        beyond = self.beyond(points)
        rim = (beyond > 0) & (beyond < RIM) & (np.abs(height) > TOLERANCE) & (height < STANDING_HEIGHT)
        cells = np.floor(points[rim] @ self.axes.T / CELL).astype(np.int64)
        _, cell = np.unique(cells, axis=0, return_inverse=True)
        rises = np.bincount(cell.ravel(), weights=height[rim] > 0)
        return float((rises >= FEWEST_IN_CELL).mean()) if len(rises) else 0.0
