"""Planes in clouds, and the workspace frame on the plane of a table."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT, TABLE_MARGIN

STANDING_HEIGHT = 0.25
"""Points up to this far above the table count as standing on it [m]."""
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


def refined_plane(plane: Plane, points: Float[np.ndarray, "n 3"], tolerance: float) -> Plane:
    """The plane of least squares through its own points, found again until it settles."""
    for _ in range(4):
        inliers = points[np.abs(plane.height(points)) < tolerance]
        if len(inliers) < 3:
            break
        mean = inliers.mean(axis=0)
        centred = inliers - mean
        normal = np.linalg.eigh(centred.T @ centred)[1][:, 0]
        normal = normal if normal @ plane.normal > 0 else -normal
        plane = Plane(normal, float(-normal @ mean))
    return plane
