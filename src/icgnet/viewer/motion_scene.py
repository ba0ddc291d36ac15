"""What pictures and the page of a motion share: colours, and how high the support is."""

import numpy as np

from icgnet.arm.motion import Motion, MovingPart
from icgnet.geometry.transforms import transform_points
from icgnet.viewer.palette import UNASSIGNED, instance_colour
from icgnet.viewer.triangles import Colour

ARM_COLOUR, HAND_COLOUR = (0.80, 0.82, 0.85), (0.24, 0.66, 0.30)


def part_colour(part: MovingPart) -> Colour:
    """Colour of the arm, of its hand, of an object, or grey."""
    if part.kind == "object":
        return instance_colour(part.instance)
    return {"arm": ARM_COLOUR, "hand": HAND_COLOUR}.get(part.kind, UNASSIGNED)


def support_height(motion: Motion) -> float:
    """Height of the support in the world, in the middle of its upper side [m]."""
    support = next(part for part in motion.parts if part.kind == "support")
    corners = transform_points(support.poses[0], np.asarray(support.mesh.vertices, float))
    return float(np.sort(corners[:, 2])[-4:].mean())
