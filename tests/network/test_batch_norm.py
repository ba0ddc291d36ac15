"""Batch normalisation of voxels, and statistics over several processes (here: threads that exchange as they would)."""

import threading

import pytest
import torch

from icgnet.network.batch_norm import GridBatchNorm, VoxelBatchNorm, synchronise_statistics

SIZES = (37, 5)
"""Rows of the two processes."""


class Exchange:
    """What `torch.distributed` does for two threads."""

    def __init__(self) -> None:
        self.rank = threading.local()
        self._meet = threading.Barrier(len(SIZES), timeout=30)
        self._given: list[torch.Tensor] = [torch.empty(0)] * len(SIZES)

    def get_world_size(self) -> int:
        return len(SIZES)

    def all_gather(self, parts, own):
        self._given[self.rank.value] = own
        self._meet.wait()
        for part, given in zip(parts, self._given, strict=True):
            part.copy_(given)
        self._meet.wait()

    def all_reduce(self, values):
        parts = [torch.empty_like(values) for _ in SIZES]
        self.all_gather(parts, values)
        values.copy_(torch.stack(parts).sum(0))


@pytest.fixture
def exchange(monkeypatch) -> Exchange:
    exchange = Exchange()
    for name in ("get_world_size", "all_gather", "all_reduce"):
        monkeypatch.setattr(torch.distributed, name, getattr(exchange, name))
    return exchange


def run_together(exchange, work):
    """Results of `work(rank)` of two threads."""
    results: dict[int, object] = {}

    def run(rank):
        exchange.rank.value = rank
        results[rank] = work(rank)

    threads = [threading.Thread(target=run, args=(rank,)) for rank in range(len(SIZES))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return [results[rank] for rank in range(len(SIZES))]


def norm_of(kind):
    # Two threads draw at the same time: each from a generator of its own.
    rng = torch.Generator().manual_seed(2)
    norm = kind(3)
    torch.nn.init.normal_(norm.weight, generator=rng)
    torch.nn.init.normal_(norm.bias, generator=rng)
    return norm


@pytest.mark.parametrize(("kind", "shape"), [(VoxelBatchNorm, (3,)), (GridBatchNorm, (3, 2, 4, 3))])
def test_two_processes_normalise_as_one_with_both_batches(exchange, kind, shape):
    torch.manual_seed(1)
    # A mean far from zero shows what is lost by subtracting large sums.
    whole = (100.0 + torch.randn(sum(SIZES), *shape)).requires_grad_()
    upstream = torch.randn(sum(SIZES), *shape)
    alone = norm_of(kind)
    expected = alone(whole)
    expected.backward(upstream)

    def work(rank):
        part = whole.detach().split(SIZES)[rank].clone().requires_grad_()
        norm = norm_of(kind)
        synchronise_statistics(norm)
        output = norm(part)
        output.backward(upstream.split(SIZES)[rank])
        return norm, part, output

    (first, a, one), (second, b, two) = run_together(exchange, work)
    torch.testing.assert_close(torch.cat([one, two]), expected, rtol=1e-4, atol=1e-4)
    torch.testing.assert_close(torch.cat([a.grad, b.grad]), whole.grad, rtol=1e-3, atol=1e-4)
    for name in ("weight", "bias"):
        together = getattr(first, name).grad + getattr(second, name).grad
        torch.testing.assert_close(together, getattr(alone, name).grad, rtol=1e-3, atol=1e-3)
    for norm in (first, second):
        torch.testing.assert_close(norm.running_mean, alone.running_mean)
        torch.testing.assert_close(norm.running_var, alone.running_var)
        assert norm.num_batches_tracked == 1


def test_a_process_with_a_single_voxel_takes_part(exchange):
    def work(rank):
        norm = VoxelBatchNorm(3)
        synchronise_statistics(norm)
        norm(torch.full((1 + rank, 3), float(rank)))
        return norm.running_mean

    for mean in run_together(exchange, work):
        torch.testing.assert_close(mean, torch.full((3,), 2.0 / 3.0))


def test_evaluation_asks_nobody():
    norm = GridBatchNorm(3).eval()
    synchronise_statistics(norm)
    assert norm(torch.ones(1, 3, 2, 2, 2)).shape == (1, 3, 2, 2, 2)


def test_batch_norm_takes_a_single_voxel_in_training():
    norm = VoxelBatchNorm(3)
    assert torch.isfinite(norm(torch.ones(1, 3))).all()
    assert norm.training
    assert torch.equal(norm.running_mean, torch.zeros(3))


def test_batch_norm_forgets_quickly_at_first_and_at_its_momentum_later():
    norm, features = VoxelBatchNorm(2, momentum=0.02), torch.randn(500, 2) * 3 + 5
    norm(features[:200])
    norm(features[200:400])
    expected = 0.25 * features[:200].mean(0) + 0.75 * features[200:400].mean(0)
    torch.testing.assert_close(norm.running_mean, expected)
    for _ in range(150):
        norm(features[:200])
    before = norm.running_mean.clone()
    norm(features[400:])
    torch.testing.assert_close(norm.running_mean, 0.98 * before + 0.02 * features[400:].mean(0))
