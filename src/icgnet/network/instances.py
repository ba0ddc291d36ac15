"""From overlapping mask predictions to separate instances."""

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from icgnet.network.refinement import StageOutput

FEWEST_VOXELS = 10
LARGEST_IOU = 0.3
LARGEST_CONTAINMENT = 0.7


@dataclass(frozen=True, eq=False)
class Instances:
    """The objects that were found, best first."""

    queries: Int[Tensor, " p"]
    """The query that stands for each."""
    masks: Bool[Tensor, "p v"]
    """Its voxels; no voxel belongs to two."""
    scores: Float[Tensor, " p"]
    """Probability that it is an object at all, times the mean probability of its voxels."""


@torch.no_grad()
def select_instances(stage: StageOutput, least_objectness: float = 0.5) -> Instances:
    """The instances in a stage's predictions: of the masks that claim the same voxels, the surest one stays.

    Several queries start on every object, and each of them learns it, so the duplicates are taken out here.

    Paper: keeps every query whose best class is a real one. Differs: non-maximum suppression of the masks, as in
    detectors with many seeds per object.

    Args:
        stage: predictions of a scene, usually the last stage's.
        least_objectness: queries that are less sure than this of being any object are left out.
    """
    objectness = 1.0 - stage.class_logits.float().softmax(-1)[:, -1]
    likely = torch.nonzero(objectness >= least_objectness)[:, 0]
    logits = stage.mask_logits[:, likely].float()
    claimed = logits > 0
    sizes = claimed.sum(0)
    scores = objectness[likely] * (logits.sigmoid() * claimed).sum(0) / sizes.clamp(min=1)
    candidates = torch.nonzero(sizes >= FEWEST_VOXELS)[:, 0]
    candidates = candidates[scores[candidates].argsort(descending=True)]
    kept = candidates[_suppress(claimed[:, candidates])]
    winner = logits[:, kept].argmax(1) if len(kept) else sizes.new_zeros(len(claimed))
    own = winner[:, None] == torch.arange(len(kept), device=kept.device)
    masks = (own & claimed[:, kept]).t()
    filled = masks.sum(1) >= FEWEST_VOXELS
    return Instances(likely[kept[filled]], masks[filled], scores[kept[filled]])


def _suppress(masks: Bool[Tensor, "v m"]) -> list[int]:
    """Columns that stay, going from the first to the last: those that no earlier one that stays covers too much."""
    weights = masks.float()
    shared = weights.t() @ weights
    sizes = shared.diagonal()
    union = sizes[:, None] + sizes - shared
    smaller = torch.minimum(sizes[:, None], sizes)
    clash = ((shared > LARGEST_IOU * union) | (shared > LARGEST_CONTAINMENT * smaller)).tolist()
    kept: list[int] = []
    for column, row in enumerate(clash):
        if not any(row[other] for other in kept):
            kept.append(column)
    return kept
