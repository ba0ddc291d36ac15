"""Sparse convolution in pure PyTorch: gathers by a cached neighbour table, and matrix products.

A voxel set is a list of integer coordinates `(batch, x, y, z)`, of any extent and sign; scenes of a batch never see
each other. Weights are stored as `[kernel volume, in, out]`, kernel offsets in the order of x, y, z with z fastest.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from icgnet.errors import InputError

_TABLE_CELLS = 1 << 24
"""Up to so many cells the lookup is a dense table (64 MB), beyond it a binary search in the sorted keys."""

_SURFACE_SHARE = 0.4
"""Share of a kernel's cells that are occupied around a voxel of a surface: the fan-in that initialisation counts."""


class CoordinateIndex:
    """Finds the row of a voxel by its coordinates, `margin` cells beyond the set's bounds included."""

    def __init__(self, coordinates: Int[Tensor, "v 4"], margin: int) -> None:
        border = coordinates.new_tensor([0, margin, margin, margin])
        lower = coordinates.amin(0) - border
        extent = [int(size) for size in coordinates.amax(0) + border - lower + 1]
        cells = math.prod(extent)
        if cells >= 2**62:
            raise InputError(f"voxel coordinates extend over {extent} cells: too far apart to index")
        self.margin = margin
        self.rows = len(coordinates)
        self.strides = coordinates.new_tensor([math.prod(extent[axis + 1 :]) for axis in range(4)])
        self.keys = ((coordinates - lower) * self.strides).sum(1)
        self._table = self._sorted = self._order = None
        if cells <= _TABLE_CELLS:
            self._table = torch.full((cells,), self.rows, dtype=torch.int32, device=coordinates.device)
            self._table[self.keys] = torch.arange(self.rows, dtype=torch.int32, device=coordinates.device)
        else:
            self._sorted, self._order = self.keys.sort()

    def neighbours(self, offsets: Int[Tensor, "k 3"]) -> Int[Tensor, "v k"]:
        """Row of the neighbour at each offset from each voxel; `v` (one past the end) where there is none."""
        keys = self.keys[:, None] + (offsets * self.strides[1:]).sum(1)
        if self._table is not None:
            return self._table[keys]
        assert self._sorted is not None
        assert self._order is not None
        position = torch.searchsorted(self._sorted, keys).clamp_(max=self.rows - 1)
        found = self._sorted[position] == keys
        return torch.where(found, self._order[position], self.rows).int()


class VoxelLevel:
    """Voxels of one resolution, with the neighbour tables that its convolutions share."""

    def __init__(self, coordinates: Int[Tensor, "v 4"]) -> None:
        self.coordinates = coordinates
        self._index: CoordinateIndex | None = None
        self._neighbours: dict[tuple[int, int], Tensor] = {}

    def __len__(self) -> int:
        return len(self.coordinates)

    def neighbours(self, kernel: int, dilation: int = 1) -> Int[Tensor, "v k"]:
        """Neighbour table of a cubic kernel (odd size), cached."""
        if (kernel, dilation) not in self._neighbours:
            reach = kernel // 2 * dilation
            if self._index is None or self._index.margin < reach:
                self._index = CoordinateIndex(self.coordinates, max(reach, 2))
            steps = range(-reach, reach + 1, dilation)
            offsets = self.coordinates.new_tensor(list(itertools.product(steps, repeat=3)))
            self._neighbours[kernel, dilation] = self._index.neighbours(offsets)
        return self._neighbours[kernel, dilation]


class Coarsening:
    """Voxels of twice the pitch, and which of the 8 children of which coarse voxel every fine voxel is."""

    def __init__(self, fine: VoxelLevel) -> None:
        batch, position = fine.coordinates[:, :1], fine.coordinates[:, 1:]
        halved = torch.cat([batch, position.div(2, rounding_mode="floor")], 1)
        keys, parents = torch.unique(CoordinateIndex(halved, 0).keys, return_inverse=True)
        coordinates = torch.empty_like(halved[: len(keys)])
        coordinates[parents] = halved
        self.coarse = VoxelLevel(coordinates)
        self.parents: Int[Tensor, " v"] = parents
        octant = (position % 2 * position.new_tensor([4, 2, 1])).sum(1)
        self.slots: Int[Tensor, " v"] = parents * 8 + octant


ROWS_AT_ONCE = 2048
"""Voxels whose neighbours are gathered together: what that takes stays in the cache, which is several times faster."""


def _gather(features: Tensor, neighbours: Tensor) -> Iterator[tuple[slice, Tensor]]:
    """Features of all neighbours of some rows after the other, 0 for those that are missing."""
    padded = torch.cat([features, features.new_zeros(1, features.shape[1])])
    for start in range(0, len(neighbours), ROWS_AT_ONCE):
        part = slice(start, start + ROWS_AT_ONCE)
        table = neighbours[part]
        yield part, padded.index_select(0, table.reshape(-1)).view(len(table), -1)


def _gathered_product(features: Tensor, neighbours: Tensor, matrix: Tensor) -> Tensor:
    product = features.new_empty(len(neighbours), matrix.shape[1])
    for part, gathered in _gather(features, neighbours):
        torch.mm(gathered, matrix, out=product[part])
    return product


class _SubmanifoldProduct(torch.autograd.Function):
    """Gather and multiply.

    The neighbour relation is symmetric, so the backward pass is a gather too: the gradient gathered with the same table
    serves the input's gradient (flipped kernel) and the weight's, without a scatter. Where the input needs no gradient
    (the first layer, whose kernel is the largest) that of the weight is made from its neighbours alone.
    """

    @staticmethod
    def forward(ctx: Any, features: Tensor, weight: Tensor, neighbours: Tensor) -> Tensor:
        ctx.of_input = ctx.needs_input_grad[0]
        ctx.save_for_backward(features, weight, neighbours)
        return _gathered_product(features, neighbours, weight.reshape(-1, weight.shape[2]))

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor, None]:
        features, weight, neighbours = ctx.saved_tensors
        volume, inputs, outputs = weight.shape
        # Sums over all voxels, so in 32 bits.
        if not ctx.of_input:
            total = weight.new_zeros(volume * inputs, outputs, dtype=torch.float32)
            for part, gathered in _gather(features, neighbours):
                total += gathered.t() @ gradient[part]
            return None, total.view(volume, inputs, outputs).to(weight.dtype), None
        flipped = weight.flip(0).transpose(1, 2).reshape(-1, inputs)
        of_features = torch.empty_like(features)
        total = weight.new_zeros(inputs, volume * outputs, dtype=torch.float32)
        for part, gathered in _gather(gradient, neighbours):
            torch.mm(gathered, flipped, out=of_features[part])
            total += features[part].t() @ gathered
        of_weight = total.view(inputs, volume, outputs).transpose(0, 1).flip(0)
        return of_features, of_weight.to(weight.dtype), None


def submanifold_convolution(
    features: Float[Tensor, "v i"], weight: Float[Tensor, "k i o"], neighbours: Int[Tensor, "v k"]
) -> Float[Tensor, "v o"]:
    """Convolution that keeps the voxel set: `out[v] = sum_k features[neighbours[v, k]] @ weight[k]`.

    `neighbours` must be the table of a kernel that is symmetric about its centre (`VoxelLevel.neighbours`).
    Under `torch.autocast` the product runs in the reduced precision.
    """
    if torch.is_autocast_enabled(features.device.type):
        dtype = torch.get_autocast_dtype(features.device.type)
        features, weight = features.to(dtype), weight.to(dtype)
    return _SubmanifoldProduct.apply(features, weight, neighbours)


def _initial_weight(volume: int, inputs: int, outputs: int, share: float) -> nn.Parameter:
    fan_in = max(1.0, volume * share) * inputs
    return nn.Parameter(torch.randn(volume, inputs, outputs) * math.sqrt(2.0 / fan_in))


class SubmanifoldConv(nn.Module):
    """Cubic convolution (odd kernel, no bias) on the voxels that are there."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 3, dilation: int = 1) -> None:
        super().__init__()
        self.kernel, self.dilation = kernel, dilation
        self.weight = _initial_weight(kernel**3, inputs, outputs, _SURFACE_SHARE)

    def forward(self, features: Float[Tensor, "v i"], level: VoxelLevel) -> Float[Tensor, "v o"]:
        """Convolved features of the same voxels."""
        return submanifold_convolution(features, self.weight, level.neighbours(self.kernel, self.dilation))


class DownConv(nn.Module):
    """Convolution with kernel 2 and stride 2, no bias: from fine voxels to their parents."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.weight = _initial_weight(8, inputs, outputs, _SURFACE_SHARE)

    def forward(self, features: Float[Tensor, "v i"], step: Coarsening) -> Float[Tensor, "p o"]:
        """Features of the coarse voxels of a step."""
        children = features.new_zeros(len(step.coarse) * 8, features.shape[1]).index_copy(0, step.slots, features)
        return children.view(len(step.coarse), -1) @ self.weight.reshape(-1, self.weight.shape[2])


class UpConv(nn.Module):
    """Transposed convolution with kernel 2 and stride 2, no bias: from parents back to the fine voxels."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.weight = _initial_weight(8, inputs, outputs, 1.0 / 8)

    def forward(self, features: Float[Tensor, "p i"], step: Coarsening) -> Float[Tensor, "v o"]:
        """Features of the fine voxels of a step."""
        outputs = self.weight.shape[2]
        children = features @ self.weight.transpose(0, 1).reshape(features.shape[1], -1)
        return children.view(-1, outputs).index_select(0, step.slots)
