"""Sparse U-Net over the surface voxels: features at four resolutions."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from icgnet.network.batch_norm import VoxelBatchNorm
from icgnet.network.config import NetworkConfig
from icgnet.network.sparse_conv import Coarsening, DownConv, SubmanifoldConv, UpConv, VoxelLevel


@dataclass(frozen=True)
class VoxelPyramid:
    """A batch of voxel sets at strides 1, 2, 4, 8 and 16, fine to coarse, and the four steps between them."""

    levels: tuple[VoxelLevel, ...]
    steps: tuple[Coarsening, ...]

    @classmethod
    def build(cls, coordinates: Int[Tensor, "v 4"], depth: int = 4) -> "VoxelPyramid":
        """The pyramid above voxels `(batch, x, y, z)`; rows of a scene stay together at every level."""
        levels, steps = [VoxelLevel(coordinates)], []
        for _ in range(depth):
            steps.append(Coarsening(levels[-1]))
            levels.append(steps[-1].coarse)
        return cls(tuple(levels), tuple(steps))


class SparseBlock(nn.Module):
    """Two 3^3 convolutions with a shortcut."""

    def __init__(self, inputs: int, outputs: int, dilation: int, momentum: float) -> None:
        super().__init__()
        self.first = SubmanifoldConv(inputs, outputs, 3, dilation)
        self.first_norm = VoxelBatchNorm(outputs, momentum=momentum)
        self.second = SubmanifoldConv(outputs, outputs, 3, dilation)
        self.second_norm = VoxelBatchNorm(outputs, momentum=momentum)
        self.shortcut = nn.Identity()
        if inputs != outputs:
            self.shortcut = nn.Sequential(
                nn.Linear(inputs, outputs, bias=False), VoxelBatchNorm(outputs, momentum=momentum)
            )

    def forward(self, features: Float[Tensor, "v i"], level: VoxelLevel) -> Float[Tensor, "v o"]:
        """Features of the same voxels."""
        hidden = torch.relu(self.first_norm(self.first(features, level)))
        return torch.relu(self.second_norm(self.second(hidden, level)) + self.shortcut(features))


class SparseUNet(nn.Module):
    """Residual U-Net: stem 5^3, four levels down (kernel 2, stride 2), four up with skip connections.

    Paper: surface features. Published sizes: stem 8, encoder 16/32/64/128, decoder 64/64/32/32, dilation 2 in all
    blocks but the first and the last.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        stem, encoder, decoder = config.stem_width, config.encoder_widths, config.decoder_widths
        momentum = config.batch_norm_momentum
        skips = (stem, *encoder[:-1])
        self.stem = SubmanifoldConv(config.surface_channels, stem, kernel=5)
        self.stem_norm = VoxelBatchNorm(stem, momentum=momentum)
        self.down = nn.ModuleList(DownConv(width, width) for width in skips)
        self.down_norms = nn.ModuleList(VoxelBatchNorm(width, momentum=momentum) for width in skips)
        self.encoder = nn.ModuleList(
            SparseBlock(inputs, outputs, dilation, momentum)
            for inputs, outputs, dilation in zip(skips, encoder, config.dilations[:4], strict=True)
        )
        ups = zip((encoder[-1], *decoder[:-1]), decoder, strict=True)
        self.up = nn.ModuleList(UpConv(inputs, outputs) for inputs, outputs in ups)
        self.up_norms = nn.ModuleList(VoxelBatchNorm(width, momentum=momentum) for width in decoder)
        self.decoder = nn.ModuleList(
            SparseBlock(width + skip, width, dilation, momentum)
            for width, skip, dilation in zip(decoder, reversed(skips), config.dilations[4:], strict=True)
        )

    def forward(self, pyramid: VoxelPyramid, given: Float[Tensor, "v c"]) -> tuple[Float[Tensor, "_ _"], ...]:
        """Features at strides 8, 4, 2 and 1, coarse to fine, from those that are given for the voxels."""
        finest = pyramid.levels[0]
        features = given.to(self.stem.weight.dtype)
        features = torch.relu(self.stem_norm(self.stem(features, finest)))
        skips = []
        for index, step in enumerate(pyramid.steps):
            skips.append(features)
            features = torch.relu(self.down_norms[index](self.down[index](features, step)))
            features = self.encoder[index](features, step.coarse)
        outputs = []
        for index, step in enumerate(reversed(pyramid.steps)):
            features = torch.relu(self.up_norms[index](self.up[index](features, step)))
            level = pyramid.levels[-2 - index]
            features = self.decoder[index](torch.cat([features, skips[-1 - index]], 1), level)
            outputs.append(features)
        return tuple(outputs)
