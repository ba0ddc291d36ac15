"""What the network is punished for: segmentation, shape and grasps, per scene.

Paper: "Loss Formulation". Differs in preset `default`: a contact's grasps are decoded with the query of its own
instance only, each term is a mean, and the weights balance the gradients for short training (docs/guides/training.md);
`PUBLISHED` has the released weights and the scene-level terms.
"""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn
from torch.nn import functional

from icgnet.network.embedding import SceneEmbedding
from icgnet.network.icgnet import IcgNet
from icgnet.network.tokens import mean_by_row
from icgnet.training.config import LossWeights, MatchingCosts
from icgnet.training.matching import match_queries
from icgnet.training.sample import NOTHING, Sample

WIDTH_SCALE = 40.0
"""Widths are compared in units of 25 mm, so that their squares are comparable with the other terms."""

VOTE_UNIT, NEARER_UNIT = 0.05, 0.01
"""Units of how far a vote is from the middle of its object, and of how much nearer than to another's [m]."""

TERMS = ("class_", "mask", "dice", "vote", "occupancy", "grasp", "contact", "width", "scene_occupancy", "scene_grasp")
"""Names of the terms; not every scene has all of them."""


class TrainingLoss(nn.Module):
    """The network together with its loss, so that one forward call serves any number of devices."""

    def __init__(self, network: IcgNet, weights: LossWeights, costs: MatchingCosts, bfloat16: bool = False) -> None:
        """`bfloat16` computes the U-Nets in 16 bits."""
        super().__init__()
        self.network, self.weights, self.costs, self.in_16_bits = network, weights, costs, bfloat16

    def forward(self, samples: list[Sample]) -> tuple[Tensor, list[dict[str, Tensor]]]:
        """The loss to minimise, which is the mean over the scenes, and of each scene its loss and unweighted terms."""
        embeddings = self.encode(samples)
        scenes = [self.scene_terms(embedding, sample) for embedding, sample in zip(embeddings, samples, strict=True)]
        losses = torch.stack([weighted_sum(terms, self.weights) for terms in scenes])
        reports = [{"loss": loss, **terms} for loss, terms in zip(losses, scenes, strict=True)]
        return losses.mean(), [{name: value.detach() for name, value in report.items()} for report in reports]

    def encode(self, samples: list[Sample]) -> list[SceneEmbedding]:
        """The embeddings of the scenes."""
        device = samples[0].classes.device
        with torch.autocast(device.type, torch.bfloat16, enabled=self.in_16_bits):
            return self.network.encode([sample.input for sample in samples])

    def scene_terms(self, embedding: SceneEmbedding, sample: Sample) -> dict[str, Tensor]:
        """Every term of one scene, averaged over the stages that have it."""
        final, masks = embedding.stages[-1], sample.masks
        seeds = seed_instances(embedding, sample) if self.weights.seeded else None
        queries = match_queries(final.mask_logits, final.class_logits, masks, sample.classes, self.costs, seeds)
        targets = torch.full_like(final.class_logits[:, 0], NOTHING, dtype=torch.int64) if seeds is None else seeds
        if seeds is None:
            targets[queries] = torch.arange(len(queries), device=targets.device)
        stages = [
            segmentation_terms(stage.mask_logits, stage.class_logits, targets, masks, sample.classes, self.weights)
            for stage in embedding.stages
        ]
        if embedding.votes is not None and self.weights.vote > 0:
            stages.append(vote_term(embedding.votes, embedding.positions, sample.voxel_instances, len(masks)))
        for stage in self.network.config.decoded_stages:
            stages.append(self.occupancy_terms(embedding, sample, queries, stage))
            stages.append(self.grasp_terms(embedding, sample, queries, stage))
        names = {name for terms in stages for name in terms}
        return {name: _mean([terms[name] for terms in stages if name in terms]) for name in sorted(names)}

    def occupancy_terms(
        self, embedding: SceneEmbedding, sample: Sample, queries: Int[Tensor, "i"], stage: int
    ) -> dict[str, Tensor]:
        """The terms of the shapes of one scene at one stage; none without instances or points."""
        if len(queries) == 0 or len(sample.occupancy_points) == 0:
            return {}
        if not self.weights.every_instance:
            asked = sample.occupancy_asked
            logits = self.network.decode_occupancy_pairs(embedding, queries, sample.occupancy_points, asked, stage)
            return {"occupancy": bce(logits, sample.occupancy.t().gather(1, asked))}
        logits = self.network.decode_occupancy(embedding, queries, sample.occupancy_points, stage)
        terms = {"occupancy": bce(logits, sample.occupancy)}
        if self.weights.divide_by_terms:
            # The published term is a sum over the instances.
            terms["occupancy"] = terms["occupancy"] * len(queries)
        if self.weights.scene_occupancy:
            terms["scene_occupancy"] = bce(logits.amax(0), sample.occupancy.any(0))
        return terms

    def grasp_terms(
        self, embedding: SceneEmbedding, sample: Sample, queries: Int[Tensor, "i"], stage: int
    ) -> dict[str, Tensor]:
        """The terms of the grasps of one scene at one stage; none without instances or contacts."""
        if len(queries) == 0 or len(sample.contacts) == 0:
            return {}
        if self.weights.every_instance:
            return self._every_instance_terms(embedding, sample, queries, stage)
        own = queries[sample.contact_instances]
        answer = self.network.decode_affordance(embedding, own, sample.contacts, sample.normals, sample.hand, stage)
        graspable = sample.labels.any(-1)
        return {
            "grasp": bce(answer.logits, sample.labels),
            "contact": bce(answer.contact_logits, graspable),
            **width_term(answer.widths, sample.widths, graspable),
        }

    def _every_instance_terms(
        self, embedding: SceneEmbedding, sample: Sample, queries: Int[Tensor, "i"], stage: int
    ) -> dict[str, Tensor]:
        """Grasps of every instance at every contact; a contact of another instance is a failure there."""
        logits, widths = self._decode_pairs(embedding, sample, queries, stage)
        own = sample.contact_instances[None] == torch.arange(len(queries), device=queries.device)[:, None]
        labels = sample.labels[None] * own[..., None]
        graspable = labels.flatten(1).any(1)
        terms = {"scene_grasp": bce(logits.amax(0), sample.labels)}
        if graspable.any():
            terms["grasp"] = bce(logits[graspable], labels[graspable])
            terms |= width_term(widths, sample.widths.expand_as(widths), labels.any(-1))
        return terms

    def _decode_pairs(
        self, embedding: SceneEmbedding, sample: Sample, queries: Int[Tensor, "i"], stage: int
    ) -> tuple[Float[Tensor, "i g a"], Float[Tensor, "i g"]]:
        """Logits and widths [m] of every instance at every contact."""
        count = len(sample.contacts)
        answer = self.network.decode_affordance(
            embedding,
            queries.repeat_interleave(count),
            sample.contacts.repeat(len(queries), 1),
            sample.normals.repeat(len(queries), 1),
            sample.hand,
            stage,
        )
        pairs = (len(queries), count)
        return answer.logits.unflatten(0, pairs), answer.widths.unflatten(0, pairs)


def seed_instances(embedding: SceneEmbedding, sample: Sample) -> Int[Tensor, "q"]:
    """The instance on which each query was seeded, -1 for none."""
    voxel = torch.cdist(embedding.query_positions, sample.input.positions).argmin(1)
    return sample.voxel_instances[voxel]


def segmentation_terms(
    mask_logits: Float[Tensor, "v q"],
    class_logits: Float[Tensor, "q k"],
    targets: Int[Tensor, "q"],
    masks: Bool[Tensor, "i v"],
    classes: Int[Tensor, "i"],
    weights: LossWeights,
) -> dict[str, Tensor]:
    """Class, mask and dice terms of one stage, in which every instance counts the same.

    Args:
        mask_logits: per voxel and query.
        class_logits: per query, no-object last.
        targets: the instance that each query shall stand for; -1 for none, then it shall say "no object".
        masks: which voxels belong to which instance.
        classes: class of every instance.
        weights: for the weight of "no object".
    """
    none = class_logits.shape[1] - 1
    used = torch.nonzero(targets >= 0)[:, 0]
    wanted_class = torch.full_like(targets, none)
    wanted_class[used] = classes[targets[used]]
    shares = torch.bincount(targets[used], minlength=len(classes)).float().reciprocal()[targets[used]]
    importance = class_logits.new_full((len(targets),), weights.no_object)
    importance[used] = shares if weights.seeded else 1.0
    surprise = functional.cross_entropy(class_logits.float(), wanted_class, reduction="none")
    terms = {"class_": (importance * surprise).sum() / importance.sum()}
    if len(used):
        logits, wanted = mask_logits[:, used].T.float(), masks[targets[used]].float()
        per_query = functional.binary_cross_entropy_with_logits(logits, wanted, reduction="none").mean(1)
        terms["mask"] = (shares * per_query).sum() / shares.sum()
        terms["dice"] = (shares * dice_losses(logits, wanted)).sum() / shares.sum()
    return terms


def vote_term(
    votes: Float[Tensor, "v 3"], positions: Float[Tensor, "v 3"], instances: Int[Tensor, "v"], count: int
) -> dict[str, Tensor]:
    """How wrong the votes for the middles of objects are, every object as much as the others; none without objects.

    The distance to the middle of what is seen of the own object, and the surprise that it is the nearest of all
    middles, as in UOIS-Net-3D (Xie et al. 2021).

    Args:
        votes: of every voxel [m].
        positions: of every voxel [m].
        instances: which each belongs to, below 0 for none.
        count: number of instances; each has voxels.
    """
    if count == 0:
        return {}
    on_object = torch.nonzero(instances >= 0)[:, 0]
    votes, own = votes[on_object].float(), instances[on_object]
    middles = mean_by_row(positions[on_object], own, count)
    error = functional.smooth_l1_loss(votes / VOTE_UNIT, middles[own] / VOTE_UNIT, reduction="none").sum(1)
    surprise = functional.cross_entropy(-torch.cdist(votes, middles) / NEARER_UNIT, own, reduction="none")
    return {"vote": mean_by_row((error + surprise)[:, None], own, count).mean()}


def bce(logits: Float[Tensor, "*n"], target: Tensor) -> Float[Tensor, ""]:
    """Mean binary cross-entropy."""
    return functional.binary_cross_entropy_with_logits(logits.float(), target.float())


def dice_losses(logits: Float[Tensor, "i v"], target: Float[Tensor, "i v"]) -> Float[Tensor, "i"]:
    """1 - dice of each mask, smoothed by 1."""
    probability = logits.sigmoid()
    overlap = 2.0 * (probability * target).sum(-1) + 1.0
    return 1.0 - overlap / (probability.sum(-1) + target.sum(-1) + 1.0)


def width_term(
    predicted: Float[Tensor, "*g"], wanted: Float[Tensor, "*g"], graspable: Bool[Tensor, "*g"]
) -> dict[str, Tensor]:
    """Squared error of the widths [m] over the contacts where any angle succeeded; no term without such contacts."""
    if not graspable.any():
        return {}
    error = WIDTH_SCALE * (predicted.float() - wanted)[graspable]
    return {"width": error.square().mean()}


def weighted_sum(terms: dict[str, Tensor], weights: LossWeights) -> Float[Tensor, ""]:
    """The terms times their factors; divided by their number where the weights say so."""
    total = torch.stack([getattr(weights, name) * value for name, value in terms.items()]).sum()
    return total / len(terms) if weights.divide_by_terms else total


def _mean(values: list[Tensor]) -> Tensor:
    return torch.stack(values).mean()
