"""Tables with boxes and balls, as an ideal depth camera sees them, and a small network with random weights."""

from dataclasses import dataclass

import numpy as np
import torch

from icgnet.geometry.camera import look_at, pixel_rays
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet

SHAPE = (120, 160)
INTRINSICS = np.array([[135.0, 0.0, 80.0], [0.0, 135.0, 60.0], [0.0, 0.0, 1.0]])
TABLE_HEIGHT = 0.05
TABLE_EDGE = 0.8


@dataclass(frozen=True)
class Box:
    """A box on the table: `lower` and `upper` corner [m]."""

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]


THREE_BOXES = (
    Box((0.05, 0.06, 0.05), (0.10, 0.11, 0.11)),
    Box((0.17, 0.05, 0.05), (0.22, 0.13, 0.09)),
    Box((0.10, 0.18, 0.05), (0.16, 0.23, 0.13)),
)
# 0.7 m from end to end.
WIDE_ROW = tuple(
    Box((x, y, 0.05), (x + 0.05, y + 0.06, 0.05 + height))
    for x, y, height in (
        (-0.2, 0.1, 0.06),
        (-0.06, 0.2, 0.05),
        (0.12, 0.05, 0.08),
        (0.3, 0.15, 0.05),
        (0.45, 0.1, 0.07),
    )
)


def camera_pose(distance: float = 0.5, centre: tuple[float, float, float] = (0.15, 0.15, 0.05)) -> np.ndarray:
    """T_world_camera of a camera that looks at the scene from one side at 60 degrees."""
    target = np.array(centre)
    return look_at(target + distance * np.array([-0.25, -0.43, 0.87]), target)


def depth_image(boxes: tuple[Box, ...], T_world_camera: np.ndarray) -> np.ndarray:
    """Depth [m] of boxes on a table, 0 where the camera looks beyond the table."""
    rays = pixel_rays(INTRINSICS, SHAPE) @ T_world_camera[:3, :3].T
    eye = T_world_camera[:3, 3]
    with np.errstate(divide="ignore"):
        depth = (TABLE_HEIGHT - eye[2]) / rays[..., 2]
    foot = eye + depth[..., None] * rays
    on_table = (depth > 0) & (np.abs(foot[..., :2] - 0.15) < TABLE_EDGE).all(axis=-1)
    depth = np.where(on_table, depth, np.inf)
    for box in boxes:
        with np.errstate(divide="ignore"):
            first, second = (np.array(box.lower) - eye) / rays, (np.array(box.upper) - eye) / rays
        near, far = np.minimum(first, second).max(axis=-1), np.maximum(first, second).min(axis=-1)
        depth = np.where((near < far) & (near > 0), np.minimum(depth, near), depth)
    return np.where(np.isfinite(depth), depth, 0.0)


def tiny_network(seed: int = 3) -> IcgNet:
    """A network with random weights that takes every query for an object, sees no shapes and likes hands from above.

    Without shapes only table and points hinder the hand, and 65 mm wide grasps go over all the boxes above.
    """
    torch.manual_seed(seed)
    network = IcgNet(NETWORKS["tiny"])
    hand = network.affordance
    with torch.no_grad():
        network.refinement.class_head.of_query[-1].bias[-1] = -10.0
        network.occupancy.end.bias.fill_(-20.0)
        hand.width[-1].weight.zero_()
        hand.width[-1].bias.fill_(0.96)
        # The first unit sees how much the approach points down, and little of the contact; success reads it alone.
        hand.of_hand.weight.zero_()
        hand.of_hand.bias.zero_()
        hand.of_hand.weight[0, -1] = -1.0
        hand.success.weight.zero_()
        hand.success.weight[0, 0] = 4.0
    return network.eval()
