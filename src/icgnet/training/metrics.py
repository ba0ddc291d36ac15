"""How good a network is on held-out scenes: grasps, shapes, instances, classes.

All numbers are pooled over the scenes, except precision at the top, which is averaged over them.
"""

from dataclasses import dataclass, field, fields

import numpy as np
import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from icgnet.network.embedding import SceneEmbedding
from icgnet.network.icgnet import IcgNet
from icgnet.network.instances import select_instances
from icgnet.training.config import MatchingCosts
from icgnet.training.losses import seed_instances
from icgnet.training.matching import match_queries
from icgnet.training.reliability import reliability
from icgnet.training.sample import Sample

THRESHOLDS = np.linspace(0.05, 0.95, 19)
"""Scores at which the best F1 is looked for."""


@dataclass(eq=False)
class GraspTally:
    """What is counted while going through the scenes; the sum of two is that of the scenes of both."""

    scenes: int = 0
    scores: list[Float[np.ndarray, "n"]] = field(default_factory=list)
    labels: list[Bool[np.ndarray, "n"]] = field(default_factory=list)
    seen: list[Bool[np.ndarray, "n"]] = field(default_factory=list)
    top_1: list[float] = field(default_factory=list)
    top_1_possible: list[float] = field(default_factory=list)
    top_1_scores: list[float] = field(default_factory=list)
    top_50: list[float] = field(default_factory=list)
    width_errors: list[float] = field(default_factory=list)
    scene_overlap: list[tuple[int, int]] = field(default_factory=list)
    shape_ious: list[float] = field(default_factory=list)
    mask_ious: list[float] = field(default_factory=list)
    detections: list[tuple[float, float]] = field(default_factory=list)
    instances: int = 0
    classes_right: list[bool] = field(default_factory=list)

    def __add__(self, other: "GraspTally") -> "GraspTally":
        return GraspTally(**{each.name: getattr(self, each.name) + getattr(other, each.name) for each in fields(self)})


def evaluate(network: IcgNet, samples: list[Sample], costs: MatchingCosts | None = None) -> dict[str, float]:
    """The metrics of a network, see `count_scenes`; none without scenes."""
    return summarise(count_scenes(network, samples, costs))


@torch.no_grad()
def count_scenes(network: IcgNet, samples: list[Sample], costs: MatchingCosts | None = None) -> GraspTally:
    """Lets a network in evaluation mode predict the scenes, and counts.

    Args:
        network: it is left in the mode it was in.
        samples: scenes with their answers.
        costs: of the assignment between queries and instances.
    """
    was_training = network.training
    network.eval()
    tally = GraspTally()
    for sample in samples:
        count_scene(tally, network, sample, costs or MatchingCosts())
    network.train(was_training)
    return tally


def count_scene(tally: GraspTally, network: IcgNet, sample: Sample, costs: MatchingCosts) -> None:
    """Adds one scene to the tally."""
    tally.scenes += 1
    embedding = network.encode([sample.input])[0]
    final = embedding.stages[-1]
    queries = queries_of_instances(network, embedding, sample, costs)
    tally.instances += len(queries)
    tally.classes_right += (final.class_logits[queries, :-1].argmax(1) == sample.classes).tolist()
    found = select_instances(final)
    count_masks(tally, (found.masks, found.scores), sample.masks)
    if len(queries):
        count_shapes(tally, network, embedding, sample, queries)
        count_grasps(tally, network, embedding, sample, queries)


def queries_of_instances(
    network: IcgNet, embedding: SceneEmbedding, sample: Sample, costs: MatchingCosts
) -> Int[Tensor, "i"]:
    """The query that stands for each of the sample's instances after the last stage."""
    final = embedding.stages[-1]
    seeds = seed_instances(embedding, sample) if network.config.seeded_masks else None
    return match_queries(final.mask_logits, final.class_logits, sample.masks, sample.classes, costs, seeds)


def count_masks(
    tally: GraspTally, predicted: tuple[Bool[Tensor, "p v"], Float[Tensor, "p"]], masks: Bool[Tensor, "i v"]
) -> None:
    """Adds best IoU of every true mask, and score and IoU of every predicted mask (0 if its object is taken)."""
    iou = mask_iou(predicted[0], masks)
    tally.mask_ious += (iou.amax(0) if len(iou) else iou.new_zeros(len(masks))).tolist()
    taken: set[int] = set()
    for index in predicted[1].argsort(descending=True).tolist():
        best = int(iou[index].argmax()) if iou.shape[1] else -1
        free = best >= 0 and best not in taken
        overlap = float(iou[index, best]) if free else 0.0
        if overlap >= 0.5:
            taken.add(best)
        tally.detections.append((float(predicted[1][index]), overlap))


def mask_iou(first: Bool[Tensor, "p v"], second: Bool[Tensor, "i v"]) -> Float[Tensor, "p i"]:
    """Intersection over union of all pairs of masks."""
    a, b = first.float(), second.float()
    both = a @ b.T
    return both / (a.sum(1, keepdim=True) + b.sum(1) - both).clamp(min=1.0)


def count_shapes(
    tally: GraspTally, network: IcgNet, embedding: SceneEmbedding, sample: Sample, queries: Int[Tensor, "i"]
) -> None:
    """Adds the overlap of the predicted and true shapes at the sample's points, per instance and of the union."""
    if len(sample.occupancy_points) == 0:
        return
    inside = network.decode_occupancy(embedding, queries, sample.occupancy_points) > 0
    both, either = (inside & sample.occupancy).sum(1), (inside | sample.occupancy).sum(1)
    tally.shape_ious += (both[either > 0] / either[either > 0]).tolist()
    union, true_union = inside.any(0), sample.occupancy.any(0)
    tally.scene_overlap.append((int((union & true_union).sum()), int((union | true_union).sum())))


def count_grasps(
    tally: GraspTally, network: IcgNet, embedding: SceneEmbedding, sample: Sample, queries: Int[Tensor, "i"]
) -> None:
    """Adds the scores and labels of all contacts and angles, decoded with the contact's own instance."""
    if len(sample.contacts) == 0:
        return
    own = queries[sample.contact_instances]
    answer = network.decode_affordance(embedding, own, sample.contacts, sample.normals, sample.hand)
    scores, labels = answer.logits.sigmoid(), sample.labels > 0.5
    tally.scores.append(scores.flatten().float().cpu().numpy())
    tally.labels.append(labels.flatten().cpu().numpy())
    tally.seen.append(sample.contact_seen[:, None].expand_as(labels).flatten().cpu().numpy())
    count_ranking(tally, scores[sample.contact_seen].flatten(), labels[sample.contact_seen].flatten())
    graspable = labels.any(1)
    tally.width_errors += (answer.widths - sample.widths)[graspable].abs().tolist()


def count_ranking(tally: GraspTally, scores: Float[Tensor, "n"], labels: Bool[Tensor, "n"]) -> None:
    """Adds how well the best of a scene's grasps do, and whether any succeeds, which bounds the best's precision.

    Args:
        tally: without a change where the scene has no grasps.
        scores: of the grasps at seen contacts, probabilities.
        labels: whether each trial succeeded.
    """
    if len(scores) == 0:
        return
    ranked_scores, order = scores.sort(descending=True)
    ranked = labels[order]
    tally.top_1.append(float(ranked[0]))
    tally.top_1_possible.append(float(ranked.any()))
    tally.top_1_scores.append(float(ranked_scores[0]))
    tally.top_50.append(float(ranked[:50].float().mean()))


def summarise(tally: GraspTally) -> dict[str, float]:
    """The metrics of a tally; a metric that nothing was counted for is left out."""
    result: dict[str, float] = {}
    if tally.scores:
        scores, labels, seen = (np.concatenate(parts) for parts in (tally.scores, tally.labels, tally.seen))
        result["grasp_f1"] = f1_score(scores > 0.5, labels)
        result["grasp_best_f1"], result["grasp_best_threshold"] = best_f1(scores, labels)
        result["grasp_average_precision"] = ranking_precision(scores, labels)
        result["grasp_seen_best_f1"], _ = best_f1(scores[seen], labels[seen])
        result["grasp_ece"] = reliability(scores, labels).error
        result["grasp_positive_share"] = float(labels.mean())
    _add_mean(result, "grasp_top1_precision", tally.top_1)
    _add_mean(result, "grasp_top1_possible", tally.top_1_possible)
    _add_mean(result, "grasp_top1_score", tally.top_1_scores)
    _add_mean(result, "grasp_top50_precision", tally.top_50)
    if tally.width_errors:
        result["width_error_mm"] = 1000.0 * float(np.mean(tally.width_errors))
    if tally.scene_overlap:
        both, either = np.sum(tally.scene_overlap, axis=0)
        result["occupancy_scene_iou"] = float(both / max(either, 1))
    _add_mean(result, "occupancy_iou", tally.shape_ious)
    _add_mean(result, "instance_miou", tally.mask_ious)
    if tally.instances:
        result["instance_ap50"] = average_precision(tally.detections, tally.instances)
    _add_mean(result, "class_accuracy", tally.classes_right)
    return result


def _add_mean(result: dict[str, float], name: str, values: list[float] | list[bool]) -> None:
    if values:
        result[name] = float(np.mean(values))


def f1_score(predicted: Bool[np.ndarray, "n"], labels: Bool[np.ndarray, "n"]) -> float:
    """Harmonic mean of precision and recall; 0 when nothing is predicted and nothing is true."""
    return float(2.0 * (predicted & labels).sum() / max(predicted.sum() + labels.sum(), 1))


def best_f1(scores: Float[np.ndarray, "n"], labels: Bool[np.ndarray, "n"]) -> tuple[float, float]:
    """The highest F1 over `THRESHOLDS`, and the threshold that has it."""
    values = [f1_score(scores > threshold, labels) for threshold in THRESHOLDS]
    best = int(np.argmax(values))
    return values[best], float(THRESHOLDS[best])


def average_precision(detections: list[tuple[float, float]], instances: int, least_iou: float = 0.5) -> float:
    """Area under the precision-recall curve of (score, IoU) pairs, precision made monotone; class-agnostic.

    Args:
        detections: score and overlap of every predicted instance of all scenes.
        instances: number of true instances.
        least_iou: overlap at which a prediction counts as right.
    """
    if not detections:
        return 0.0
    right = np.array([overlap >= least_iou for _, overlap in sorted(detections, key=lambda pair: -pair[0])])
    return _area_under_precision(right, instances)


def ranking_precision(scores: Float[np.ndarray, "n"], labels: Bool[np.ndarray, "n"]) -> float:
    """Area under the precision-recall curve of grasps ranked by score; 0 when none succeeds."""
    return _area_under_precision(labels[np.argsort(-scores, kind="stable")], int(labels.sum()))


def _area_under_precision(right: Bool[np.ndarray, "n"], total: int) -> float:
    """Mean over the `total` true things of the best precision at their recall; those not found count 0."""
    precision = np.cumsum(right) / np.arange(1, len(right) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(envelope[right].sum() / max(total, 1))


def selection_score(metrics: dict[str, float]) -> float:
    """What the best weights are chosen by: best F1 and average precision of the grasps, equally.

    Paper: "Training Details" (F1 of the grasp affordances). Differs: the order of the grasps counts too, because the
    best one is executed.
    """
    return metrics.get("grasp_best_f1", 0.0) + metrics.get("grasp_average_precision", 0.0)
