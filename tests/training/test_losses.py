from dataclasses import replace

import numpy as np
import pytest
import torch

from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.training.config import PUBLISHED, LossWeights, MatchingCosts, Sampling
from icgnet.training.losses import (
    VOTE_UNIT,
    TrainingLoss,
    bce,
    dice_losses,
    segmentation_terms,
    vote_term,
    weighted_sum,
    width_term,
)

SAMPLING = replace(Sampling().for_validation(), occupancy_points=200, contacts=20)
PAPER_LIKE = replace(NETWORKS["tiny"], affordance="contact", decoder_stages="all")


def terms_of(make_dataset, config, weights):
    torch.manual_seed(0)
    loss = TrainingLoss(IcgNet(config), weights, MatchingCosts())
    samples = [make_dataset(SAMPLING, config)[visit] for visit in range(2)]
    total, scenes = loss(samples)
    return loss, total, scenes


def test_perfect_answers_cost_nothing():
    masks = torch.tensor([[1, 1, 0, 0], [0, 0, 1, 0]], dtype=torch.bool)
    mask_logits = torch.where(masks.T, 20.0, -20.0)
    class_logits = 20.0 * torch.nn.functional.one_hot(torch.tensor([2, 5]), 8).float()
    targets, classes = torch.tensor([0, 1]), torch.tensor([2, 5])
    terms = segmentation_terms(mask_logits, class_logits, targets, masks, classes, LossWeights())
    assert {name: round(float(value), 4) for name, value in terms.items()} == {"class_": 0, "mask": 0, "dice": 0}


def test_queries_without_an_object_shall_say_so():
    masks, classes = torch.ones(1, 4, dtype=torch.bool), torch.tensor([2])
    quiet = torch.zeros(3, 8)
    quiet[1:, 7] = 10.0
    costs = [
        segmentation_terms(torch.zeros(4, 3), logits, torch.tensor([0, -1, -1]), masks, classes, LossWeights())[
            "class_"
        ]
        for logits in (quiet, -quiet)
    ]
    assert costs[0] < costs[1]


def test_every_instance_counts_the_same_however_many_queries_it_has():
    masks = torch.tensor([[1, 1, 0, 0], [0, 0, 1, 1]], dtype=torch.bool)
    right, wrong = torch.where(masks[0], 9.0, -9.0), torch.where(masks[1], -9.0, 9.0)
    class_logits, classes = torch.zeros(4, 8), torch.tensor([0, 1])
    mask_logits = torch.stack([right, right, right, wrong], 1)
    terms = segmentation_terms(mask_logits, class_logits, torch.tensor([0, 0, 0, 1]), masks, classes, LossWeights())
    assert float(terms["mask"]) == pytest.approx(4.5, abs=1e-2)


def test_published_class_term_is_the_weighted_cross_entropy():
    class_logits = torch.randn(4, 8, generator=torch.Generator().manual_seed(0))
    masks, classes = torch.ones(2, 3, dtype=torch.bool), torch.tensor([2, 5])
    terms = segmentation_terms(torch.zeros(3, 4), class_logits, torch.tensor([-1, 1, -1, 0]), masks, classes, PUBLISHED)
    balance = torch.tensor([1.0] * 7 + [0.1])
    expected = torch.nn.functional.cross_entropy(class_logits, torch.tensor([7, 5, 7, 2]), balance)
    torch.testing.assert_close(terms["class_"], expected)


def test_dice_of_a_hand_worked_case():
    # Probabilities 1, 1, 0, 0 against 1, 0, 0, 0, both smoothed by 1: 1 - 3/4.
    loss = dice_losses(torch.tensor([[50.0, 50.0, -50.0, -50.0]]), torch.tensor([[1.0, 0.0, 0.0, 0.0]]))
    assert float(loss) == pytest.approx(0.25)


def test_width_counts_only_where_a_grasp_succeeds():
    predicted, wanted = torch.tensor([0.05, 0.00]), torch.tensor([0.025, 0.08])
    term = width_term(predicted, wanted, torch.tensor([True, False]))
    assert float(term["width"]) == pytest.approx(1.0)
    assert width_term(predicted, wanted, torch.tensor([False, False])) == {}


def test_sum_is_weighted_and_published_sum_is_divided():
    terms = {"mask": torch.tensor(2.0), "grasp": torch.tensor(1.0)}
    assert float(weighted_sum(terms, LossWeights(mask=3.0, grasp=5.0))) == pytest.approx(11.0)
    assert float(weighted_sum(terms, replace(PUBLISHED, mask=3.0, grasp=5.0))) == pytest.approx(5.5)


def test_every_parameter_that_is_used_gets_a_gradient(make_dataset):
    loss, total, scenes = terms_of(make_dataset, NETWORKS["tiny"], LossWeights())
    assert set(scenes[0]) == {"loss", "class_", "mask", "dice", "vote", "occupancy", "grasp", "contact", "width"}
    total.backward()
    without = [name for name, value in loss.network.named_parameters() if value.grad is None]
    assert without == []


def test_the_loss_is_the_mean_of_those_of_the_scenes(make_dataset):
    _, total, scenes = terms_of(make_dataset, NETWORKS["tiny"], LossWeights())
    assert len(scenes) == 2
    assert float(total.detach()) == pytest.approx(sum(float(scene["loss"]) for scene in scenes) / 2)


def test_published_loss_has_the_scene_level_terms_at_all_stages(make_dataset):
    _, total, scenes = terms_of(make_dataset, PAPER_LIKE, PUBLISHED)
    names = {"class_", "mask", "dice", "occupancy", "scene_occupancy", "grasp", "scene_grasp", "width"}
    assert set(scenes[0]) == {"loss", *names}
    assert torch.isfinite(total)


def test_scene_without_contacts_still_trains(make_dataset):
    config = NETWORKS["tiny"]
    loss = TrainingLoss(IcgNet(config), LossWeights(), MatchingCosts())
    total, (terms,) = loss([make_dataset(replace(SAMPLING, contacts=0), config)[0]])
    assert torch.isfinite(total)
    assert "grasp" not in terms


def test_votes_for_the_own_middle_cost_least_and_each_object_counts_the_same():
    positions = torch.tensor([[0.0, 0.0, 0.0], [0.04, 0.0, 0.0], [0.1, 0.0, 0.0], [0.5, 0.5, 0.5]])
    instances = torch.tensor([0, 0, 1, -1])
    middles = torch.tensor([[0.02, 0.0, 0.0], [0.02, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    best = vote_term(middles, positions, instances, 2)["vote"]
    assert float(best) == pytest.approx(0.0, abs=1e-3)
    halfway = middles.clone()
    halfway[2] -= torch.tensor([0.04, 0.0, 0.0])  # as near to the other one
    error, surprise = 0.5 * (0.04 / VOTE_UNIT) ** 2, np.log(2)
    assert float(vote_term(halfway, positions, instances, 2)["vote"]) == pytest.approx((error + surprise) / 2, rel=1e-3)
    assert vote_term(middles, positions, torch.full((4,), -1), 0) == {}


def test_bce_of_a_hand_worked_case():
    assert float(bce(torch.zeros(4), torch.tensor([1.0, 0.0, 1.0, 0.0]))) == pytest.approx(0.6931, abs=1e-4)
