"""Small layers that the queries and the decoders share."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn


class ResidualBlock(nn.Module):
    """Two linear layers with a shortcut and a ReLU after the sum; starts as (nearly) the identity."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        hidden = min(inputs, outputs)
        self.first = nn.Linear(inputs, hidden)
        self.second = nn.Linear(hidden, outputs)
        self.shortcut = nn.Identity() if inputs == outputs else nn.Linear(inputs, outputs, bias=False)
        nn.init.zeros_(self.second.weight)

    def forward(self, features: Float[Tensor, "*n i"]) -> Float[Tensor, "*n o"]:
        """Features of the same points, one width to another."""
        hidden = torch.relu(self.first(torch.relu(features)))
        return torch.relu(self.shortcut(features) + self.second(hidden))


class FeedForward(nn.Module):
    """Two linear layers, residual, with layer normalisation afterwards."""

    def __init__(self, width: int, hidden: int) -> None:
        super().__init__()
        self.layers = nn.Sequential(nn.Linear(width, hidden), nn.ReLU(), nn.Linear(hidden, width))
        self.norm = nn.LayerNorm(width)

    def forward(self, features: Float[Tensor, "n c"]) -> Float[Tensor, "n c"]:
        """Each row on its own."""
        return self.norm(features + self.layers(features))


class Attention(nn.Module):
    """Multi-head attention, residual, with layer normalisation afterwards; positions are added to queries and keys."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.attention = nn.MultiheadAttention(width, heads, batch_first=True)
        self.norm = nn.LayerNorm(width)

    def forward(
        self,
        queries: Float[Tensor, "q c"],
        query_positions: Float[Tensor, "q c"],
        tokens: Float[Tensor, "t c"],
        token_positions: Float[Tensor, "t c"],
        blocked: Bool[Tensor, "q t"] | None = None,
    ) -> Float[Tensor, "q c"]:
        """Queries after they attended to the tokens that are not blocked for them."""
        attended, _ = self.attention(
            (queries + query_positions)[None],
            (tokens + token_positions)[None],
            tokens[None],
            attn_mask=blocked,
            need_weights=False,
        )
        return self.norm(queries + attended[0])
