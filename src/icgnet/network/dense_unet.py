"""Dense U-Net over a grid of cells."""

import itertools
from collections.abc import Sequence

import numpy as np
import torch
from jaxtyping import Float
from scipy import ndimage
from torch import Tensor, nn

from icgnet.geometry.cells import PITCH, CellGrid
from icgnet.network.batch_norm import GridBatchNorm
from icgnet.network.config import NetworkConfig
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


class DoubleConv(nn.Sequential):
    """Two convolutions, each with activation and normalisation; cells that are not active stay 0."""

    def __init__(self, inputs: int, hidden: int, outputs: int) -> None:
        layers: list[nn.Module] = []
        for source, target in ((inputs, hidden), (hidden, outputs)):
            layers += [GridConv(source, target), nn.ReLU(inplace=True), GridBatchNorm(target)]
        super().__init__(*layers)

    def forward(
        self, features: Float[Tensor, "b i x y z"], active: Float[Tensor, "b 1 x y z"] | None
    ) -> Float[Tensor, "b o x y z"]:
        """Features of the same grid; `active` is 1 where there are any, None if that is everywhere."""
        for layer in self:
            features = layer(features)
            if active is not None and isinstance(layer, GridBatchNorm):
                features = features.mul_(active)
        return features


STRIDES = (4, 4, 2, 1)
"""Of the maps that are given out."""
COARSEST = 8
"""The largest stride in between."""
NEAR = 4
"""Cells are active in blocks of so many along each axis: those that hold points and those next to these."""


def active_cells(occupied: Float[Tensor, "b 1 x y z"], levels: int) -> list[Float[Tensor, "b 1 _ _ _"]]:
    """1 in the cells near points, 0 elsewhere, for grids of stride 1, 2, 4 and so on."""
    blocks = nn.functional.max_pool3d(occupied, NEAR, ceil_mode=True)
    blocks = nn.functional.max_pool3d(blocks, 3, stride=1, padding=1)
    found = [_repeat_grid(blocks, NEAR, occupied)]
    for _ in range(levels - 1):
        found.append(nn.functional.max_pool3d(found[-1], 2, ceil_mode=True))
    return found


Box = tuple[slice, slice, slice]


def _parts(active: Float[Tensor, "b 1 x y z"]) -> list[tuple[int, Float[Tensor, "_ _ _"], Box]]:
    """Of the coarsest grid each connected part: number of its scene, its cells in the box around it, and that box."""
    found = []
    for scene, cells in enumerate(active[:, 0].cpu().numpy()):
        label = np.zeros(cells.shape, dtype=np.int32)
        ndimage.label(cells, np.ones((3, 3, 3)), output=label)
        for number, box in enumerate(ndimage.find_objects(label), start=1):
            own = torch.from_numpy((label[box] == number).astype(np.float32)).to(active.device)
            found.append((scene, own, box))
    return found


def _scaled(box: Box, factor: int) -> Box:
    x, y, z = (slice(each.start * factor, each.stop * factor) for each in box)
    return x, y, z


def _empty(inputs: Float[Tensor, "b _ x y z"], channels: int, stride: int) -> Tensor:
    return inputs.new_zeros(len(inputs), channels, *(-(-size // stride) for size in inputs.shape[2:]))


class DenseUNet(nn.Module):
    """U-Net over a grid; its four finest decoder-side maps are given out.

    Paper: volumetric features at 1 cm.
    Differs: pooling keeps a partial last cell and upsampling repeats cells, so that cell i of the map at stride s
    covers exactly [i, i + 1] * s * pitch at every level (published: 30 -> 15 -> 7 -> 3 cells, stretched to fit). With
    `any_extent` cells far from all points are as the space outside of the grid, so that how large it is and what
    stands far away makes no difference.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.near_points_only = config.any_extent
        widths = config.dense_widths
        inputs = (config.dense_channels, *widths[:-1])
        self.encoder = nn.ModuleList(
            DoubleConv(source, max(target // 2, source), target) for source, target in zip(inputs, widths, strict=True)
        )
        coarse_to_fine = widths[::-1]
        self.decoder = nn.ModuleList(
            DoubleConv(below + skip, skip, skip) for below, skip in itertools.pairwise(coarse_to_fine)
        )

    def forward(
        self, inputs: Float[Tensor, "b d x y z"], grids: Sequence[CellGrid]
    ) -> tuple[tuple[DenseMap, ...], ...]:
        """For each scene four maps, coarse to fine: strides 4 (encoder), 4, 2 and 1 (decoder).

        Args:
            inputs: of the scenes; larger than the grid of a scene, with zeros there, where that of another is larger.
            grids: where they are.
        """
        outputs = self._maps(inputs) if self.training or not self.near_points_only else self._maps_apart(inputs)
        return tuple(
            tuple(_map_of(output[scene], grid, stride) for output, stride in zip(outputs, STRIDES, strict=True))
            for scene, grid in enumerate(grids)
        )

    def _maps(self, inputs: Float[Tensor, "b d x y z"]) -> list[Float[Tensor, "b _ _ _ _"]]:
        active: list[Tensor] | list[None] = [None] * len(self.encoder)
        skips, features = [], inputs.contiguous(memory_format=torch.channels_last_3d)
        if self.near_points_only:
            active = active_cells(inputs[:, :1], len(self.encoder))
            features = features * active[0]
        for index, block in enumerate(self.encoder):
            if index:
                features = nn.functional.max_pool3d(features, 2, ceil_mode=True)
            features = block(features, active[index])
            skips.append(features)
        outputs = [skips[-2]]
        for index in range(len(self.decoder)):
            skip = skips[-2 - index]
            features = self.decoder[index](torch.cat([_double(features, skip), skip], 1), active[-2 - index])
            outputs.append(features)
        return outputs

    def _maps_apart(self, inputs: Float[Tensor, "b d x y z"]) -> list[Float[Tensor, "b _ _ _ _"]]:
        """The same, of every part of a scene that no convolution connects with the others on its own.

        What it costs then goes with what is occupied, not with the extent.
        """
        parts = _parts(active_cells(inputs[:, :1], len(self.encoder))[-1])
        if len(parts) <= 1:
            return self._maps(inputs)
        outputs: list[Tensor] = []
        for scene, cells, box in parts:
            own = _repeat_grid(cells[None, None], COARSEST, inputs[:1, :1, *_scaled(box, COARSEST)])
            maps = self._maps(inputs[scene : scene + 1, :, *_scaled(box, COARSEST)] * own)
            if not outputs:
                outputs = [
                    _empty(inputs, values.shape[1], stride) for values, stride in zip(maps, STRIDES, strict=True)
                ]
            for whole, values, stride in zip(outputs, maps, STRIDES, strict=True):
                # Boxes may overlap; each part has nothing but zeros where others are.
                whole[scene, :, *_scaled(box, COARSEST // stride)] += values[0]
        return outputs


def _map_of(features: Float[Tensor, "c x y z"], grid: CellGrid, stride: int) -> DenseMap:
    """The map of a scene, without what lies beyond its grid."""
    size_x, size_y, size_z = (-(-cells // stride) for cells in grid.shape)
    own = features[:, :size_x, :size_y, :size_z].permute(1, 2, 3, 0)
    return DenseMap(own.float().contiguous(), PITCH * stride, grid.origin)


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
        return (*coarser, DenseMap(torch.cat([finest.features, total], 3), finest.pitch, finest.origin))


def _repeat(features: Float[Tensor, "x y z c"], factor: int, like: Tensor) -> Tensor:
    """Every cell repeated along each axis, cut to the size of `like`."""
    (x, y, z, channels), (size_x, size_y, size_z) = features.shape, like.shape[:3]
    if factor == 1:
        return features[:size_x, :size_y, :size_z]
    apart = features[:, None, :, None, :, None].expand(x, factor, y, factor, z, factor, channels)
    return apart.reshape(x * factor, y * factor, z * factor, channels)[:size_x, :size_y, :size_z]


def _double(features: Tensor, like: Tensor) -> Tensor:
    return _repeat_grid(features, 2, like)


def _repeat_grid(features: Tensor, factor: int, like: Tensor) -> Tensor:
    """Every cell repeated along each of the last three axes, cut to the size of `like`."""
    repeated = nn.functional.interpolate(features, scale_factor=factor, mode="nearest")
    size_x, size_y, size_z = like.shape[2:]
    return repeated[:, :, :size_x, :size_y, :size_z]
