"""The cloud in a frame that stands on the table, and which of its points stand on the table."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from icgnet.errors import InputError, TableNotFoundError
from icgnet.geometry.clouds import UP, PointCloud, voxel_downsample
from icgnet.geometry.plane import table_frame
from icgnet.geometry.transforms import invert_transform, make_transform
from icgnet.geometry.workspace import TABLE_HEIGHT, above_table
from icgnet.inference.support import BELOW, Support, crossings, find_support

FIT_POINTS = 50_000
"""Points at most that the support is looked for in."""
AROUND_MASK, MASK_PITCH = 0.05, 0.01
"""The support is looked for in what a mask allows and this far around it [m], to this precision [m]."""
REACH, HIGHEST = 1.0, 0.65
"""What is farther than this from the middle of everything on the table, or higher above it [m], is not looked at."""
CELL = 0.004
"""Noise is told from things in a grid of this pitch [m] or, for a coarse cloud, of twice its spacing."""
SPACING_POINTS = 500
"""Points at most whose neighbours are looked for, to learn the spacing of the cloud."""
FEWEST_NEIGHBOURS = 4
"""An occupied cell with fewer occupied ones around it is a flying pixel; on a surface there are eight or more."""
FEWEST_CELLS = 16
"""Smaller connected things are noise."""
LOWEST_THING = 0.007
"""A connected thing that nowhere rises more than this above the table is a wave in the depth of the table [m]."""
NOISE_RATIO = 4.0
"""The same in standard deviations of the table's points from the plane; the larger of both counts."""
DEEPEST_WAVE = 0.015
"""Points farther below the plane are not the table [m]."""
TABLE_BORDER = 0.01
"""So far beyond what is seen of the table a thing still stands on it [m]."""
MOSTLY = 0.5
"""A connected thing of which more than this share is above the table stands on it, also with what sticks out."""
BESIDE, FOOT, LARGEST_BESIDE, WALLED_IN = 0.08, 0.1, 0.4, 0.75
"""A connected thing so near to what is seen of the table, that begins so low above its plane and is no wider than that
[m] stands on it, since things in front hide the table; but not where things rise around that share of the table."""
NEAR_WALL = 0.01
"""Points so near to a wall are the wall [m]."""
CLOSE, CLEAR_SHARE, CLEAR_AREA = 0.015, 0.3, 0.05
"""A given height contradicts the picture when a level plane with that share of the points and that area [m^2] is
farther from it than this [m], and none is nearer."""


@dataclass(frozen=True, eq=False)
class Tabletop:
    """A cloud in the table frame: z up, table plane at z = `TABLE_HEIGHT`.

    Attributes:
        cloud: all finite points of the input, and the viewpoint.
        above: rows of the points above the table that are not noise: whatever a hand could hit.
        standing: those of them that may belong to objects on the table.
        T_frame_table: pose of the table frame in the frame of the input.
        support: the plane that was found; None if its height was given.
        warnings: what speaks against the plane, one sentence each.
    """

    cloud: PointCloud
    above: Int[np.ndarray, "a"]
    standing: Int[np.ndarray, "m"]
    T_frame_table: Float[np.ndarray, "4 4"]
    support: Support | None = None
    warnings: tuple[str, ...] = ()


def find_tabletop(
    cloud: PointCloud,
    table_height: float | None,
    rng: np.random.Generator,
    level: bool = True,
    mask: Bool[np.ndarray, "n"] | None = None,
) -> Tabletop:
    """The cloud in the table frame.

    Args:
        cloud: finite points [m], in a frame whose z axis points up if `level`.
        table_height: height of the table plane in that frame [m]; if None the table is found in the cloud, and what
            stands beside it is not taken for objects.
        rng: draws the points that the table is looked for in.
        level: whether the input's z axis points up; then the table frame is shifted against it, and tilted as far as a
            table that is looked for is.
        mask: which points may belong to objects; all if None. The table is looked for there and around it.

    Raises:
        TableNotFoundError: no plane could be the table.
        InputError: `level`, but the table is tilted by more than 10 degrees.
    """
    sample = _sample(cloud, mask)
    # Without a viewpoint the frame is the camera's own, unless it is known to be level.
    viewpoint = np.zeros(3) if cloud.viewpoint is None and not level else cloud.viewpoint
    support, warnings = None, ()
    if table_height is None:
        support = find_support(sample, viewpoint, rng, level)
        warnings = support.doubts(level)
        T_frame_table = _tilted(support, sample) if level else invert_transform(table_frame(support.plane, sample))
    else:
        T_frame_table = _shifted_up(table_height)
        warnings = _contradiction(table_height, sample, viewpoint, rng)
    in_table = cloud.transformed(invert_transform(T_frame_table), "table")
    points = in_table.points
    rows = np.flatnonzero(above_table(points) & (points[:, 2] < TABLE_HEIGHT + HIGHEST))
    lowest_top = TABLE_HEIGHT + max(LOWEST_THING, NOISE_RATIO * _table_noise(points[:, 2]))
    thing = _things(points[rows], lowest_top)
    above, thing = rows[thing >= 0], thing[thing >= 0]
    may_be_object = np.ones(len(above), dtype=bool) if mask is None else mask[above]
    if support is not None:
        may_be_object &= _on_support(support, cloud, above, thing)
    return Tabletop(in_table, above, above[may_be_object], T_frame_table, support, warnings)


def _sample(cloud: PointCloud, mask: Bool[np.ndarray, "n"] | None) -> Float[np.ndarray, "m 3"]:
    """The points that the table is looked for in."""
    sample = cloud.points[:: -(-len(cloud) // FIT_POINTS)]
    if mask is None or not mask.any():
        return sample
    allowed, _ = voxel_downsample(cloud.points[mask], MASK_PITCH)
    near = np.isfinite(KDTree(allowed).query(sample, distance_upper_bound=AROUND_MASK)[0])
    return sample[near] if near.any() else sample


def _contradiction(
    height: float,
    points: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
) -> tuple[str, ...]:
    """What the picture says against a given height of the table."""
    try:
        support = find_support(points, viewpoint, rng, level=True)
    except (TableNotFoundError, InputError):
        return ()
    planes = [each for each in (support, *support.rivals) if each.share > CLEAR_SHARE and each.area > CLEAR_AREA]
    offs = [float(each.middle[2]) - height for each in planes]
    if not offs or min(map(abs, offs)) < CLOSE:
        return ()
    return (
        f"the table's height is given as {height:.3f} m, but a level plane with {planes[0].share:.0%} of the points "
        f"is seen at {height + offs[0]:.3f} m",
    )


def _tilted(support: Support, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "4 4"]:
    """The frame with z = `TABLE_HEIGHT` on the plane, and x and y as in the input at the middle of the points."""
    plane = support.plane
    x, y = np.median(points[:, :2], axis=0)
    height = -(plane.normal[0] * x + plane.normal[1] * y + plane.offset) / plane.normal[2]
    R_frame_table = Rotation.from_rotvec(np.cross(UP, plane.normal) / np.sinc(support.tilt / np.pi)).as_matrix()
    return make_transform(R_frame_table, np.array([x, y, height]) - R_frame_table @ [x, y, TABLE_HEIGHT])


def _shifted_up(table_height: float) -> Float[np.ndarray, "4 4"]:
    return make_transform(np.eye(3), np.array([0.0, 0.0, table_height - TABLE_HEIGHT]))


def _table_noise(heights: Float[np.ndarray, "n"]) -> float:
    """Standard deviation of the table's points from its plane [m], told from the side where no object can be."""
    below = heights[(heights < TABLE_HEIGHT) & (heights > TABLE_HEIGHT - DEEPEST_WAVE)] - TABLE_HEIGHT
    return float(np.sqrt(np.mean(below**2))) if len(below) else 0.0


def _things(points: Float[np.ndarray, "n 3"], lowest_top: float) -> Int[np.ndarray, "n"]:
    """Number of the connected thing that each of the points above the table belongs to; -1 for noise.

    Things are within reach and rise above `lowest_top`.
    """
    thing = np.full(len(points), -1, dtype=np.int64)
    if len(points) == 0:
        return thing
    near = np.flatnonzero(np.abs(points[:, :2] - _middle(points[:, :2])).max(axis=1) < REACH)
    cells = np.floor(points[near] / max(CELL, 2.0 * _spacing(points[near]))).astype(np.int64)
    # One empty cell around everything, so that no neighbour's key is that of a cell on the other side.
    cells += 1 - cells.min(axis=0)
    shape = cells.max(axis=0) + 2
    keys, cell_of = np.unique(np.ravel_multi_index(tuple(cells.T), tuple(shape)), return_inverse=True)
    first, second = _neighbours(keys, shape)
    crowded = np.bincount(np.concatenate([first, second]), minlength=len(keys)) >= FEWEST_NEIGHBOURS
    linked = crowded[first] & crowded[second]
    links = coo_array((np.ones(linked.sum()), (first[linked], second[linked])), shape=(len(keys), len(keys)))
    count, label = connected_components(links, directed=False)
    sizes = np.bincount(label, weights=crowded, minlength=count)
    label = label[cell_of.ravel()]
    tops = np.zeros(count)
    np.maximum.at(tops, label, points[near, 2])
    is_thing = (sizes >= FEWEST_CELLS) & (tops > lowest_top)
    thing[near] = np.where(is_thing[label], label, -1)
    return thing


def _neighbours(
    keys: Int[np.ndarray, "c"], shape: Int[np.ndarray, "3"]
) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
    """All pairs of occupied cells that touch, by their sorted keys; each pair once."""
    first, second = [], []
    steps = np.array([step for step in np.ndindex(3, 3, 3) if step > (1, 1, 1)]) - 1
    for offset in steps @ np.array([shape[1] * shape[2], shape[2], 1]):
        place = np.searchsorted(keys, keys + offset)
        found = np.flatnonzero(keys[np.minimum(place, len(keys) - 1)] == keys + offset)
        first.append(found)
        second.append(place[found])
    return np.concatenate(first), np.concatenate(second)


def _on_support(
    support: Support, cloud: PointCloud, above: Int[np.ndarray, "a"], thing: Int[np.ndarray, "a"]
) -> Bool[np.ndarray, "a"]:
    """Which of the points above the plane may belong to objects that stand on it.

    Those over the hull of what is seen of it, the whole of things that are mostly there, and things that stand right
    beside it, where others may hide the table, unless something encloses it or it is seen to end; but not the walls
    around.

    Args:
        support: the plane, and the walls that were seen.
        cloud: the frame of the support.
        above: rows of the points above the plane.
        thing: number of the connected thing of each.
    """
    points = cloud.points[above]
    beyond, places = support.outline.beyond(points), points @ support.outline.axes.T
    over = beyond <= TABLE_BORDER
    ends = KDTree(_seen_ends(support, cloud))
    belongs = np.zeros(len(points), dtype=bool)
    for number in np.unique(thing):
        own = np.flatnonzero(thing == number)
        stands_beside = (
            support.enclosed < WALLED_IN
            and beyond[own].min() < BESIDE
            and support.plane.height(points[own]).min() < FOOT
            and np.ptp(places[own], axis=0).max() < LARGEST_BESIDE
            and np.isfinite(ends.query(places[own[::5]], distance_upper_bound=BESIDE)[0]).mean() < MOSTLY
        )
        belongs[own] = over[own].mean() > MOSTLY or stands_beside
    is_wall = np.zeros(len(points), dtype=bool)
    for wall in support.walls:
        is_wall |= np.abs(wall.height(points)) < NEAR_WALL
    return over | (belongs & ~is_wall)


def _seen_ends(support: Support, cloud: PointCloud) -> Float[np.ndarray, "n 2"]:
    """Places beside the table where something below its plane is seen: there is none of it."""
    sample = cloud.points[:: -(-len(cloud) // FIT_POINTS)]
    height = support.plane.height(sample)
    below = sample[height < -BELOW]
    places = crossings(support.plane, below, cloud.viewpoint) @ support.outline.axes.T
    return np.unique(np.round(places, 2), axis=0).reshape(-1, 2)


def _middle(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2"]:
    """The point nearest to the median: the median itself may lie far from all, between two groups of points."""
    return points[np.abs(points - np.median(points, axis=0)).max(axis=1).argmin()]


def _spacing(points: Float[np.ndarray, "n 3"]) -> float:
    """Typical distance of a point to its nearest neighbour [m]."""
    tree = KDTree(points, leafsize=32, balanced_tree=False, compact_nodes=False)
    distance, _ = tree.query(points[:: -(-len(points) // SPACING_POINTS)], k=2)
    return float(np.median(distance[:, 1])) if len(points) > 1 else 0.0
