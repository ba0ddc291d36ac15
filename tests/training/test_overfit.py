"""The first thing to look at when training does not learn: can it learn a few scenes by heart?"""

from dataclasses import replace

import pytest
import torch

from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.training.config import LossWeights, MatchingCosts, Sampling
from icgnet.training.losses import TrainingLoss
from icgnet.training.metrics import evaluate
from icgnet.training.schedule import learning_rate_factor

STEPS = 60
SCENES = 2


@pytest.mark.slow
def test_small_network_learns_its_scenes_by_heart(make_dataset):
    config = NETWORKS["tiny"]
    sampling = replace(Sampling().for_validation(), occupancy_points=200, contacts=60, half_resolution=1.0)
    samples = [make_dataset(sampling, config)[visit] for visit in range(SCENES)]
    torch.manual_seed(0)
    loss = TrainingLoss(IcgNet(config), LossWeights(), MatchingCosts())
    optimizer = torch.optim.AdamW(loss.parameters(), lr=1e-2)
    first = None
    for step in range(STEPS):
        optimizer.param_groups[0]["lr"] = 1e-2 * learning_rate_factor(step, step / STEPS, 10, 0.01)
        total, _ = loss(samples)
        first = first or float(total.detach())
        optimizer.zero_grad()
        total.backward()
        torch.nn.utils.clip_grad_norm_(loss.parameters(), 1.0)
        optimizer.step()
    metrics = evaluate(loss.network, samples)
    assert float(total.detach()) < 0.2 * first
    assert metrics["grasp_best_f1"] > 0.95
    assert metrics["instance_miou"] > 0.9
    assert metrics["class_accuracy"] > 0.9
