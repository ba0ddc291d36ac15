"""A network for scenes of any extent: it is the same wherever things stand, and whatever stands elsewhere."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import nn

from icgnet.geometry.cells import PITCH, grid_around
from icgnet.network.config import NETWORKS, NetworkConfig
from icgnet.network.embedding import SceneEmbedding
from icgnet.network.icgnet import IcgNet
from icgnet.network.inputs import SceneInput, make_scene_input
from icgnet.network.refinement import OUT_OF_REACH

ALL_HAVE_THEIR_SAY = 0.3
TOLERANCE = {"rtol": 1e-4, "atol": 1e-4}
OF_TWO = {"rtol": 1e-3, "atol": 1e-3}
"""Sums of squares about the middle of the scene (`local_moments`) lose digits when that is half a metre away."""
presets = pytest.mark.parametrize("name", ["tiny", "default"])


def network(config: NetworkConfig) -> IcgNet:
    """Random weights, also in the layers that begin with zeros, and statistics as if it had been trained."""
    torch.manual_seed(0)
    net = IcgNet(config).eval()
    with torch.no_grad():
        for parameter in net.parameters():
            if not parameter.any():
                width = parameter[0].numel() if parameter.ndim > 1 else len(parameter)
                parameter.normal_(0.0, ALL_HAVE_THEIR_SAY / width**0.5)
        for key, statistic in net.named_buffers():
            if key.endswith("running_mean"):
                statistic.normal_(0.0, 0.1)
    return net


def cloud(seed: int, balls: int = 3) -> np.ndarray:
    """Points of some balls on the table, within 0.3 m."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(balls, 300, 3))
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    radii = rng.uniform(0.015, 0.035, balls)
    centres = np.column_stack([rng.uniform(0.05, 0.25, (balls, 2)), 0.05 + radii])
    return (centres[:, None] + radii[:, None, None] * directions).reshape(-1, 3)


def scene_of(points: np.ndarray, config: NetworkConfig, viewpoint: np.ndarray | None = None) -> SceneInput:
    """Its input; what is seen to be free depends on the height alone, so that it is the same for each of two halves."""
    grid = grid_around(points)
    heights = np.clip((np.arange(grid.shape[2]) + 0.5) * PITCH / 0.05 - 2.0, -1.0, 1.0)
    visibility = np.broadcast_to(heights, grid.shape).astype(np.float32)
    return make_scene_input(points, config, visibility, viewpoint, grid)[0]


def everything(net: IcgNet, embedding: SceneEmbedding, queries: torch.Tensor, points: torch.Tensor) -> dict:
    """What the decoders say at the points for each of some queries."""
    normals = nn.functional.normalize(torch.randn(len(points), 3, generator=torch.Generator().manual_seed(1)), dim=1)
    hand = net.hand_input(net.config.gripper)
    owners = queries[torch.arange(len(points)) % len(queries)]
    grasps = net.decode_affordance(embedding, owners, points, normals, hand)
    occupancy = net.decode_occupancy(embedding, queries, points)
    return {"occupancy": occupancy, "grasps": grasps.logits, "widths": grasps.widths, "contact": grasps.contact_logits}


@torch.no_grad()
@presets
@pytest.mark.parametrize("step", [(0.24, 0.0), (-0.48, 0.48), (0.72, -0.96)])
def test_a_scene_that_moves_over_the_table_is_the_same(name, step):
    net = network(NETWORKS[name])
    points, shift = cloud(0), np.array([*step, 0.0])
    viewpoint = np.array([0.15, -0.3, 0.6])
    (here,) = net.encode([scene_of(points, net.config, viewpoint)])
    (there,) = net.encode([scene_of(points + shift, net.config, viewpoint + shift)])
    moved = torch.tensor(shift, dtype=torch.float32)
    torch.testing.assert_close(there.query_positions, here.query_positions + moved)
    for one, other in zip(here.stages, there.stages, strict=True):
        torch.testing.assert_close(other.queries, one.queries, **TOLERANCE)
    torch.testing.assert_close(there.stages[-1].mask_logits, here.stages[-1].mask_logits, **TOLERANCE)
    torch.testing.assert_close(there.stages[-1].class_logits, here.stages[-1].class_logits, **TOLERANCE)
    assert here.stages[-1].mask_logits.std() > 0.1
    assert here.stages[-1].class_logits.std(0).mean() > 1e-3
    asked = torch.from_numpy(points[::15].astype(np.float32))
    queries = torch.arange(0, len(here.query_positions), 3)
    first, second = everything(net, here, queries, asked), everything(net, there, queries, asked + moved)
    for key, value in first.items():
        torch.testing.assert_close(second[key], value, **TOLERANCE, msg=lambda text, key=key: f"{key}: {text}")
        assert value.std() > 1e-4, key


@torch.no_grad()
@presets
def test_two_scenes_side_by_side_are_what_each_is_alone(name):
    net = network(NETWORKS[name])
    first, second = cloud(0), cloud(1) + np.array([0.72, 0.0, 0.0])
    assert second[:, 0].min() - first[:, 0].max() > 0.4 > net.config.reach
    inputs = [scene_of(points, net.config) for points in (np.concatenate([first, second]), first, second)]
    both, *alone = (net.encode([each])[0] for each in inputs)
    assert len(both.query_positions) == sum(len(each.query_positions) for each in alone)
    for points, own in zip((first, second), alone, strict=True):
        rows = rows_of(own.voxels, both.voxels)
        queries = rows_of(own.query_positions, both.query_positions)
        others = torch.ones(len(both.voxels), dtype=torch.bool)
        others[rows] = False
        for one, whole in zip(own.stages, both.stages, strict=True):
            torch.testing.assert_close(whole.queries[queries], one.queries, **OF_TWO)
        masks = both.stages[-1].mask_logits[:, queries]
        torch.testing.assert_close(masks[rows], own.stages[-1].mask_logits, **OF_TWO)
        assert (masks[others] == OUT_OF_REACH).all()
        classes = both.stages[-1].class_logits[queries]
        torch.testing.assert_close(classes, own.stages[-1].class_logits, **OF_TWO)
        asked, some = torch.from_numpy(points[::15].astype(np.float32)), torch.arange(0, len(queries), 3)
        wanted, found = everything(net, own, some, asked), everything(net, both, queries[some], asked)
        for key, value in wanted.items():
            torch.testing.assert_close(found[key], value, **TOLERANCE, msg=lambda text, key=key: f"{key}: {text}")


def rows_of(wanted: torch.Tensor, rows: torch.Tensor) -> torch.Tensor:
    """Where each of some rows is among others."""
    same = (wanted[:, None] == rows[None]).all(2)
    assert (same.sum(1) == 1).all()
    return same.int().argmax(1)


@torch.no_grad()
def test_what_is_in_reach_does_matter():
    net = network(NETWORKS["tiny"])
    first, second = cloud(0), cloud(1) + np.array([0.24, 0.0, 0.0])
    (both,) = net.encode([scene_of(np.concatenate([first, second]), net.config)])
    (own,) = net.encode([scene_of(first, net.config)])
    rows = rows_of(own.voxels, both.voxels)
    queries = torch.cdist(own.query_positions, both.query_positions).argmin(1)
    difference = both.stages[-1].mask_logits[rows][:, queries] - own.stages[-1].mask_logits
    assert difference.abs().max() > 0.01


@torch.no_grad()
def test_a_batch_of_scenes_of_several_extents_is_what_each_is_alone():
    net = network(NETWORKS["tiny"])
    wide = np.concatenate([cloud(0), cloud(1) + np.array([0.48, -0.24, 0.1])])
    inputs = [scene_of(points, net.config) for points in (wide, cloud(2), cloud(3, balls=1))]
    assert len({each.grid.shape for each in inputs}) == 3
    for scene, together in zip(inputs, net.encode(inputs), strict=True):
        (alone,) = net.encode([scene])
        torch.testing.assert_close(together.stages[-1].mask_logits, alone.stages[-1].mask_logits, **TOLERANCE)
        torch.testing.assert_close(together.stages[-1].class_logits, alone.stages[-1].class_logits, **TOLERANCE)
        asked = alone.positions[::20]
        wanted, found = (everything(net, each, torch.arange(3), asked) for each in (alone, together))
        for key, value in wanted.items():
            torch.testing.assert_close(found[key], value, **TOLERANCE, msg=lambda text, key=key: f"{key}: {text}")


@torch.no_grad()
def test_a_published_network_takes_the_same_inputs_in_the_bounds_of_the_cloud():
    """It has a fixed number of queries, and one more object far away shifts what it sees of the first."""
    net = network(replace(NETWORKS["tiny"], any_extent=False, affordance="contact"))
    first, second = cloud(0), cloud(1) + np.array([0.72, 0.0, 0.0])
    (own,), (both,) = (
        net.encode([scene_of(points, net.config)]) for points in (first, np.concatenate([first, second]))
    )
    assert len(own.query_positions) == len(both.query_positions) == net.config.queries
    assert float(both.bounds.extent) > float(own.bounds.extent) + 0.5
    assert (both.stages[-1].mask_logits != OUT_OF_REACH).all()
    found = everything(net, both, torch.arange(4), both.positions[::20])
    assert all(torch.isfinite(value).all() for value in found.values())
