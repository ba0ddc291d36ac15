from itertools import permutations

import torch

from icgnet.training.config import PUBLISHED_COSTS, MatchingCosts
from icgnet.training.losses import bce, dice_losses
from icgnet.training.matching import dice_cost, mask_cost, match_queries


def random_problem(voxels=40, queries=5, instances=3):
    generator = torch.Generator().manual_seed(0)
    mask_logits = torch.randn(voxels, queries, generator=generator)
    class_logits = torch.randn(queries, 8, generator=generator)
    owner = torch.randint(-1, instances, (voxels,), generator=generator)
    masks = owner[None] == torch.arange(instances)[:, None]
    return mask_logits, class_logits, masks, torch.tensor([0, 3, 6])


def test_costs_are_the_losses_of_every_pair():
    mask_logits, _, masks, _ = random_problem()
    for i, mask in enumerate(masks):
        for q in range(mask_logits.shape[1]):
            torch.testing.assert_close(mask_cost(mask_logits, masks)[i, q], bce(mask_logits[:, q], mask))
            expected = dice_losses(mask_logits[None, :, q], mask[None].float())[0]
            torch.testing.assert_close(dice_cost(mask_logits, masks)[i, q], expected)


def test_assignment_is_the_cheapest_of_all():
    mask_logits, class_logits, masks, classes = random_problem()
    costs = PUBLISHED_COSTS
    cost = 5 * mask_cost(mask_logits, masks) + 2 * dice_cost(mask_logits, masks)
    cost = cost - 10 * class_logits.softmax(-1)[:, classes].T
    cheapest = min(permutations(range(5), 3), key=lambda queries: sum(cost[i, q] for i, q in enumerate(queries)))
    assert match_queries(mask_logits, class_logits, masks, classes, costs).tolist() == list(cheapest)


def test_perfect_masks_find_their_objects():
    _, class_logits, masks, classes = random_problem()
    mask_logits = torch.full((40, 5), -8.0)
    mask_logits[:, [4, 0, 2]] = torch.where(masks.T, 8.0, -8.0)
    assert match_queries(mask_logits, class_logits * 0, masks, classes, MatchingCosts()).tolist() == [4, 0, 2]


def test_scene_without_instances_matches_nothing():
    mask_logits, class_logits, masks, classes = random_problem()
    assert len(match_queries(mask_logits, class_logits, masks[:0], classes[:0], MatchingCosts())) == 0


def test_a_network_that_computes_nan_gets_some_assignment():
    mask_logits, class_logits, masks, classes = random_problem()
    queries = match_queries(mask_logits * torch.nan, class_logits, masks, classes, MatchingCosts())
    assert len(set(queries.tolist())) == len(masks)


def test_with_fewer_queries_than_instances_each_gets_one_and_all_queries_serve():
    masks, classes = torch.arange(40) // 8 == torch.arange(5)[:, None], torch.tensor([0, 3, 6, 1, 2])
    # Query 0 covers the first three instances together, query 1 the other two.
    covered = torch.stack([masks[:3].any(0), masks[3:].any(0)], 1)
    mask_logits = torch.where(covered, 8.0, -8.0)
    matched = match_queries(mask_logits, torch.zeros(2, 8), masks, classes, MatchingCosts())
    assert matched.tolist() == [0, 0, 0, 1, 1]
    one = match_queries(mask_logits[:, :1], torch.zeros(1, 8), masks, classes, MatchingCosts())
    assert one.tolist() == [0] * 5


def test_instance_gets_a_query_that_was_seeded_on_it():
    mask_logits, class_logits, masks, classes = random_problem()
    free = match_queries(mask_logits, class_logits, masks, classes, MatchingCosts())
    others = [query for query in range(5) if query not in free.tolist()]
    seeds = torch.full((5,), -1)
    seeds[others[0]], seeds[others[1]] = 0, 1
    bound = match_queries(mask_logits, class_logits, masks, classes, MatchingCosts(), seeds)
    assert bound[:2].tolist() == others
