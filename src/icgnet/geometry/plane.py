"""The table in a cloud whose pose is not known: a robust plane fit, and the workspace frame on that plane."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from icgnet.errors import TableNotFoundError
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT, TABLE_MARGIN

HYPOTHESES = 400
"""Planes through three random points that are tried; with 20 % table points, 96 % of runs draw a good one."""
LARGEST_FIT = 50_000
"""Points that the plane is refined on; a larger cloud is thinned evenly."""
SAMPLE = 3000
"""Points that the hypotheses are counted on."""
RELATIVE_TOLERANCE = 0.01
"""Largest tolerance as a share of the cloud's extent, so that a small ball is not taken for a plane."""
STANDING_HEIGHT = 0.25
"""Points up to this far above a plane count as standing on it [m]."""
STANDING_WEIGHT = 0.5
"""What such a point counts, next to 1 for a point of the plane: it tells the table from a box top and the floor."""
PATCH_PERCENTILES = (2, 98)
"""Range of the table's own points that counts as the table: stray points beyond its edge must not widen it."""
FEWEST_STANDING = 50
"""With fewer points on the table the workspace is centred on the table itself."""


@dataclass(frozen=True, eq=False)
class Plane:
    """All points x with `normal @ x + offset = 0`.

    Attributes:
        normal: [3] unit vector, towards the side that the camera is on.
        offset: minus the distance from the origin along the normal [m].
    """

    normal: Float[np.ndarray, "3"]
    offset: float

    def height(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n"]:
        """Signed distance of points from the plane [m], positive on the side of the normal."""
        return np.asarray(points @ self.normal + self.offset)


def fit_table_plane(
    points: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    tolerance: float = 0.006,
    minimum_share: float = 0.2,
) -> Plane:
    """The table's plane: of all planes, the one that holds most points and has most points standing on it.

    Args:
        points: finite points in any frame [m].
        viewpoint: camera centre in the same frame [m]; if None, the frame's z axis is taken to point up.
        rng: draws the hypotheses.
        tolerance: how far a point of the table may be from the plane [m].
        minimum_share: share of all points that must lie on the plane.

    Returns:
        The plane, its normal towards the viewpoint.

    Raises:
        TableNotFoundError: no plane holds `minimum_share` of the points; the message names the share found.
    """
    points = points[:: max(1, len(points) // LARGEST_FIT)]
    sample = points[rng.permutation(len(points))[:SAMPLE]]
    extent = float(np.linalg.norm(np.subtract(*np.percentile(sample, (95, 5), axis=0))))
    tolerance = min(tolerance, RELATIVE_TOLERANCE * extent)
    plane = refined_plane(_best_hypothesis(sample, viewpoint, rng, tolerance), points, tolerance)
    share = float(np.mean(np.abs(plane.height(points)) < tolerance))
    if share < minimum_share:
        raise TableNotFoundError(
            f"no table found: the best plane holds {share:.0%} of the points within {tolerance * 1e3:.1f} mm, "
            f"{minimum_share:.0%} are required; crop the cloud to the table or give the camera pose"
        )
    return plane


def table_frame(
    plane: Plane, points: Float[np.ndarray, "n 3"], table_height: float = TABLE_HEIGHT
) -> Float[np.ndarray, "4 4"]:
    """T_world_camera of the workspace that stands on the table plane, centred on what is on the table.

    World z is the plane's normal and world x the camera's x axis laid into the plane. The median of the points that
    stand on the visible table (of the table itself, if nothing does) comes to lie at (0.15, 0.15) m.

    Args:
        plane: the table, camera frame.
        points: the cloud, camera frame [m].
        table_height: height of the table in the workspace [m].
    """
    # The camera's x axis, or its y axis when that looks along the normal: whichever lies more in the plane.
    across = np.eye(3)[0 if abs(plane.normal[0]) < 0.9 else 1]
    x = across - plane.normal * (across @ plane.normal)
    x /= np.linalg.norm(x)
    R_world_camera = np.stack([x, np.cross(plane.normal, x), plane.normal])

    rotated = points @ R_world_camera.T
    height = plane.height(points)
    table = np.abs(height) <= TABLE_MARGIN
    middle = _middle_of_standing(rotated[:, :2], height, table)
    return make_transform(R_world_camera, np.array([*(SIZE / 2 - middle), table_height + plane.offset]))


def _middle_of_standing(
    across: Float[np.ndarray, "n 2"], height: Float[np.ndarray, "n"], table: Bool[np.ndarray, "n"]
) -> Float[np.ndarray, "2"]:
    """Median of the points that stand over the visible part of the table, in the plane's axes [m]."""
    if not table.any():
        return np.median(across, axis=0)
    lower, upper = np.percentile(across[table], PATCH_PERCENTILES, axis=0)
    over_table = ((across >= lower) & (across <= upper)).all(axis=1)
    standing = over_table & (height > TABLE_MARGIN) & (height < STANDING_HEIGHT)
    return np.median(across[standing if standing.sum() >= FEWEST_STANDING else table], axis=0)


def _best_hypothesis(
    sample: Float[np.ndarray, "n 3"],
    viewpoint: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    tolerance: float,
) -> Plane:
    """The best of many planes through three random points each."""
    corners = sample[rng.integers(len(sample), size=(HYPOTHESES, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1)
    proper = length > 1e-12
    if not proper.any():
        raise TableNotFoundError(f"no table found: the {len(sample)} points lie on one line")
    normals, corners = normals[proper] / length[proper, None], corners[proper]
    upward = normals[:, 2] if viewpoint is None else np.einsum("hd,hd->h", normals, viewpoint - corners[:, 0])
    normals *= np.where(upward < 0, -1.0, 1.0)[:, None]
    offsets = -np.einsum("hd,hd->h", normals, corners[:, 0])

    height = normals @ sample.T + offsets[:, None]
    on_plane = np.abs(height) < tolerance
    standing = (height >= tolerance) & (height < STANDING_HEIGHT)
    best = np.argmax(on_plane.sum(axis=1) + STANDING_WEIGHT * standing.sum(axis=1))
    return Plane(normals[best], float(offsets[best]))


def refined_plane(plane: Plane, points: Float[np.ndarray, "n 3"], tolerance: float) -> Plane:
    """The plane of least squares through its own points, found again until it settles."""
    for _ in range(4):
        inliers = points[np.abs(plane.height(points)) < tolerance]
        mean = inliers.mean(axis=0)
        centred = inliers - mean
        normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
        normal = normal if normal @ plane.normal > 0 else -normal
        plane = Plane(normal, float(-normal @ mean))
    return plane
