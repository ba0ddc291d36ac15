"""The cloud in a frame that stands on the table, and which of its points stand on the table."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.spatial import ConvexHull, KDTree
from scipy.spatial.transform import Rotation

from icgnet.errors import InputError, TableNotFoundError
from icgnet.geometry.clouds import UP, PointCloud
from icgnet.geometry.plane import Plane, fit_table_plane, table_frame
from icgnet.geometry.transforms import invert_transform, make_transform
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT, above_table

LARGEST_TILT = np.deg2rad(10.0)
"""A table tilted more than this against a given world [rad] means that the camera's pose is wrong; a smaller tilt, of a
pose that is not exact, is followed."""
FIT_POINTS = 50_000
"""Points at most that the table is fitted to."""
REACH = 1.0
"""What is farther than this from the middle of everything on the table [m] is not looked at."""
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

TABLE_TOLERANCE = 0.006
"""Points nearer to the plane than this are the table [m]."""
TABLE_CELL = 0.02
FEWEST_IN_CELL = 3
"""The extent of the table is measured in cells of this pitch [m] with at least so many of its points."""
TABLE_BORDER = 0.01
"""So far beyond what is seen of the table a thing still stands on it [m]."""


@dataclass(frozen=True, eq=False)
class Tabletop:
    """A cloud in the table frame: z up, table plane at z = `TABLE_HEIGHT`.

    Attributes:
        cloud: all finite points of the input, and the viewpoint.
        above: rows of the points above the table that are not noise: whatever a hand could hit.
        standing: those of them that may belong to objects on the table.
        T_frame_table: pose of the table frame in the frame of the input.
    """

    cloud: PointCloud
    above: Int[np.ndarray, "a"]
    standing: Int[np.ndarray, "m"]
    T_frame_table: Float[np.ndarray, "4 4"]


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
        rng: draws the planes that are tried.
        level: whether the input's z axis points up; then the table frame is shifted against it, and tilted as far as a
            table that is looked for is.
        mask: which points may belong to objects; all if None.

    Raises:
        TableNotFoundError: no plane is supported by enough points.
        InputError: `level`, but the table is tilted by more than 10 degrees.
    """
    T_frame_table = _fitted_frame(cloud, rng, level) if table_height is None else _shifted_up(table_height)
    in_table = cloud.transformed(invert_transform(T_frame_table), "table")
    points = in_table.points
    rows = np.flatnonzero(above_table(points) & (points[:, 2] < SIZE))
    lowest_top = TABLE_HEIGHT + max(LOWEST_THING, NOISE_RATIO * _table_noise(points[:, 2]))
    above = rows[_things(points[rows], lowest_top)]
    may_be_object = np.ones(len(above), dtype=bool) if mask is None else mask[above]
    if table_height is None:
        may_be_object &= _over_table(points, above)
    return Tabletop(in_table, above, above[may_be_object], T_frame_table)


def _fitted_frame(cloud: PointCloud, rng: np.random.Generator, level: bool) -> Float[np.ndarray, "4 4"]:
    # Without a viewpoint the frame is the camera's own, unless it is known to be level.
    viewpoint = np.zeros(3) if cloud.viewpoint is None and not level else cloud.viewpoint
    sample = cloud.points[:: -(-len(cloud) // FIT_POINTS)]
    try:
        plane = fit_table_plane(sample, viewpoint, rng)
    except TableNotFoundError as error:
        raise TableNotFoundError(f"{error}; or give the height of the table (--table-height)") from error
    if not level:
        return invert_transform(table_frame(plane, sample))
    tilt = float(np.arccos(np.clip(plane.normal[2], -1.0, 1.0)))
    if tilt > LARGEST_TILT:
        raise InputError(
            f"the table found is tilted by {np.rad2deg(tilt):.0f} degrees against the z axis of the world: "
            "correct the camera pose, or leave it out"
        )
    return _tilted(plane, tilt, sample)


def _tilted(plane: Plane, tilt: float, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "4 4"]:
    """The frame with z = `TABLE_HEIGHT` on the plane, and x and y as in the input at the middle of the points."""
    x, y = np.median(points[:, :2], axis=0)
    height = -(plane.normal[0] * x + plane.normal[1] * y + plane.offset) / plane.normal[2]
    R_frame_table = Rotation.from_rotvec(np.cross(UP, plane.normal) / np.sinc(tilt / np.pi)).as_matrix()
    return make_transform(R_frame_table, np.array([x, y, height]) - R_frame_table @ [x, y, TABLE_HEIGHT])


def _shifted_up(table_height: float) -> Float[np.ndarray, "4 4"]:
    return make_transform(np.eye(3), np.array([0.0, 0.0, table_height - TABLE_HEIGHT]))


def _table_noise(heights: Float[np.ndarray, "n"]) -> float:
    """Standard deviation of the table's points from its plane [m], told from the side where no object can be."""
    below = heights[(heights < TABLE_HEIGHT) & (heights > TABLE_HEIGHT - DEEPEST_WAVE)] - TABLE_HEIGHT
    return float(np.sqrt(np.mean(below**2))) if len(below) else 0.0


def _things(points: Float[np.ndarray, "n 3"], lowest_top: float) -> Bool[np.ndarray, "n"]:
    """Which of the points above the table belong to things within reach that rise above `lowest_top`, not to noise."""
    kept = np.zeros(len(points), dtype=bool)
    if len(points) == 0:
        return kept
    near = np.flatnonzero(np.abs(points[:, :2] - _middle(points[:, :2])).max(axis=1) < REACH)
    cells = np.floor(points[near] / max(CELL, 2.0 * _spacing(points[near]))).astype(np.int64)
    # One empty cell around everything, so that no neighbourhood leaves the grid.
    cells += 1 - cells.min(axis=0)
    occupied = np.zeros(cells.max(axis=0) + 2, dtype=bool)
    occupied[tuple(cells.T)] = True
    crowded = occupied & (_neighbour_counts(occupied) >= FEWEST_NEIGHBOURS)
    labels = np.zeros(occupied.shape, dtype=np.int32)
    count = int(ndimage.label(crowded, structure=np.ones((3, 3, 3)), output=labels))  # pyright: ignore
    sizes = np.bincount(labels.ravel(), minlength=count + 1)
    thing = labels[tuple(cells.T)]
    tops = np.zeros(count + 1)
    np.maximum.at(tops, thing, points[near, 2])
    is_thing = (sizes >= FEWEST_CELLS) & (tops > lowest_top)
    is_thing[0] = False
    kept[near] = is_thing[thing]
    return kept


def _over_table(points: Float[np.ndarray, "n 3"], above: Int[np.ndarray, "a"]) -> Bool[np.ndarray, "a"]:
    """Which of the points above the table plane are above the table itself: in the hull of what is seen of it."""
    sample = points[:: -(-len(points) // FIT_POINTS)]
    table = sample[np.abs(sample[:, 2] - TABLE_HEIGHT) < TABLE_TOLERANCE, :2]
    if len(table) == 0:
        return np.ones(len(above), dtype=bool)
    table = table[np.abs(table - _middle(table)).max(axis=1) < 2 * REACH]
    edges = [
        np.arange(low, high + 2 * TABLE_CELL, TABLE_CELL) for low, high in zip(table.min(0), table.max(0), strict=True)
    ]
    counts, *_ = np.histogram2d(*table.T, bins=edges)
    # Objects and their shadows cut the table in pieces; stray points at its height elsewhere are small pieces.
    closed = ndimage.binary_closing(np.pad(counts >= FEWEST_IN_CELL, 2), np.ones((3, 3)), iterations=2)[2:-2, 2:-2]
    labels = np.zeros(closed.shape, dtype=np.int32)
    ndimage.label(closed, structure=np.ones((3, 3)), output=labels)
    sizes = np.bincount(labels.ravel())[1:]
    if len(sizes) == 0:
        return np.ones(len(above), dtype=bool)
    cells = np.argwhere(labels == sizes.argmax() + 1)[:, None] + np.array([[0, 0], [0, 1], [1, 0], [1, 1]])
    corners = np.stack([edge[index] for edge, index in zip(edges, cells.reshape(-1, 2).T, strict=True)], axis=1)
    beyond = np.full(len(above), -np.inf)
    for side in ConvexHull(corners).equations:
        np.maximum(beyond, points[above, :2] @ side[:2] + side[2], out=beyond)
    return beyond <= TABLE_BORDER


def _middle(points: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2"]:
    """The point nearest to the median: the median itself may lie far from all, between two groups of points."""
    return points[np.abs(points - np.median(points, axis=0)).max(axis=1).argmin()]


def _spacing(points: Float[np.ndarray, "n 3"]) -> float:
    """Typical distance of a point to its nearest neighbour [m]."""
    tree = KDTree(points, leafsize=32, balanced_tree=False, compact_nodes=False)
    distance, _ = tree.query(points[:: -(-len(points) // SPACING_POINTS)], k=2)
    return float(np.median(distance[:, 1])) if len(points) > 1 else 0.0


def _neighbour_counts(occupied: Bool[np.ndarray, "x y z"]) -> Int[np.ndarray, "x y z"]:
    """How many of the 26 cells around each are occupied."""
    counts = occupied.astype(np.int8)
    for axis in range(3):
        counts = ndimage.correlate1d(counts, np.ones(3), axis=axis, mode="constant")
    return counts - occupied
