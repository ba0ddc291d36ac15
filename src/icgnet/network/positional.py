"""Fourier positional encoding of points in the workspace."""

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
    """Its lower corner [m, workspace frame]."""
    extent: Float[Tensor, ""]
    """Its edge length [m]: the scene scale that the decoders are told."""

    def normalise(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        """Points [m] in units of the cube: inside it, 0 to 1."""
        return (points - self.origin) / self.extent


def scene_bounds(positions: Float[Tensor, "v 3"], config: NetworkConfig) -> Bounds:
    """What a scene's positions are normalised by: its own extent ("cloud") or the workspace ("workspace").

    Paper: bounds of the visible cloud, largest extent on all axes.
    Differs: `default` uses the fixed workspace, so that one more object does not shift every encoding.
    """
    if config.position_scale == "cloud":
        origin = positions.amin(0)
        return Bounds(origin, (positions.amax(0) - origin).amax().clamp(min=config.voxel_size))
    return Bounds(positions.new_zeros(3), positions.new_tensor(SIZE))


class FourierEncoding(nn.Module):
    """Random Fourier features of normalised positions, whose first three channels are the positions themselves.

    Paper: Fourier positional encoding (Gaussian frequencies, fixed).
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        frequencies = torch.randn(3, config.query_width // 2) * config.fourier_scale
        self.register_buffer("frequencies", frequencies)
        self.frequencies: Tensor

    def forward(self, points: Float[Tensor, "n 3"], bounds: Bounds) -> Float[Tensor, "n c"]:
        """Encoding of points [m, workspace frame]; `query_width` channels."""
        normalised = bounds.normalise(points)
        phase = 2.0 * math.pi * normalised @ self.frequencies
        return torch.cat([normalised, torch.cat([phase.sin(), phase.cos()], 1)[:, 3:]], 1)
