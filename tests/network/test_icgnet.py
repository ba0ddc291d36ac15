from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from icgnet.errors import InputError
from icgnet.network.config import NETWORKS, NetworkConfig
from icgnet.network.hand_input import WIDTH_MARGIN, HandInput
from icgnet.network.icgnet import IcgNet
from icgnet.network.inputs import SceneInput, make_scene_input

CENTRES = np.array([[0.10, 0.10, 0.08], [0.20, 0.18, 0.08]])


def two_spheres(config: NetworkConfig, seed: int = 0, radius: float = 0.025) -> tuple[SceneInput, torch.Tensor]:
    """Two spheres on the table, and for each voxel which one it belongs to."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(2, 700, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    points = CENTRES[:, None] + radius * directions
    scene, _ = make_scene_input(points.reshape(-1, 3), config)
    nearest = np.linalg.norm(scene.positions.numpy()[:, None] - CENTRES, axis=2).argmin(1)
    return scene, torch.from_numpy(nearest)


def network(config: NetworkConfig = NETWORKS["tiny"]) -> IcgNet:
    torch.manual_seed(0)
    return IcgNet(config).eval()


def hand_of(net: IcgNet) -> HandInput:
    return net.hand_input(net.config.gripper)


def count(module: nn.Module) -> int:
    return sum(parameter.numel() for parameter in module.parameters())


def test_published_network_has_the_published_number_of_parameters():
    net = IcgNet(replace(NETWORKS["paper"], classes=("mug", "box", "can", "bottle", "cylindric", "ball", "other")))
    refinement = net.refinement
    # published counts per module; the two output layers that the published network builds and never uses are left
    # out here (1,056 of the sparse and 544 of the dense U-Net), and our class head has 7 classes instead of 6 (33)
    assert count(net.sparse) == 1_820_584 - 1_056
    assert count(net.dense) == 1_021_448 - 544
    assert [count(stage) for stage in refinement.stages] == [30_528, 30_528, 26_432, 25_408]
    assert count(refinement.mask_head) == 9_024
    assert count(refinement.class_head) == 2_343 + 33
    assert count(refinement.affordance) == 108_704
    assert refinement.content.numel() == 1_024
    assert count(net.pooling) == 5_440
    assert count(net.occupancy_features) == count(net.affordance_features) == 46_323
    assert count(net.occupancy) == 22_337
    assert count(net.affordance.quality) == 22_700
    assert count(net.affordance.width) == 22_337
    assert count(net) == 3_241_483 - 1_056 - 544 + 33 == 3_239_916
    assert abs(count(net) - 3.24e6) < 0.02 * 3.24e6


@pytest.mark.parametrize("name", ["tiny", "paper"])
def test_predictions_have_the_promised_shapes_at_every_decoded_stage(name):
    config = NETWORKS[name]
    net = network(config)
    scene, _ = two_spheres(config)
    (embedding,) = net.encode([scene])
    assert len(embedding.stages) == 5
    contacts, normals = scene.positions[:7], torch.tensor([[1.0, 0, 0]]).expand(7, 3)
    for stage in range(5):
        output = embedding.stages[stage]
        queries = len(embedding.query_positions)
        assert queries == config.queries or config.any_extent
        if stage in config.decoded_stages:
            assert output.mask_logits.shape == (len(scene.voxels), queries)
            assert output.class_logits.shape == (queries, len(config.classes) + 1)
            logits = net.decode_occupancy(embedding, torch.tensor([3, 1]), contacts, stage)
            owners = torch.zeros(7, dtype=torch.long)
            affordance = net.decode_affordance(embedding, owners, contacts, normals, hand_of(net), stage)
            assert logits.shape == (2, 7)
            assert affordance.logits.shape == (7, 12)
            assert affordance.widths.shape == affordance.contact_logits.shape == (7,)
        else:
            with pytest.raises(InputError, match="not decoded"):
                net.decode_occupancy(embedding, torch.tensor([0]), contacts, stage)


def test_width_is_positive_and_bounded():
    net = network()
    scene, _ = two_spheres(net.config)
    (embedding,) = net.encode([scene])
    normals = nn.functional.normalize(torch.randn(50, 3), dim=1)
    owners, contacts = torch.zeros(50).long(), scene.positions[:50]
    widths = net.decode_affordance(embedding, owners, contacts, normals, hand_of(net)).widths
    assert (widths > 0).all()
    assert (widths < net.config.gripper.max_opening + WIDTH_MARGIN).all()


@torch.no_grad()
def test_a_batch_of_two_scenes_gives_what_each_gives_alone():
    net = network()
    scenes = [two_spheres(net.config, seed)[0] for seed in (0, 1)]
    for scene, together in zip(scenes, net.encode(scenes), strict=True):
        (alone,) = net.encode([scene])
        torch.testing.assert_close(together.stages[-1].mask_logits, alone.stages[-1].mask_logits, rtol=1e-3, atol=1e-4)
        points = torch.rand(20, 3) * 0.3
        decoded = [net.decode_occupancy(e, torch.arange(3), points) for e in (together, alone)]
        torch.testing.assert_close(*decoded, rtol=1e-3, atol=1e-4)


@torch.no_grad()
def test_chosen_pairs_of_points_and_instances_get_what_all_pairs_get():
    net = network()
    (embedding,) = net.encode([two_spheres(net.config)[0]])
    points, queries = torch.rand(20, 3) * 0.3, torch.tensor([2, 0, 5])
    instances = torch.randint(0, 3, (20, 2))
    chosen = net.decode_occupancy_pairs(embedding, queries, points, instances)
    torch.testing.assert_close(chosen, net.decode_occupancy(embedding, queries, points).t().gather(1, instances))


@torch.no_grad()
def test_an_embedding_can_be_decoded_after_another_scene_was_encoded():
    net = network()
    first, second = (two_spheres(net.config, seed)[0] for seed in (0, 1))
    (embedding,) = net.encode([first])
    points = torch.rand(20, 3) * 0.3
    before = net.decode_occupancy(embedding, torch.arange(3), points)
    net.encode([second])
    assert torch.equal(net.decode_occupancy(embedding.to("cpu"), torch.arange(3), points), before)


@torch.no_grad()
def test_masks_do_not_depend_on_the_order_of_voxels():
    net = network()
    scene, _ = two_spheres(net.config)
    order = torch.randperm(len(scene.voxels))
    shuffled = SceneInput(scene.voxels[order], scene.positions[order], scene.dense)
    masks, shuffled_masks = (net.encode([s])[0].stages[-1].mask_logits for s in (scene, shuffled))
    torch.testing.assert_close(shuffled_masks, masks[order], rtol=1e-3, atol=1e-3)


def test_detached_embedding_has_no_history():
    net = network()
    (embedding,) = net.encode([two_spheres(net.config)[0]])
    assert embedding.stages[-1].queries.requires_grad
    detached = embedding.detach()
    assert not detached.stages[-1].queries.requires_grad
    assert not detached.dense_maps[0].features.requires_grad
    assert not detached.tokens[0].features.requires_grad


def test_occupancy_has_a_gradient_in_the_points():
    net = network()
    (embedding,) = net.encode([two_spheres(net.config)[0]])
    points = (torch.rand(10, 3) * 0.2 + 0.05).requires_grad_()
    net.decode_occupancy(embedding.detach(), torch.tensor([0]), points).sum().backward()
    assert points.grad is not None
    assert (points.grad.norm(dim=1) > 0).all()


def test_every_parameter_learns():
    for name in ("tiny", "paper"):
        config = NETWORKS[name]
        net = network(config).train()
        scene, _ = two_spheres(config)
        (embedding,) = net.encode([scene])
        loss = sum(stage.mask_logits.mean() + stage.class_logits.mean() for stage in embedding.stages)
        normals = nn.functional.normalize(torch.randn(30, 3), dim=1)
        for stage in config.decoded_stages:
            owners, contacts = torch.zeros(30).long(), scene.positions[:30]
            affordance = net.decode_affordance(embedding, owners, contacts, normals, hand_of(net), stage)
            loss = loss + affordance.logits.mean() + affordance.widths.mean() + affordance.contact_logits.mean()
            loss = loss + net.decode_occupancy(embedding, torch.arange(2), scene.positions, stage).mean()
        loss.backward()
        assert [key for key, parameter in net.named_parameters() if parameter.grad is None] == []


def test_inputs_of_another_configuration_are_input_errors():
    net = network()
    with pytest.raises(InputError, match="dense grid"):
        net.encode([two_spheres(NETWORKS["paper"])[0]])
    scene, _ = two_spheres(net.config)
    with pytest.raises(InputError, match="no voxels"):
        net.encode([SceneInput(scene.voxels[:0], scene.positions[:0], scene.dense)])


@pytest.mark.parametrize("voxels", [1, 3])
def test_a_scene_of_few_voxels_is_taken_in_training_too(voxels):
    net = network().train()
    scene, _ = make_scene_input(np.linspace([0.1] * 3, [0.11] * 3, voxels), net.config)
    (embedding,) = net.encode([scene])
    logits = net.decode_occupancy(embedding, torch.tensor([0]), torch.rand(5, 3))
    assert torch.isfinite(logits).all()


@torch.no_grad()
def test_voxels_far_outside_the_workspace_are_taken():
    net = network()
    points = np.random.default_rng(0).uniform([-1.0, 0, 0], [2.0, 3.0, 0.3], (300, 3))
    (embedding,) = net.encode([make_scene_input(points, net.config)[0]])
    assert torch.isfinite(embedding.stages[-1].mask_logits).all()


@pytest.mark.slow
def test_tiny_network_learns_one_scene():
    """Ten other seeds end below 0.25, 0.25, 0.7 and 0.4 of what they begin with: rounding cannot decide this one."""
    torch.manual_seed(0)
    config = replace(NETWORKS["tiny"], queries=4)
    net = IcgNet(config)
    scene, instances = two_spheres(config)
    masks = nn.functional.one_hot(instances, 2).float()
    points = torch.rand(400, 3) * torch.tensor([0.2, 0.2, 0.1]) + torch.tensor([0.05, 0.05, 0.04])
    distance = torch.cdist(points, torch.tensor(CENTRES, dtype=torch.float32))
    inside = (distance < 0.025).t().float()
    contacts, rows = scene.positions[::10], instances[::10]
    normals = nn.functional.normalize(contacts - torch.tensor(CENTRES, dtype=torch.float32)[rows], dim=1)
    labels = (normals[:, :1] > torch.linspace(-1, 1, 12)).float()
    widths = 0.02 + 0.05 * rows
    optimiser = torch.optim.AdamW(net.parameters(), lr=5e-3)
    losses = []
    for _ in range(16):
        (embedding,) = net.encode([scene])
        affordance = net.decode_affordance(embedding, rows, contacts, normals, hand_of(net))
        terms = torch.stack(
            [
                nn.functional.binary_cross_entropy_with_logits(embedding.stages[-1].mask_logits[:, :2], masks),
                nn.functional.binary_cross_entropy_with_logits(
                    net.decode_occupancy(embedding, torch.arange(2), points), inside
                ),
                nn.functional.binary_cross_entropy_with_logits(affordance.logits, labels),
                20.0 * (affordance.widths - widths).abs().mean(),
            ]
        )
        optimiser.zero_grad()
        terms.sum().backward()
        optimiser.step()
        losses.append(terms.detach())
    first, last = torch.stack(losses[:3]).mean(0), torch.stack(losses[-3:]).mean(0)
    assert (last < torch.tensor([0.4, 0.4, 0.8, 0.6]) * first).all(), (first, last)
