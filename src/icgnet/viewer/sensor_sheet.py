"""Contact sheet of the clouds that different sensors make of one scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from icgnet.errors import InputError
from icgnet.geometry.clouds import crop, estimate_normals
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.viewer.palette import INK, instance_colours
from icgnet.viewer.render import render
from icgnet.viewer.sheet import draw_sheet
from icgnet.viewer.triangles import disc_triangles
from icgnet.viewer.view import Perspective, framing_view

COLUMNS = 6
ELEVATION = np.deg2rad(28.0)
ASIDE = np.deg2rad(50.0)
"""The clouds are drawn from this far beside the camera: errors of the depth do not show from the camera itself."""
DISC_SHARE = 0.8
"""Radius of the disc of a point, in distances of neighbouring points."""
MARGIN = 0.03
"""How much of the table around the objects is drawn [m]."""
NOTHING, TABLE = -1, -2
TABLE_COLOUR = (0.84, 0.85, 0.87)


@dataclass(frozen=True, eq=False)
class SeenCloud:
    """A cloud in a frame on the table, and what its points belong to.

    Attributes:
        caption: which sensor it is from.
        points: [n 3] positions [m].
        owners: [n] object of each point, `NOTHING` or `TABLE`.
        viewpoint: [3] centre of the camera [m].
        spacing: distance of neighbouring points on what is seen from the front [m].
    """

    caption: str
    points: Float[np.ndarray, "n 3"]
    owners: Int[np.ndarray, "n"]
    viewpoint: Float[np.ndarray, "3"]
    spacing: float


def draw_sensor_sheet(clouds: Sequence[SeenCloud], path: str | Path, panel: tuple[int, int]) -> None:
    """Writes a PNG with the clouds, all from one direction; the table is grey, what belongs to nothing dark.

    Args:
        clouds: the first one sets the view.
        path: file to write.
        panel: height and width of the picture of one cloud [pixels].

    Raises:
        InputError: no clouds, or a first one without points on objects.
    """
    if not clouds or not (clouds[0].owners >= 0).any():
        raise InputError("a sheet of sensors needs a first cloud with points on objects, to choose the view by")
    first = clouds[0]
    objects = first.points[first.owners >= 0]
    lower, upper = objects.min(axis=0) - MARGIN, objects.max(axis=0) + MARGIN
    corners = np.array([[x, y, TABLE_HEIGHT] for x in (lower[0], upper[0]) for y in (lower[1], upper[1])])
    towards = first.viewpoint - objects.mean(axis=0)
    azimuth = float(np.arctan2(towards[1], towards[0])) + ASIDE
    view = framing_view(np.concatenate([objects, corners]), azimuth, ELEVATION, panel, margin=0.03)
    panels = [_draw_cloud(cloud, crop(cloud.points, lower, upper), view, panel) for cloud in clouds]
    draw_sheet(panels, [cloud.caption for cloud in clouds], path, COLUMNS)


def _draw_cloud(
    cloud: SeenCloud, shown: Bool[np.ndarray, "n"], view: Perspective, panel: tuple[int, int]
) -> UInt8[np.ndarray, "h w 3"]:
    points, owners = cloud.points[shown], cloud.owners[shown]
    normals = estimate_normals(points, cloud.viewpoint, neighbours=16, radius=5.0 * cloud.spacing)
    colours = instance_colours(owners)
    colours[owners == TABLE] = TABLE_COLOUR
    colours[owners == NOTHING] = INK
    return render(disc_triangles(points, normals, colours, DISC_SHARE * cloud.spacing), None, view, panel)
