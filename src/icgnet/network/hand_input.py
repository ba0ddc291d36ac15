"""What the network is told of a hand: where to look around it, and the few numbers that describe it."""

import itertools
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from icgnet.grasping.gripper import Gripper
from icgnet.grasping.hand_family import NUMBERS, hand_numbers
from icgnet.network.config import HandConfig

WIDTH_MARGIN = 0.01
"""The width head can name openings up to so much above the largest of the hand [m], so that this is not its limit."""
LENGTH_UNIT, FORCE_UNIT = 0.1, 40.0
"""Units of lengths [m] and of the force of a finger [N]."""
OUTSIDE_RAYS = (0.02, 0.01, 0.0)
"""Where the width head reads outside of the contact and at it, along the normal [m]."""
HAND_NUMBERS = len(NUMBERS) + 2
"""How many numbers describe a hand: its lengths, the force of a finger and the friction of the pads."""


@dataclass(frozen=True, eq=False)
class HandInput:
    """A hand as the network takes it."""

    points: Float[Tensor, "k 3"]
    """Control points in the frame of the hand at the contact (sideways, normal, approach) [m]."""
    rays: Float[Tensor, " r"]
    """Offsets along the normal that the width head reads [m]."""
    numbers: Float[Tensor, " n"]
    """What describes the hand, see `HAND_NUMBERS`."""
    width_limit: float
    """The largest width that can be named [m]."""

    @staticmethod
    def of(gripper: Gripper, config: HandConfig) -> "HandInput":
        """The input for a hand; the control points are all combinations of three lists of offsets."""
        lengths = dict(zip(NUMBERS, hand_numbers(gripper).tolist(), strict=True))
        outward = [each * lengths["tip_thickness"] for each in config.outward]
        normal = outward + [-each * gripper.max_opening for each in config.across]
        palm = lengths["finger_length"] - gripper.finger_reach
        approach = [-palm - config.palm, *(-each * palm for each in config.finger)]
        approach.append(gripper.finger_reach + config.past_tip)
        sideways = [each * lengths["finger_width"] for each in config.sideways]
        points = [(x, y, z) for y, z, x in itertools.product(normal, approach, sideways)]
        limit = gripper.max_opening + WIDTH_MARGIN
        inwards = [-limit * (step + 1) / config.rays for step in range(config.rays)]
        described = [each / LENGTH_UNIT for each in lengths.values()]
        described += [gripper.finger_force / FORCE_UNIT, gripper.friction]
        return HandInput(_tensor(points), _tensor([*OUTSIDE_RAYS, *inwards]), _tensor(described), limit)

    def to(self, device: torch.device | str) -> "HandInput":
        """The same on another device."""
        return HandInput(self.points.to(device), self.rays.to(device), self.numbers.to(device), self.width_limit)


def _tensor(values: list) -> Tensor:
    return torch.from_numpy(np.array(values, dtype=np.float32))
