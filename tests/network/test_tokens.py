import numpy as np
import torch

from icgnet.network.config import NETWORKS
from icgnet.network.dense_map import DenseMap
from icgnet.network.inputs import make_scene_input
from icgnet.network.sparse_unet import VoxelPyramid
from icgnet.network.tokens import aggregate, mean_by_row


def test_tokens_join_each_voxel_with_the_cell_around_it_per_scene():
    rng = np.random.default_rng(0)
    scenes = [make_scene_input(rng.uniform(0, 0.3, (count, 3)), NETWORKS["tiny"])[0] for count in (60, 90)]
    coordinates = torch.cat([torch.nn.functional.pad(s.voxels, (1, 0), value=b) for b, s in enumerate(scenes)])
    pyramid = VoxelPyramid.build(coordinates)
    sparse = tuple(torch.arange(len(level)).float()[:, None] for level in pyramid.levels[3::-1])
    maps = tuple(tuple(DenseMap(torch.rand(30, 30, 30, 2), 0.01) for _ in range(4)) for _ in scenes)
    tokens = aggregate(
        pyramid, torch.cat([s.positions for s in scenes]), sparse, maps, 0.003, [None, torch.tensor([0.1, 0.2, 0.9])]
    )

    for scene, levels, own_maps in zip(scenes, tokens, maps, strict=True):
        assert [round(level.pitch, 6) for level in levels] == [0.024, 0.012, 0.006, 0.003]
        assert torch.equal(levels[-1].positions, scene.positions)
        for level, dense_map in zip(levels, own_maps, strict=True):
            cells = (level.positions / 0.01).long()
            assert torch.equal(level.features[:, 1:], dense_map.features[cells[:, 0], cells[:, 1], cells[:, 2]])
            parents = torch.floor(scene.positions / level.pitch).long()
            own = torch.floor(level.positions[level.of_voxel] / level.pitch).long()
            assert torch.equal(parents, own)
    assert tokens[1][-1].features[0, 0] == len(scenes[0].voxels)
    assert (tokens[0][0].sight == 0).all()
    seen = tokens[1][0]
    distances = (seen.positions - torch.tensor([0.1, 0.2, 0.9])).norm(dim=1, keepdim=True)
    torch.testing.assert_close(torch.tensor([0.1, 0.2, 0.9]) + distances * seen.sight, seen.positions)


def test_mean_by_row():
    means = mean_by_row(torch.tensor([[1.0], [3.0], [5.0]]), torch.tensor([1, 1, 0]), 2)
    assert means.tolist() == [[5.0], [2.0]]
