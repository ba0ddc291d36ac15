"""Batch normalisation over voxels and grids, in one process or with the statistics of several."""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn
from torch.autograd.function import once_differentiable


class VoxelBatchNorm(nn.BatchNorm1d):
    """Batch normalisation over voxels, also for single scenes.

    The running statistics start as those of the first batch and forget quickly at first, at `momentum` only after some
    3 / momentum batches: with the small momentum alone, evaluation early in training is spoilt by where they started. A
    level with a single voxel has no variance and is normalised by the running statistics.
    """

    synchronised = False
    """Whether training statistics are those of all processes, see `synchronise_statistics`."""

    def forward(self, input: Float[Tensor, "v c"]) -> Float[Tensor, "v c"]:
        """Normalised features."""
        batch, share = self.training and (self.synchronised or len(input) > 1), 0.0
        if batch:
            assert self.num_batches_tracked is not None
            assert self.momentum is not None
            self.num_batches_tracked.add_(1)
            share = max(self.momentum, 3.0 / (2 + int(self.num_batches_tracked)))
        if batch and self.synchronised:
            return _normalise_together(self, input, share)
        return nn.functional.batch_norm(
            input, self.running_mean, self.running_var, self.weight, self.bias, batch, share, self.eps
        )


class GridBatchNorm(nn.BatchNorm3d):
    """Batch normalisation over the cells of a grid."""

    synchronised = False
    """Whether training statistics are those of all processes, see `synchronise_statistics`."""

    def forward(self, input: Float[Tensor, "b c x y z"]) -> Float[Tensor, "b c x y z"]:
        """Normalised grid."""
        if not (self.training and self.synchronised):
            return super().forward(input)
        assert self.num_batches_tracked is not None
        assert self.momentum is not None
        self.num_batches_tracked.add_(1)
        return _normalise_together(self, input, self.momentum)


def synchronise_statistics(network: nn.Module) -> None:
    """Lets every batch normalisation of a network take its statistics over the batches of all processes.

    From then on every process of torch's default group must call the network in training mode as often as the others.
    """
    for module in network.modules():
        if isinstance(module, VoxelBatchNorm | GridBatchNorm):
            module.synchronised = True


def _normalise_together(norm: VoxelBatchNorm | GridBatchNorm, input: Tensor, share: float) -> Tensor:
    """Normalises by the statistics of all processes, and moves the running statistics towards them by `share`."""
    assert norm.running_mean is not None
    assert norm.running_var is not None
    output, mean, variance, count = _SharedBatchNorm.apply(input, norm.weight, norm.bias, norm.eps)
    with torch.no_grad():
        norm.running_mean.lerp_(mean, share)
        norm.running_var.lerp_(variance * count / (count - 1.0), share)
    return output


class _SharedBatchNorm(torch.autograd.Function):
    """Batch normalisation with the statistics of all processes, on any device.

    As `torch.nn.SyncBatchNorm`, which is for GPUs only. One small message each way: counts, means and variances going
    forward; the gradient's sum and its product with the output going back. The gradient is that of the sum of all
    processes' losses.
    """

    @staticmethod
    def forward(
        ctx: Any, input: Tensor, weight: Tensor, bias: Tensor, eps: float
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        values, axes = input.float(), _all_but_channels(input)
        variance, mean = torch.var_mean(values, axes, correction=0)
        count = mean.new_full((1,), input.numel() // input.shape[1])
        own = torch.cat([count, mean, variance])
        parts = [torch.empty_like(own) for _ in range(torch.distributed.get_world_size())]
        torch.distributed.all_gather(parts, own)
        counts, means, variances = torch.stack(parts).split([1, len(mean), len(mean)], 1)
        count = counts.sum()
        mean = (counts * means).sum(0) / count
        variance = (counts * (variances + (means - mean).square())).sum(0) / count
        scale = (variance + eps).rsqrt()
        ctx.save_for_backward(input, weight, mean, scale, count)
        ctx.mark_non_differentiable(mean, variance, count)
        shape = _along_channels(input)
        output = (values - mean.view(shape)) * (scale * weight).view(shape) + bias.view(shape)
        return output.to(input.dtype), mean, variance, count

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor, *_: Tensor) -> tuple[Tensor, Tensor, Tensor, None]:
        input, weight, mean, scale, count = ctx.saved_tensors
        shape, axes, upstream = _along_channels(input), _all_but_channels(input), gradient.float()
        normalised = (input.float() - mean.view(shape)) * scale.view(shape)
        of_bias, of_weight = upstream.sum(axes), (upstream * normalised).sum(axes)
        sums = torch.cat([of_bias, of_weight])
        torch.distributed.all_reduce(sums)
        common, along = (sums / count).view(2, -1)
        of_input = upstream - common.view(shape) - normalised * along.view(shape)
        return (of_input * (scale * weight).view(shape)).to(input.dtype), of_weight, of_bias, None


def _all_but_channels(input: Tensor) -> list[int]:
    return [axis for axis in range(input.ndim) if axis != 1]


def _along_channels(input: Tensor) -> list[int]:
    return [1, -1] + [1] * (input.ndim - 2)
