import torch

from icgnet.network.config import NETWORKS
from icgnet.network.dense_map import DenseMap
from icgnet.network.dense_unet import CoarseVolume, DenseUNet, GridConv, _double


def network() -> DenseUNet:
    torch.manual_seed(0)
    return DenseUNet(NETWORKS["tiny"]).eval()


def test_maps_cover_the_workspace_at_every_stride():
    (maps,) = network()(torch.rand(1, NETWORKS["tiny"].dense_channels, 30, 30, 30))
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
    near = net(grid)[0][-1].features[18:30, 18:30, 18:30]
    far = net(grid.roll(8, 2))[0][-1].features[26:38, 18:30, 18:30]
    torch.testing.assert_close(near, far, rtol=1e-4, atol=1e-5)


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
