"""Which query stands for which object: a one-to-one assignment by segmentation cost.

Paper: "Loss Formulation" (Hungarian matching on the segmentation loss only).
"""

import torch
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment
from torch import Tensor
from torch.nn import functional

from icgnet.training.config import MatchingCosts

FOREIGN_COST = 1e4
"""What it costs to take a query that was seeded on another object: more than any segmentation."""


@torch.no_grad()
def match_queries(
    mask_logits: Float[Tensor, "v q"],
    class_logits: Float[Tensor, "q k"],
    masks: Bool[Tensor, "i v"],
    classes: Int[Tensor, "i"],
    costs: MatchingCosts,
    seeds: Int[Tensor, "q"] | None = None,
) -> Int[Tensor, "i"]:
    """The query of every instance; no query serves two unless there are too few.

    Args:
        mask_logits: per voxel and query.
        class_logits: per query, no-object last.
        masks: which voxels belong to which instance.
        classes: class index of every instance.
        costs: weights.
        seeds: the instance on which each query was seeded, -1 for none; an instance then gets one of its own queries
            where it has any.
    """
    if len(masks) == 0:
        return torch.zeros(0, dtype=torch.int64, device=mask_logits.device)
    cost = costs.mask * mask_cost(mask_logits, masks) + costs.dice * dice_cost(mask_logits, masks)
    cost -= costs.class_probability * class_logits.float().softmax(-1)[:, classes].T
    if seeds is not None:
        foreign = seeds[None] != torch.arange(len(masks), device=seeds.device)[:, None]
        cost += FOREIGN_COST * foreign
    count = cost.shape[1]
    cost = cost.repeat(1, -(-len(masks) // count))
    # A network that computes NaN gets any assignment; what follows from it is NaN, too, and the step is skipped.
    _, queries = linear_sum_assignment(cost.nan_to_num(FOREIGN_COST, FOREIGN_COST, -FOREIGN_COST).cpu().numpy())
    return torch.as_tensor(queries % count, dtype=torch.int64, device=mask_logits.device)


def mask_cost(mask_logits: Float[Tensor, "v q"], masks: Bool[Tensor, "i v"]) -> Float[Tensor, "i q"]:
    """Binary cross-entropy of every query's mask against every instance, averaged over voxels."""
    logits, target = mask_logits.float(), masks.float()
    # BCE(x, t) = softplus(x) - t x, so that all pairs cost one matrix product.
    return (functional.softplus(logits).sum(0) - target @ logits) / len(logits)


def dice_cost(mask_logits: Float[Tensor, "v q"], masks: Bool[Tensor, "i v"]) -> Float[Tensor, "i q"]:
    """1 - dice of every query's mask against every instance, smoothed by 1."""
    probability, target = mask_logits.float().sigmoid(), masks.float()
    total = probability.sum(0) + target.sum(1, keepdim=True)
    return 1.0 - (2.0 * (target @ probability) + 1.0) / (total + 1.0)
