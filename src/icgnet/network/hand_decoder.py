"""The hand-aligned affordance decoder: asks "does this hand fit here" where the hand would be.

For every contact and approach angle the dense map and its input are read at control points that are fixed to the hand
in that pose; one network serves all angles. Differs from the paper, which predicts all angles from the contact.
"""

import math

import torch
from jaxtyping import Float
from torch import Tensor, nn

from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.frame import APPROACH_ANGLES, SINGULAR_COSINE
from icgnet.network.config import NetworkConfig
from icgnet.network.decoders import Affordance, ContactInputs
from icgnet.network.dense_map import DenseMap
from icgnet.network.hand_input import HAND_NUMBERS, OUTSIDE_RAYS
from icgnet.network.tokens import decoder_map_widths, token_widths

_CLEARANCE_UNIT = 0.02
_POSITIVE_PRIOR = -2.0
"""Initial logit: about one grasp in eight succeeds."""
_CONTEXT_LEVELS = (0, 1)


def hand_frames(normals: Float[Tensor, "g 3"], angles: int) -> Float[Tensor, "g a 3 3"]:
    """Rotations of the hand at contacts with outward unit normals: columns sideways, closing (the normal), approach.

    The same convention as `icgnet.grasping.frame.grasp_rotations`, for tensors.
    """
    up = normals.new_tensor([0.0, 0.0, 1.0])
    forward = normals.new_tensor([1.0, 0.0, 0.0])
    across = torch.linalg.cross(up.expand_as(normals), normals)
    vertical = normals[:, 2:].abs() > SINGULAR_COSINE
    across = torch.where(vertical, forward - normals[:, :1] * normals, across)
    across = across / across.norm(dim=1, keepdim=True)
    down = torch.linalg.cross(across, normals)
    angle = torch.linspace(-math.pi / 2, math.pi / 2, angles, dtype=normals.dtype, device=normals.device)[:, None]
    sideways = angle.cos() * across[:, None] - angle.sin() * down[:, None]
    approach = angle.sin() * across[:, None] + angle.cos() * down[:, None]
    return torch.stack([sideways, normals[:, None].expand_as(approach), approach], 3)


def table_clearance(points: Float[Tensor, "*p k 3"]) -> Float[Tensor, "*p"]:
    """Height of the lowest control point above the table, in units of 2 cm, limited to +-2."""
    return ((points[..., 2].amin(-1) - TABLE_HEIGHT) / _CLEARANCE_UNIT).clamp(-2.0, 2.0)


class HandDecoder(nn.Module):
    """Success per approach angle from reads at the hand, width from reads along the normal.

    Differs from the paper in everything but the outputs; see `docs/decisions`.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        hand, query = config.hand, config.query_width
        self.input_channels = 2 if config.visibility else 1
        read = hand.map_channels + self.input_channels
        self.project = nn.Linear(decoder_map_widths(config)[-1], hand.map_channels)
        self.context = nn.ModuleList(nn.Linear(token_widths(config)[level], query) for level in _CONTEXT_LEVELS)
        contact_inputs = (query + 3) + query + 3 + query * len(_CONTEXT_LEVELS)
        self.contact = nn.Sequential(
            nn.Linear(contact_inputs + HAND_NUMBERS, hand.hidden),
            nn.ReLU(),
            nn.Linear(hand.hidden, hand.hidden),
            nn.ReLU(),
            nn.Linear(hand.hidden, hand.contact_width),
        )
        self.hand = nn.Linear(hand.points * read, hand.hidden)
        self.of_numbers = nn.Linear(HAND_NUMBERS, hand.hidden, bias=False)
        self.of_hand = nn.Linear(hand.hidden + 2, hand.contact_width)
        self.of_contact = nn.Linear(hand.contact_width, hand.contact_width, bias=False)
        self.success = nn.Linear(hand.contact_width, 1)
        self.any_success = nn.Linear(hand.contact_width, 1)
        self.width = nn.Sequential(
            nn.Linear(hand.contact_width + (len(OUTSIDE_RAYS) + hand.rays) * read, hand.contact_width),
            nn.ReLU(),
            nn.Linear(hand.contact_width, 1),
        )
        nn.init.constant_(self.success.bias, _POSITIVE_PRIOR)

    @property
    def success_layer(self) -> nn.Linear:
        """The layer that the logits come from."""
        return self.success

    def forward(self, inputs: ContactInputs) -> Affordance:
        """Affordance at contacts, from what is around the hand at each approach angle."""
        contacts, normals, hand = inputs.contacts, inputs.normals, inputs.hand
        contact = self.contact_features(inputs)
        readable = inputs.embedding.hand_map
        assert readable is not None
        frames = hand_frames(normals, len(APPROACH_ANGLES))
        points = contacts[:, None, None] + torch.einsum("gaij,kj->gaki", frames, hand.points)
        reads = readable.trilinear(points.reshape(-1, 3)).view(*points.shape[:2], -1)
        pose = torch.stack([table_clearance(points), frames[..., 2, 2]], 2)
        around = torch.relu(self.hand(reads) + self.of_numbers(hand.numbers))
        fit = self.of_hand(torch.cat([around, pose.to(reads.dtype)], 2))
        logits = self.success(torch.relu(fit + self.of_contact(contact)[:, None]))[..., 0]
        return Affordance(logits, self._widths(contact, inputs, readable), self.any_success(contact)[:, 0])

    def contact_features(self, inputs: ContactInputs) -> Float[Tensor, "g h"]:
        """What is known about a contact whatever the angle: its surroundings fine and coarse, object and normal."""
        parts = [inputs.features, inputs.queries, inputs.normals]
        numbers = inputs.hand.numbers.expand(len(inputs.contacts), -1)
        for level, project in zip(_CONTEXT_LEVELS, self.context, strict=True):
            tokens = inputs.embedding.tokens[level]
            parts.append(project(tokens.features[tokens.search.nearest(inputs.contacts, 1)[:, 0]]))
        return torch.relu(self.contact(torch.cat([*parts, numbers], 1)))

    def hand_map(self, finest: DenseMap, given: DenseMap) -> DenseMap:
        """The finest dense map projected to few channels, with the input's occupancy and visibility beside it."""
        projected = self.project(finest.features)
        both = torch.cat([projected, given.features[..., : self.input_channels]], 3)
        return DenseMap(both, finest.pitch, finest.origin)

    def _widths(self, contact: Tensor, inputs: ContactInputs, readable: DenseMap) -> Tensor:
        points = inputs.contacts[:, None] + inputs.hand.rays[:, None] * inputs.normals[:, None]
        reads = readable.trilinear(points.reshape(-1, 3)).view(len(contact), -1)
        share = torch.sigmoid(self.width(torch.cat([contact, reads], 1))[:, 0])
        return inputs.hand.width_limit * share
