import pytest
import torch
from torch import nn

from icgnet.errors import InputError
from icgnet.network import sparse_conv
from icgnet.network.sparse_conv import (
    Coarsening,
    CoordinateIndex,
    DownConv,
    SubmanifoldConv,
    UpConv,
    VoxelLevel,
)
from reference import dense_grid, submanifold_convolution


def random_voxels(count: int, low: int, high: int, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.unique(torch.randint(low, high, (count, 3), generator=generator), dim=0)


def batch_of(*scenes: torch.Tensor) -> torch.Tensor:
    return torch.cat([nn.functional.pad(voxels, (1, 0), value=index) for index, voxels in enumerate(scenes)])


@pytest.mark.parametrize(("kernel", "dilation"), [(3, 1), (3, 2), (5, 1)])
@pytest.mark.parametrize("table_cells", [1 << 24, 0], ids=["table", "sorted keys"])
def test_submanifold_convolution_equals_dense_convolution(monkeypatch, kernel, dilation, table_cells):
    monkeypatch.setattr(sparse_conv, "_TABLE_CELLS", table_cells)
    scenes = random_voxels(200, -9, 3, seed=1), random_voxels(150, -4, 6, seed=2)
    layer = SubmanifoldConv(3, 4, kernel, dilation).double()
    features = torch.randn(sum(map(len, scenes)), 3, dtype=torch.float64, requires_grad=True)
    result = layer(features, VoxelLevel(batch_of(*scenes)))
    parts = zip(scenes, features.split([len(scene) for scene in scenes]), strict=True)
    expected = torch.cat([submanifold_convolution(c, f, layer.weight, kernel, dilation) for c, f in parts])
    torch.testing.assert_close(result, expected)

    upstream = torch.randn_like(result)
    gradients = torch.autograd.grad(result, (features, layer.weight), upstream)
    expected_gradients = torch.autograd.grad(expected, (features, layer.weight), upstream)
    for gradient, expected_gradient in zip(gradients, expected_gradients, strict=True):
        torch.testing.assert_close(gradient, expected_gradient)
    (alone,) = torch.autograd.grad(layer(features.detach(), VoxelLevel(batch_of(*scenes))), layer.weight, upstream)
    torch.testing.assert_close(alone, expected_gradients[1])


def test_down_convolution_equals_dense_strided_convolution():
    voxels = random_voxels(200, 0, 12)
    voxels = torch.unique(torch.cat([voxels, torch.tensor([[0, 0, 0], [11, 11, 11]])]), dim=0)
    layer, step = DownConv(3, 5).double(), Coarsening(VoxelLevel(batch_of(voxels)))
    features = torch.randn(len(voxels), 3, dtype=torch.float64, requires_grad=True)
    result = layer(features, step)
    weight = layer.weight.view(2, 2, 2, 3, 5).permute(4, 3, 0, 1, 2)
    x, y, z = step.coarse.coordinates[:, 1:].unbind(1)
    expected = nn.functional.conv3d(dense_grid(voxels, features)[0], weight, stride=2)[0, :, x, y, z].t()
    torch.testing.assert_close(result, expected)
    upstream = torch.randn_like(result)
    torch.testing.assert_close(
        torch.autograd.grad(result, (features, layer.weight), upstream),
        torch.autograd.grad(expected, (features, layer.weight), upstream),
    )


def test_up_convolution_equals_dense_transposed_convolution():
    voxels = torch.unique(torch.cat([random_voxels(200, 0, 12), torch.tensor([[0, 0, 0]])]), dim=0)
    layer, step = UpConv(3, 5).double(), Coarsening(VoxelLevel(batch_of(voxels)))
    features = torch.randn(len(step.coarse), 3, dtype=torch.float64, requires_grad=True)
    result = layer(features, step)
    weight = layer.weight.view(2, 2, 2, 3, 5).permute(3, 4, 0, 1, 2)
    x, y, z = voxels.unbind(1)
    volume, _ = dense_grid(step.coarse.coordinates[:, 1:], features)
    expected = nn.functional.conv_transpose3d(volume, weight, stride=2)[0, :, x, y, z].t()
    torch.testing.assert_close(result, expected)
    upstream = torch.randn_like(result)
    torch.testing.assert_close(
        torch.autograd.grad(result, (features, layer.weight), upstream),
        torch.autograd.grad(expected, (features, layer.weight), upstream),
    )


def test_coarsening_rounds_negative_coordinates_down():
    voxels = torch.tensor([[0, -1, 0, 0], [0, 0, 0, 0], [0, -2, 0, 1], [1, -1, 0, 0]])
    step = Coarsening(VoxelLevel(voxels))
    parents = step.coarse.coordinates[step.parents]
    assert parents.tolist() == [[0, -1, 0, 0], [0, 0, 0, 0], [0, -1, 0, 0], [1, -1, 0, 0]]
    assert len(step.coarse) == 3


def test_scenes_of_a_batch_are_not_neighbours():
    voxels = torch.tensor([[0, 5, 5, 5], [1, 5, 5, 6], [1, 5, 5, 5]])
    neighbours = VoxelLevel(voxels).neighbours(3)
    missing = len(voxels)
    assert (neighbours[0] != missing).sum() == 1
    assert (neighbours[1] != missing).sum() == 2


def test_voxels_kilometres_apart_are_found():
    voxels = torch.tensor([[0, 0, 0, 0], [0, 0, 0, 1], [0, 300_000, -300_000, 300_000]])
    neighbours = CoordinateIndex(voxels, 1).neighbours(torch.tensor([[0, 0, 1], [0, 0, 0]]))
    assert neighbours.tolist() == [[1, 0], [3, 1], [3, 2]]


def test_coordinates_too_far_apart_to_index_are_an_input_error():
    voxels = torch.tensor([[0, 0, 0, 0], [0, 2**31, 2**31, 2**31]])
    with pytest.raises(InputError, match="too far apart"):
        CoordinateIndex(voxels, 1)


def test_reduced_precision_stays_close():
    voxels = batch_of(random_voxels(300, 0, 10))
    layer, features = SubmanifoldConv(8, 8), torch.randn(len(voxels), 8)
    level = VoxelLevel(voxels)
    exact = layer(features, level)
    with torch.autocast("cpu", torch.bfloat16):
        reduced = layer(features, level)
    assert reduced.dtype == torch.bfloat16
    assert (reduced.float() - exact).abs().max() < 0.05 * exact.abs().max()
