"""Small layers that the queries and the decoders share."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from icgnet.network.positional import Places


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
        self.heads = heads
        self.to_queries, self.to_keys, self.to_values = (nn.Linear(width, width) for _ in range(3))
        self.end = nn.Linear(width, width)
        self.norm = nn.LayerNorm(width)
        for layer in (self.to_queries, self.to_keys, self.to_values):
            nn.init.xavier_uniform_(layer.weight)
            nn.init.zeros_(layer.bias)
        nn.init.zeros_(self.end.bias)

    def forward(
        self,
        queries: Float[Tensor, "q c"],
        own: Float[Tensor, "q c"],
        tokens: Float[Tensor, "t c"],
        places: Places,
        blocked: Bool[Tensor, "q t"],
        groups: Sequence[Int[Tensor, "_"]],
    ) -> Float[Tensor, "q c"]:
        """Queries after they attended to the tokens that are not blocked for them.

        Args:
            queries: their features.
            own: encoding of each one's own place.
            tokens: what is attended to.
            places: of the tokens, for each query.
            blocked: what a query must not attend to; something must be left to each.
            groups: rows of the queries that are computed together, without the tokens that are blocked for all of
                them; together all rows.
        """
        heads = (self.heads, -1)
        asked = self.to_queries(queries + own).unflatten(1, heads)
        keys, values = self.to_keys(tokens).unflatten(1, heads), self.to_values(tokens).unflatten(1, heads)
        # Where a token is differs from query to query, but its part in the product is linear in what all share.
        of_place = places.dot(torch.einsum("qhd,hdc->qhc", asked, self.to_keys.weight.unflatten(0, heads)))
        attended = []
        for rows in groups:
            barred = blocked[rows]
            seen = torch.nonzero(~barred.all(0))[:, 0]
            logits = torch.einsum("qhd,thd->hqt", asked[rows], keys[seen])
            logits = logits + torch.einsum("qhe,te->hqt", of_place[rows], places.of_points[seen])
            logits = (logits / math.sqrt(values.shape[2])).masked_fill(barred[:, seen], -math.inf)
            attended.append(torch.einsum("hqt,thd->qhd", logits.softmax(2), values[seen]).flatten(1))
        order = torch.cat(list(groups)).argsort()
        return self.norm(queries + self.end(torch.cat(attended)[order]))
