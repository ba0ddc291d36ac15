import numpy as np
import pytest
import torch

from icgnet.errors import InputError
from icgnet.network.config import NETWORKS
from icgnet.network.inputs import local_moments, make_scene_input, surface_features
from icgnet.network.sparse_conv import VoxelLevel


def test_every_point_lies_in_its_voxel_and_means_are_means():
    points = np.random.default_rng(0).uniform(-0.05, 0.35, (500, 3))
    scene, point_to_voxel = make_scene_input(points, NETWORKS["paper"])
    assert np.array_equal(scene.voxels.numpy()[point_to_voxel], np.floor(points / 0.003).astype(int))
    for row in (0, len(scene.voxels) - 1):
        expected = points[point_to_voxel == row].mean(0)
        np.testing.assert_allclose(scene.positions[row].numpy(), expected, atol=1e-6)
    assert len(np.unique(scene.voxels.numpy(), axis=0)) == len(scene.voxels)


def test_dense_grid_is_occupied_where_the_points_in_the_workspace_are():
    points = np.array([[0.005, 0.299, 0.101], [0.301, 0.1, 0.1], [-0.001, 0.1, 0.1]])
    scene, _ = make_scene_input(points, NETWORKS["paper"])
    assert scene.dense.shape == (1, 30, 30, 30)
    assert torch.nonzero(scene.dense[0]).tolist() == [[0, 29, 10]]


def test_visibility_is_flagged_as_known_or_left_zero():
    visibility = np.random.default_rng(0).uniform(-1, 1, (30, 30, 30)).astype(np.float32)
    points = np.full((1, 3), 0.15)
    known, _ = make_scene_input(points, NETWORKS["default"], visibility)
    assert torch.equal(known.dense[1], torch.from_numpy(visibility))
    assert (known.dense[2] == 1).all()
    unknown, _ = make_scene_input(points, NETWORKS["default"])
    assert (unknown.dense[1:3] == 0).all()
    ignored, _ = make_scene_input(points, NETWORKS["paper"], visibility)
    assert ignored.dense.shape[0] == 1


def test_the_dense_grid_says_where_in_their_cell_points_lie():
    points = np.array([[0.151, 0.155, 0.159], [0.153, 0.155, 0.159], [0.012, 0.0, 0.2999], [-0.01, 0.1, 0.1]])
    offsets = make_scene_input(points, NETWORKS["default"])[0].dense[3:]
    torch.testing.assert_close(offsets[:, 15, 15, 15], torch.tensor([-0.3, 0.0, 0.4]), rtol=0, atol=1e-5)
    torch.testing.assert_close(offsets[:, 1, 0, 29], torch.tensor([-0.3, -0.5, 0.49]), rtol=0, atol=1e-5)
    assert (offsets != 0).any(0).sum() == 2


def level_of(scene) -> VoxelLevel:
    return VoxelLevel(torch.nn.functional.pad(scene.voxels, (1, 0)))


def test_the_sparse_part_sees_offset_and_height_of_a_voxel_and_nothing_around_a_lonely_one():
    scene, _ = make_scene_input(np.array([[0.0315, 0.0325, 0.0702]]), NETWORKS["default"])
    features = surface_features(level_of(scene), scene.positions, NETWORKS["default"])
    torch.testing.assert_close(features[:, :5], torch.tensor([[1.0, 0.0, 1 / 3, -0.1, 0.202]]), rtol=0, atol=1e-3)
    assert features[:, 5:].abs().max() < 1e-6
    assert surface_features(level_of(scene), scene.positions, NETWORKS["paper"]).tolist() == [[1.0]]


def test_the_covariance_around_a_voxel_of_a_plane_is_that_of_its_normal():
    rng = np.random.default_rng(0)
    normal = np.array([0.48, 0.6, 0.64])
    points = np.array([0.15, 0.15, 0.15]) + rng.uniform(-0.05, 0.05, (200_000, 3))
    scene, _ = make_scene_input(points - ((points - 0.15) @ normal)[:, None] * normal, NETWORKS["default"])
    middle = (scene.positions - 0.15).norm(dim=1) < 0.02
    moments = local_moments(level_of(scene), scene.positions, 0.003)[middle]
    expected = (torch.eye(3) - torch.tensor(np.outer(normal, normal), dtype=torch.float32)) / 2
    rows, columns = torch.triu_indices(3, 3)
    # The neighbourhood is a cube, not a ball, so single voxels are a little off.
    torch.testing.assert_close(moments[:, 3:].mean(0), expected[rows, columns], rtol=0, atol=0.03)
    assert moments[:, :3].mean(0).abs().max() < 0.05


def test_what_is_around_a_voxel_does_not_depend_on_where_and_in_which_batch_it_lies():
    points = np.random.default_rng(0).uniform(0.1, 0.12, (300, 3))
    here, _ = make_scene_input(points, NETWORKS["default"])
    there, _ = make_scene_input(points + 0.15, NETWORKS["default"])
    alone = [local_moments(level_of(scene), scene.positions, 0.003) for scene in (here, there)]
    torch.testing.assert_close(*alone, rtol=0, atol=2e-3)
    voxels = [torch.nn.functional.pad(scene.voxels, (1, 0), value=b) for b, scene in enumerate((here, here))]
    together = local_moments(VoxelLevel(torch.cat(voxels)), here.positions.repeat(2, 1), 0.003)
    torch.testing.assert_close(together, alone[0].repeat(2, 1), rtol=0, atol=2e-3)


@pytest.mark.parametrize(("points", "message"), [(np.zeros((0, 3)), "n > 0"), (np.full((4, 3), np.nan), "NaN")])
def test_clouds_without_points_or_with_nan_are_input_errors(points, message):
    with pytest.raises(InputError, match=message):
        make_scene_input(points, NETWORKS["tiny"])


def test_visibility_of_another_size_is_an_input_error():
    with pytest.raises(InputError, match="visibility"):
        make_scene_input(np.full((1, 3), 0.15), NETWORKS["tiny"], np.zeros((20, 20, 20), np.float32))
