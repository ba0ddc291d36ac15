"""Fourier positional encoding of points, in the bounds of a scene or seen from the queries."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from icgnet.geometry.workspace import SIZE
from icgnet.network.config import NetworkConfig


@dataclass(frozen=True, eq=False)
class Bounds:
    """The cube that positions are normalised by."""

    origin: Float[Tensor, "3"]
    """Its lower corner [m]."""
    extent: Float[Tensor, ""]
    """Its edge length [m]: the scene scale that the decoders are told."""


def scene_bounds(positions: Float[Tensor, "v 3"], config: NetworkConfig) -> Bounds:
    """What a scene's positions are normalised by: its own extent, or with `any_extent` the workspace.

    Paper: bounds of the visible cloud, largest extent on all axes.
    """
    if config.any_extent:
        return Bounds(positions.new_zeros(3), positions.new_tensor(SIZE))
    origin = positions.amin(0)
    return Bounds(origin, (positions.amax(0) - origin).amax().clamp(min=config.voxel_size))


@dataclass(frozen=True, eq=False)
class Places:
    """Where some points are, for every query: the product of the two is the encoding of each point for each query."""

    of_queries: Float[Tensor, "q c e"]
    of_points: Float[Tensor, "t e"]

    def select(self, rows: Tensor) -> "Places":
        """The same for some of the points."""
        return Places(self.of_queries, self.of_points[rows])

    def dot(self, weights: Float[Tensor, "q *h c"]) -> Float[Tensor, "q *h e"]:
        """What the points' own part must be multiplied with for the product of the encodings with such weights."""
        return torch.einsum("q...c,qce->q...e", weights, self.of_queries)


class FourierEncoding(nn.Module):
    """Random Fourier features of normalised positions, whose first three channels are the positions themselves.

    Paper: Fourier positional encoding (Gaussian frequencies, fixed).
    Differs with `any_extent`: each query sees all places as if its own seed stood on the middle of the workspace's
    table. Sines and cosines of a difference are those of its parts, turned, so this costs a small matrix per query.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.relative = config.any_extent
        frequencies = torch.randn(3, config.query_width // 2) * config.fourier_scale
        self.register_buffer("frequencies", frequencies)
        self.frequencies: Tensor

    def forward(
        self, points: Float[Tensor, "*p 3"], seeds: Float[Tensor, "*s 3"], bounds: Bounds
    ) -> Float[Tensor, "*r c"]:
        """Encoding of points [m] for queries that were seeded there [m], which broadcast; `query_width` channels."""
        normalised = (points - bounds.origin) / bounds.extent - self._shifts(seeds, bounds)
        phase = 2.0 * math.pi * normalised @ self.frequencies
        return torch.cat([normalised, torch.cat([phase.sin(), phase.cos()], -1)[..., 3:]], -1)

    def places(self, points: Float[Tensor, "t 3"], seeds: Float[Tensor, "q 3"], bounds: Bounds) -> Places:
        """The encoding of all points for all queries, in two factors."""
        return Places(self._of_queries(self._shifts(seeds, bounds)), self._of_points(points, bounds))

    def _shifts(self, seeds: Float[Tensor, "*s 3"], bounds: Bounds) -> Float[Tensor, "*s 3"]:
        """What is taken from normalised positions; none of it along z, since heights above the table mean something."""
        if not self.relative:
            return torch.zeros_like(seeds)
        return (seeds / bounds.extent - 0.5) * seeds.new_tensor([1.0, 1.0, 0.0])

    def _of_points(self, points: Float[Tensor, "t 3"], bounds: Bounds) -> Float[Tensor, "t e"]:
        normalised = (points - bounds.origin) / bounds.extent
        phase = 2.0 * math.pi * normalised @ self.frequencies
        return torch.cat([torch.ones_like(phase[:, :1]), normalised, phase.sin(), phase.cos()], 1)

    def _of_queries(self, shifts: Float[Tensor, "q 3"]) -> Float[Tensor, "q c e"]:
        count, waves = len(shifts), self.frequencies.shape[1]
        phase = 2.0 * math.pi * shifts @ self.frequencies
        sine, cosine = torch.diag_embed(phase.sin()), torch.diag_embed(phase.cos())
        position = torch.cat(
            [-shifts[:, :, None], torch.eye(3, dtype=shifts.dtype, device=shifts.device).expand(count, 3, 3)], 2
        )
        turned = torch.cat([torch.cat([cosine, -sine], 2), torch.cat([sine, cosine], 2)], 1)[:, 3:]
        whole = shifts.new_zeros(count, 2 * waves, 4 + 2 * waves)
        whole[:, :3, :4], whole[:, 3:, 4:] = position, turned
        return whole
