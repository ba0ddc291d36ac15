from dataclasses import replace

import pytest
import torch

from icgnet.geometry.cells import WORKSPACE_CELLS, CellGrid
from icgnet.network.config import NETWORKS
from icgnet.network.dense_map import DenseMap
from icgnet.network.dense_unet import CoarseVolume, DenseUNet, GridConv, _double, _parts, active_cells


def network() -> DenseUNet:
    torch.manual_seed(0)
    return DenseUNet(NETWORKS["tiny"]).eval()


def test_maps_cover_the_workspace_at_every_stride():
    (maps,) = network()(torch.rand(1, NETWORKS["tiny"].dense_channels, 30, 30, 30), [WORKSPACE_CELLS])
    assert [round(m.pitch, 6) for m in maps] == [0.04, 0.04, 0.02, 0.01]
    assert [m.features.shape[0] for m in maps] == [8, 8, 15, 30]
    assert all(m.pitch * m.features.shape[0] >= 0.3 - 1e-9 for m in maps)


def test_doubling_keeps_cells_where_they_are():
    coarse = torch.arange(8.0).view(1, 1, 8, 1, 1)
    doubled = _double(coarse, torch.zeros(1, 1, 15, 1, 1))
    assert doubled.flatten().tolist() == [i // 2 for i in range(15)]


def test_maps_move_with_the_input_in_steps_of_the_coarsest_cell():
    net = network()
    grid = torch.zeros(1, NETWORKS["tiny"].dense_channels, 48, 48, 48)
    grid[0, 0, 22:26, 23:25, 20:27] = 1.0
    where = [CellGrid((0, 0, 0), (48, 48, 48))]
    near = net(grid, where)[0][-1].features[18:30, 18:30, 18:30]
    far = net(grid.roll(8, 2), where)[0][-1].features[26:38, 18:30, 18:30]
    assert near.abs().max() > 1e-2
    torch.testing.assert_close(near, far, rtol=1e-4, atol=1e-5)


def test_cells_are_active_in_blocks_of_four_around_those_with_points():
    occupied = torch.zeros(1, 1, 24, 16, 30)
    occupied[0, 0, 9, 2, 29] = 1.0
    fine, coarse, coarser = active_cells(occupied, 3)
    wanted = torch.zeros(24, 16, 30)
    # The block of the point is [8, 12) x [0, 4) x [28, 30): with those around, and no farther than the grid.
    wanted[4:16, :8, 24:] = 1.0
    assert torch.equal(fine[0, 0], wanted)
    assert coarse.shape[2:] == (12, 8, 15)
    assert coarser.shape[2:] == (6, 4, 8)
    assert torch.equal(coarse[0, 0], wanted[::2, ::2, ::2])
    assert torch.equal(coarser[0, 0], wanted[::4, ::4, ::4])
    assert not active_cells(torch.zeros(1, 1, 8, 8, 8), 1)[0].any()


def blob(shape: tuple[int, int, int]) -> torch.Tensor:
    """A grid whose points are in the middle; the other channels are everywhere, as visibility is."""
    grid = torch.rand(1, NETWORKS["tiny"].dense_channels, *shape, generator=torch.Generator().manual_seed(0))
    grid[:, 0] = 0.0
    grid[0, 0, 2:6, 10:12, 1:7] = 1.0
    return grid


@torch.no_grad()
@pytest.mark.parametrize("any_extent", [True, False])
def test_how_large_a_grid_is_makes_no_difference_unless_the_network_is_of_fixed_extent(any_extent):
    torch.manual_seed(0)
    net = DenseUNet(replace(NETWORKS["tiny"], any_extent=any_extent)).eval()
    for norm in (each for each in net.modules() if isinstance(each, torch.nn.BatchNorm3d)):
        torch.nn.init.normal_(norm.bias)
    small, large = CellGrid((0, 0, 0), (16, 24, 16)), CellGrid((0, 0, 0), (40, 32, 24))
    grid = blob(small.shape)
    padded = torch.nn.functional.pad(grid, (0, 8, 0, 8, 0, 24))
    (alone,), (within,) = net(grid, [small]), net(padded, [large])
    equal = []
    for one, other in zip(alone, within, strict=True):
        x, y, z, _ = one.features.shape
        equal.append(torch.allclose(one.features, other.features[:x, :y, :z], rtol=1e-4, atol=1e-5))
        if any_extent:
            assert one.features.abs().max() > 1e-2
            assert not other.features[x:].any()
    assert equal == [any_extent] * 4


@torch.no_grad()
def test_what_stands_far_away_makes_no_difference():
    net = network()
    grid = torch.zeros(1, NETWORKS["tiny"].dense_channels, 80, 16, 16)
    grid[:, :, :16] = blob((16, 16, 16))
    where = [CellGrid((0, 0, 0), (80, 16, 16))]
    both = grid.clone()
    both[0, 0, 70:74, 3:9, 2:8] = 1.0
    for one, other in zip(net(grid, where)[0], net(both, where)[0], strict=True):
        own = round(0.16 / one.pitch)
        torch.testing.assert_close(one.features[:own], other.features[:own], rtol=1e-4, atol=1e-5)
        assert not torch.equal(one.features[own:], other.features[own:])


def test_maps_lie_where_their_grid_does():
    grid = CellGrid((24, -48, 0), (8, 16, 8))
    (maps,) = network()(torch.rand(1, NETWORKS["tiny"].dense_channels, 8, 16, 8), [grid])
    assert all(each.origin == grid.origin == pytest.approx((0.24, -0.48, 0.0)) for each in maps)


def test_convolution_without_gradients_gives_the_same():
    layer, grid = GridConv(4, 8), torch.randn(1, 4, 15, 15, 15)
    with torch.no_grad():
        fast = layer(grid)
    torch.testing.assert_close(fast, layer(grid), rtol=1e-4, atol=1e-5)


def test_the_finest_map_has_the_coarser_ones_beside_it_where_they_belong():
    torch.manual_seed(0)
    merge = CoarseVolume((6, 3, 2, 4), 5)
    deepest = DenseMap(torch.randn(2, 2, 2, 6), 0.04)
    maps = (deepest, DenseMap(torch.randn(2, 2, 2, 3), 0.04), DenseMap(torch.randn(3, 3, 3, 2), 0.02))
    finest = DenseMap(torch.randn(5, 5, 5, 4), 0.01)
    *coarser, joined = merge((*maps, finest))
    assert tuple(coarser) == maps
    assert torch.equal(joined.features[..., :4], finest.features)
    points = torch.rand(30, 3) * 0.05
    wanted = sum(project(level.nearest(points)) for project, level in zip(merge.project, maps, strict=True))
    torch.testing.assert_close(joined.nearest(points)[:, 4:], wanted)


@torch.no_grad()
def test_parts_of_a_scene_on_their_own_are_what_the_whole_scene_is_at_once():
    net = network()
    for norm in (each for each in net.modules() if isinstance(each, torch.nn.BatchNorm3d)):
        torch.nn.init.normal_(norm.bias)
    grid = torch.rand(2, NETWORKS["tiny"].dense_channels, 80, 64, 16, generator=torch.Generator().manual_seed(0))
    grid[:, 0] = 0.0
    # Boxes of the two parts of the first scene overlap: one lies in the corner that the other goes around.
    grid[0, 0, 2:70, 2, 6] = grid[0, 0, 70, 2:60, 6] = 1.0
    grid[0, 0, 20:24, 40:44, 3:9] = 1.0
    grid[1, 0, 30:34, 30:33, 2:5] = 1.0
    assert len(_parts(active_cells(grid[:, :1], 4)[-1])) == 3
    for apart, whole in zip(net._maps_apart(grid), net._maps(grid), strict=True):
        torch.testing.assert_close(apart, whole, rtol=1e-4, atol=1e-5)
        assert whole.abs().max() > 1e-2


@torch.no_grad()
def test_a_grid_without_points_has_maps_of_nothing():
    (maps,) = network()(
        torch.zeros(1, NETWORKS["tiny"].dense_channels, 16, 16, 16), [CellGrid((0, 0, 0), (16, 16, 16))]
    )
    assert [each.features.shape[0] for each in maps] == [4, 4, 8, 16]
    assert not any(each.features.any() for each in maps)
