"""Dense U-Net over the workspace grid."""

import itertools

import torch
from jaxtyping import Float
from torch import Tensor, nn

from icgnet.network.batch_norm import GridBatchNorm
from icgnet.network.config import DENSE_PITCH, NetworkConfig
from icgnet.network.dense_map import DenseMap


class GridConv(nn.Conv3d):
    """3^3 convolution without bias that keeps the grid's size.

    Without gradients it calls oneDNN itself: for one float32 volume of this size PyTorch picks a reference kernel that
    is several times slower.
    """

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__(inputs, outputs, 3, padding=1, bias=False)

    def forward(self, input: Float[Tensor, "b i x y z"]) -> Float[Tensor, "b o x y z"]:
        """Convolved grid, zeros beyond the border."""
        reduced = torch.is_autocast_enabled(input.device.type)
        plain = input.device.type == "cpu" and input.dtype == torch.float32 and not reduced
        if plain and not torch.is_grad_enabled() and torch.backends.mkldnn.is_available():
            ones = (1, 1, 1)
            return torch.mkldnn_convolution(input, self.weight, None, ones, ones, ones, 1)
        return super().forward(input)


def _double_conv(inputs: int, hidden: int, outputs: int) -> nn.Sequential:
    layers: list[nn.Module] = []
    for source, target in ((inputs, hidden), (hidden, outputs)):
        layers += [GridConv(source, target), nn.ReLU(), GridBatchNorm(target)]
    return nn.Sequential(*layers)


class DenseUNet(nn.Module):
    """U-Net over the workspace grid; its four finest decoder-side maps are given out.

    Paper: volumetric features at 1 cm.
    Differs: pooling keeps a partial last cell and upsampling repeats cells, so that cell i of the map at stride s
    covers exactly [i, i + 1] * s * pitch at every level (published: 30 -> 15 -> 7 -> 3 cells, stretched to fit).
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        widths = config.dense_widths
        inputs = (config.dense_channels, *widths[:-1])
        self.encoder = nn.ModuleList(
            _double_conv(source, max(target // 2, source), target)
            for source, target in zip(inputs, widths, strict=True)
        )
        coarse_to_fine = widths[::-1]
        self.decoder = nn.ModuleList(
            _double_conv(below + skip, skip, skip) for below, skip in itertools.pairwise(coarse_to_fine)
        )

    def forward(self, grid: Float[Tensor, "b d x y z"]) -> tuple[tuple[DenseMap, ...], ...]:
        """For each scene four maps, coarse to fine: strides 4 (encoder), 4, 2 and 1 (decoder)."""
        skips, features = [], grid.contiguous(memory_format=torch.channels_last_3d)
        for index, block in enumerate(self.encoder):
            if index:
                features = nn.functional.max_pool3d(features, 2, ceil_mode=True)
            features = block(features)
            skips.append(features)
        outputs = [skips[-2]]
        for block, skip in zip(self.decoder, reversed(skips[:-1]), strict=True):
            features = block(torch.cat([_double(features, skip), skip], 1))
            outputs.append(features)
        strides = (4, 4, 2, 1)
        return tuple(
            tuple(
                DenseMap(output[scene].permute(1, 2, 3, 0).float().contiguous(), DENSE_PITCH * stride)
                for output, stride in zip(outputs, strides, strict=True)
            )
            for scene in range(len(grid))
        )


class CoarseVolume(nn.Module):
    """Puts what the coarser maps say beside the finest map, for the decoders.

    Differs from the paper, whose decoders read one map: the finest has few channels, and what is far away tells the
    hidden side of an object.
    """

    def __init__(self, widths: tuple[int, ...], channels: int) -> None:
        """`widths` are those of the maps, coarse to fine."""
        super().__init__()
        self.project = nn.ModuleList(nn.Linear(width, channels) for width in widths[:-1])

    def forward(self, maps: tuple[DenseMap, ...]) -> tuple[DenseMap, ...]:
        """The maps of a scene, coarse to fine, the finest with more channels."""
        *coarser, finest = maps
        # Added level by level, so that only the sum is as large as the finest map.
        total: Tensor | float = 0.0
        for project, level, finer in zip(self.project, coarser, maps[1:], strict=True):
            total = _repeat(total + project(level.features), round(level.pitch / finer.pitch), finer.features)
        assert isinstance(total, Tensor)
        return (*coarser, DenseMap(torch.cat([finest.features, total], 3), finest.pitch))


def _repeat(features: Float[Tensor, "x y z c"], factor: int, like: Tensor) -> Tensor:
    """Every cell repeated along each axis, cut to the size of `like`."""
    (x, y, z, channels), (size_x, size_y, size_z) = features.shape, like.shape[:3]
    if factor == 1:
        return features[:size_x, :size_y, :size_z]
    apart = features[:, None, :, None, :, None].expand(x, factor, y, factor, z, factor, channels)
    return apart.reshape(x * factor, y * factor, z * factor, channels)[:size_x, :size_y, :size_z]


def _double(features: Tensor, like: Tensor) -> Tensor:
    """Every cell repeated twice along each axis, cut to the size of `like`."""
    doubled = nn.functional.interpolate(features, scale_factor=2, mode="nearest")
    size_x, size_y, size_z = like.shape[2:]
    return doubled[:, :, :size_x, :size_y, :size_z]
