"""Features on a grid of cells, and exact reads from them."""

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from torch import Tensor, nn
from torch.autograd.function import once_differentiable


@dataclass(frozen=True, eq=False)
class DenseMap:
    """Features on a grid."""

    features: Float[Tensor, "x y z c"]
    pitch: float
    """Cell size [m]."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where cell `(0, 0, 0)` starts [m]."""

    def nearest(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n c"]:
        """Features of the cells that contain the points [m, table frame]; outside, of the border cell."""
        cells = torch.floor(self._in_cells(points))
        x, y, z = (self._row_parts(axis, cells[:, axis]) for axis in range(3))
        return self._table().index_select(0, x + y + z)

    def trilinear(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n c"]:
        """Features interpolated between cell centres at the points [m, table frame]; the border continues outside.

        Differentiable in the map and in the points.
        """
        position = self._in_cells(points) - 0.5
        base = torch.floor(position.detach())
        upper = position - base
        shares = torch.stack([1.0 - upper, upper], 2)
        corners = torch.stack([base, base + 1.0], 2)
        x, y, z = (self._row_parts(axis, corners[:, axis]) for axis in range(3))
        rows = (x[:, :, None, None] + y[:, None, :, None] + z[:, None, None, :]).view(-1, 8)
        of_x, of_y, of_z = shares.unbind(1)
        weights = (of_x[:, :, None, None] * of_y[:, None, :, None] * of_z[:, None, None, :]).view(-1, 8)
        return _WeightedRows.apply(self._table(), rows, weights)

    def _in_cells(self, points: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
        return (points - points.new_tensor(self.origin)) / self.pitch

    def _table(self) -> Tensor:
        return self.features.reshape(-1, self.features.shape[-1])

    def _row_parts(self, axis: int, cells: Tensor) -> Tensor:
        """What the cell number along one axis adds to the row in the table."""
        sizes = self.features.shape[:3]
        stride = (sizes[1] * sizes[2], sizes[2], 1)[axis]
        return cells.clamp(0, sizes[axis] - 1).int() * stride


class _WeightedRows(torch.autograd.Function):
    """Weighted sums of table rows: `out[n] = sum_k weights[n, k] * table[rows[n, k]]`.

    As `embedding_bag`, whose own backward pass sorts all rows and takes longer than the rest of the decoder; on the CPU
    the product with the transposed sparse matrix needs no order.
    """

    @staticmethod
    def forward(ctx: Any, table: Tensor, rows: Int[Tensor, "n k"], weights: Float[Tensor, "n k"]) -> Tensor:
        ctx.save_for_backward(table, rows, weights)
        return nn.functional.embedding_bag(rows, table, per_sample_weights=weights.to(table.dtype), mode="sum")

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, None, Tensor | None]:
        table, rows, weights = ctx.saved_tensors
        of_table = of_weights = None
        if ctx.needs_input_grad[0]:
            of_table = _scatter(gradient, rows, weights, len(table))
        if ctx.needs_input_grad[2]:
            of_weights = torch.einsum("nkc,nc->nk", table[rows], gradient).to(weights.dtype)
        return of_table, None, of_weights


def _scatter(gradient: Tensor, rows: Tensor, weights: Tensor, size: int) -> Tensor:
    if gradient.device.type == "cpu" and gradient.dtype in (torch.float32, torch.float64):
        starts = torch.arange(0, rows.numel() + 1, rows.shape[1], dtype=torch.int32)
        entries = (weights.detach().flatten().numpy(), rows.flatten().numpy(), starts.numpy())
        return torch.from_numpy(csr_array(entries, shape=(len(rows), size)).T @ gradient.contiguous().numpy())
    spread = (weights[:, :, None] * gradient[:, None]).to(gradient.dtype).reshape(-1, gradient.shape[1])
    return gradient.new_zeros(size, gradient.shape[1]).index_add(0, rows.flatten(), spread)
