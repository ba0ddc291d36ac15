"""Implicit decoders: residual blocks on point features, conditioned on a query."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.network.config import NetworkConfig
from icgnet.network.dense_map import DenseMap
from icgnet.network.embedding import SceneEmbedding
from icgnet.network.hand_input import HandInput
from icgnet.network.layers import ResidualBlock


@dataclass(frozen=True, eq=False)
class Affordance:
    """What is predicted for contacts on an object."""

    logits: Float[Tensor, "g a"]
    """Success of the grasp at each approach angle."""
    widths: Float[Tensor, " g"]
    """Opening between the finger tips when they touch the object [m]."""
    contact_logits: Float[Tensor, " g"]
    """Whether any angle succeeds, from the contact alone: an auxiliary target of the training."""


class ConditionedDecoder(nn.Module):
    """Residual blocks, each told the query, its positional encoding and the scene scale.

    Paper: implicit decoder following Occupancy Networks.
    """

    def __init__(self, config: NetworkConfig, outputs: int) -> None:
        super().__init__()
        width, latent = config.decoder_width, 2 * config.query_width + 1
        self.start = nn.Linear(config.query_width + 4, width)
        self.conditions = nn.ModuleList(nn.Linear(latent, width) for _ in range(config.decoder_blocks))
        self.blocks = nn.ModuleList(ResidualBlock(width, width) for _ in range(config.decoder_blocks))
        self.end = nn.Linear(width, outputs)

    def forward(
        self, features: Float[Tensor, "*p f"], latent: Float[Tensor, "*l c"], rows: Int[Tensor, "*p"] | None = None
    ) -> Float[Tensor, "*p o"]:
        """Outputs at points; `latent` broadcasts against the points (`[i 1 c]` for `[i n f]`).

        With `rows` the latent `[i c]` is taken row by row, after the layers that read nothing else.
        """
        scale = latent[..., -1:] if rows is None else latent[rows, -1:]
        scale = scale.expand(*features.shape[:-1], 1)
        hidden = self.start(torch.cat([features, scale], -1))
        for condition, block in zip(self.conditions, self.blocks, strict=True):
            told = condition(latent)
            hidden = block(hidden + (told if rows is None else told[rows]))
        return self.end(torch.relu(hidden))


@dataclass(frozen=True, eq=False)
class ContactInputs:
    """What a decoder of affordances is told of contacts, whatever it makes of it.

    Attributes:
        features: [g f] interpolated point features there.
        queries: [g c] affordance query of each one's instance.
        latent: [g l] the same with its positional encoding and the scale of the scene.
        contacts: [g 3] positions [m, table frame].
        normals: [g 3] outward unit normals there (table frame).
        hand: that is to grasp.
        embedding: of the scene.
    """

    features: Float[Tensor, "g f"]
    queries: Float[Tensor, "g c"]
    latent: Float[Tensor, "g l"]
    contacts: Float[Tensor, "g 3"]
    normals: Float[Tensor, "g 3"]
    hand: HandInput
    embedding: SceneEmbedding


class ContactDecoder(nn.Module):
    """Success at all approach angles, and the width, from features at the contact alone.

    Paper: the published affordance and width decoders (two separate ones); the width head is linear.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.quality = ConditionedDecoder(config, len(APPROACH_ANGLES))
        self.width = ConditionedDecoder(config, 1)

    @property
    def success_layer(self) -> nn.Linear:
        """The layer that the logits come from."""
        return self.quality.end

    def hand_map(self, finest: DenseMap, given: DenseMap) -> None:
        """Nothing is read at the hand."""

    def forward(self, inputs: ContactInputs) -> Affordance:
        """Affordance from point features at contacts and the latent of each contact's instance."""
        logits = self.quality(inputs.features, inputs.latent)
        return Affordance(logits, self.width(inputs.features, inputs.latent)[:, 0], logits.amax(1))
