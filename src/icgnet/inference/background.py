"""Things that are no objects, told by their shape: waves in the depth of a table, specks, smears, walls of bins, edges.

The network has learned walls, floors and arms of simulated scenes, and still takes these for objects in real ones.
"""

import numpy as np
from jaxtyping import Float

from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.instances import Instance
from icgnet.inference.tabletop import Tabletop

DOUBTED, WAVE_HEIGHT = 0.75, 0.02
"""What the network doubts, by its score, and rises less than this above the table [m], is a wave in its depth."""
SPECK, SPECK_HEIGHT = 0.0008, 0.025
"""Nor is anything an object that has less than this share of all points (250 pixels of 640 x 480) and rises less than
this above the table [m]: an edge of a shadow, a smear at the foot of something."""
WALL_LENGTH, WALL_WIDTH, WALL_THICKNESS, WALL_HEIGHT = 0.30, 0.20, 0.04, 0.03
"""What is longer than this, narrower and thinner than these and higher above the table [m] is a wall or an edge."""
EXTENT_POINTS = 1500
"""Points at most that extents are measured on."""
SLANT, LARGEST_SMEAR = 0.25, 0.003
"""What covers less of the view than this share of its width times its length, and less than this area [m^2], is a smear
between something near and something far: all of its points lie along the line of sight."""
STRAYS = 0.03
"""Share of the points at each end of an extent that may be strays."""


def without_background(found: list[Instance], tabletop: Tabletop, solid_angle: float | None) -> list[Instance]:
    """What was found but the background; all of a scene whose table is known, where everything above it is an object.

    Args:
        found: instances, by rows of the tabletop's cloud.
        tabletop: the scene.
        solid_angle: of a pixel, if the cloud is a picture [sr].
    """
    if tabletop.support is None:
        return found
    points, eye = tabletop.cloud.points, tabletop.cloud.viewpoint
    kept = []
    for item in found:
        own, covered = points[item.rows], None
        if solid_angle is not None and eye is not None:
            covered = solid_angle * float(np.square(own - eye).sum())
        if not is_background(own, item.score, len(points), covered):
            kept.append(item)
    return kept


def is_background(points: Float[np.ndarray, "n 3"], score: float, measured: int, covered: float | None = None) -> bool:
    """Whether something found on a table is a part of the table or of what encloses it, or nothing at all.

    Args:
        points: what is seen of it, table frame [m].
        score: how sure the network is that it is an object.
        measured: points of the whole scene.
        covered: area that it covers, across the line of sight [m^2]; None if it is not known.
    """
    top = float(np.quantile(points[:, 2], 1.0 - STRAYS)) - TABLE_HEIGHT
    if (score < DOUBTED and top < WAVE_HEIGHT) or (len(points) < SPECK * measured and top < SPECK_HEIGHT):
        return True
    thickness, width, length = extents(points)
    if covered is not None and covered < min(LARGEST_SMEAR, SLANT * width * length):
        return True
    return bool(length > WALL_LENGTH and width < WALL_WIDTH and thickness < WALL_THICKNESS and top > WALL_HEIGHT)


def extents(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """Thickness, width and length of points along their principal axes [m], without strays."""
    sample = points[:: -(-len(points) // EXTENT_POINTS)]
    centred = sample - sample.mean(axis=0)
    along = centred @ np.linalg.eigh(centred.T @ centred)[1]
    return np.sort(np.subtract(*np.quantile(along, (1.0 - STRAYS, STRAYS), axis=0)))
