import pytest
import torch
from torch import nn

from icgnet.network.config import NETWORKS
from icgnet.network.sparse_unet import SparseUNet, VoxelPyramid


def shell(radius: float = 9.0, size: int = 24) -> torch.Tensor:
    """Voxels of a sphere's surface, with batch index 0."""
    axis = torch.arange(size)
    voxels = torch.cartesian_prod(axis, axis, axis)
    distance = (voxels - size / 2).float().norm(dim=1)
    return nn.functional.pad(voxels[(distance - radius).abs() < 0.6], (1, 0))


def given(voxels: torch.Tensor) -> torch.Tensor:
    """Input features that do not depend on where the voxels are."""
    features = torch.zeros(len(voxels), NETWORKS["tiny"].surface_channels)
    features[:, 0] = 1.0
    return features


def network() -> SparseUNet:
    torch.manual_seed(0)
    return SparseUNet(NETWORKS["tiny"]).eval()


def test_features_move_with_the_scene_in_steps_of_the_coarsest_voxel():
    net, voxels = network(), shell()
    moved = voxels + torch.tensor([0, 16, -32, 48])
    before, after = (net(VoxelPyramid.build(each), given(voxels)) for each in (voxels, moved))
    for features, moved_features in zip(before, after, strict=True):
        torch.testing.assert_close(features, moved_features, rtol=1e-4, atol=1e-5)


def test_features_do_not_depend_on_the_order_of_voxels():
    net, voxels = network(), shell()
    order = torch.randperm(len(voxels))
    features = torch.randn(len(voxels), NETWORKS["tiny"].surface_channels)
    finest = net(VoxelPyramid.build(voxels), features)[-1]
    shuffled = net(VoxelPyramid.build(voxels[order]), features[order])[-1]
    torch.testing.assert_close(shuffled, finest[order], rtol=1e-4, atol=1e-5)


def test_levels_come_coarse_to_fine():
    pyramid = VoxelPyramid.build(shell())
    features = network()(pyramid, given(shell()))
    assert [len(level) for level in features] == [len(level) for level in pyramid.levels[3::-1]]
    assert [level.shape[1] for level in features] == list(NETWORKS["tiny"].decoder_widths)


@pytest.mark.slow
def test_evaluation_stays_close_to_training_with_batches_of_one():
    net = network().train()
    optimiser = torch.optim.AdamW(net.parameters(), lr=1e-3)
    shells = [shell(radius) for radius in (6.0, 6.5, 7.0, 7.5)]
    scenes = [(VoxelPyramid.build(each), given(each)) for each in shells]
    losses = []
    for step in range(60):
        loss = (net(*scenes[step % 4])[-1] - 1.0).square().mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(float(loss.detach()))
    net.eval()
    with torch.no_grad():
        evaluated = sum(float((net(*scene)[-1] - 1.0).square().mean()) for scene in scenes) / 4
    assert losses[-1] < 0.7 * losses[0]
    assert evaluated < 1.4 * sum(losses[-4:]) / 4
