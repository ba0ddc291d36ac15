import torch
from torch import nn

from icgnet.network.dense_map import DenseMap


def random_map(size: int = 6, channels: int = 3, dtype=torch.float64) -> DenseMap:
    generator = torch.Generator().manual_seed(0)
    return DenseMap(torch.randn(size, size, size, channels, generator=generator, dtype=dtype), 0.01)


def test_feature_written_at_a_cell_is_read_at_its_centre():
    grid = torch.zeros(30, 30, 30, 1)
    grid[0, 0, 0], grid[29, 3, 17] = 1.0, 2.0
    dense_map = DenseMap(grid, 0.01)
    centres = torch.tensor([[0.005, 0.005, 0.005], [0.295, 0.035, 0.175], [0.285, 0.035, 0.175]])
    torch.testing.assert_close(dense_map.trilinear(centres)[:, 0], torch.tensor([1.0, 2.0, 0.0]), atol=1e-4, rtol=0)
    halfway = torch.tensor([[0.290, 0.035, 0.175]])
    torch.testing.assert_close(dense_map.trilinear(halfway), torch.tensor([[1.0]]), atol=1e-4, rtol=0)


def test_nearest_reads_the_cell_that_contains_the_point():
    dense_map = random_map()
    points = torch.tensor([[0.0001, 0.0199, 0.0301], [-0.02, 0.03, 0.9]], dtype=torch.float64)
    expected = torch.stack([dense_map.features[0, 1, 3], dense_map.features[0, 3, 5]])
    assert torch.equal(dense_map.nearest(points), expected)


def test_a_map_with_an_origin_reads_what_the_shifted_one_reads_without():
    features = random_map(6).features
    origin = (0.24, -0.48, 0.08)
    here, there = DenseMap(features, 0.01), DenseMap(features, 0.01, origin)
    # Some beyond the border, too.
    points = torch.rand(50, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 0.08 - 0.01
    moved = points + torch.tensor(origin, dtype=torch.float64)
    torch.testing.assert_close(there.trilinear(moved), here.trilinear(points))
    assert torch.equal(there.nearest(moved), here.nearest(points))
    assert (there.trilinear(points) - here.trilinear(points)).abs().max() > 0.1


def test_trilinear_and_its_gradients_equal_grid_sample():
    dense_map = random_map()
    points = (torch.rand(50, 3, dtype=torch.float64) * 0.1 - 0.02).requires_grad_()
    features = dense_map.features.requires_grad_()
    result = dense_map.trilinear(points)
    sampled = nn.functional.grid_sample(
        features.permute(3, 2, 1, 0)[None],
        (points / 0.03 - 1).view(1, -1, 1, 1, 3),
        padding_mode="border",
        align_corners=False,
    )[0, :, :, 0, 0].t()
    torch.testing.assert_close(result, sampled)
    upstream = torch.randn_like(result)
    torch.testing.assert_close(
        torch.autograd.grad(result, (features, points), upstream),
        torch.autograd.grad(sampled, (features, points), upstream),
    )
