"""How well the network tells objects apart and names them: mIoU, AP50, panoptic quality, classes.

Everything is counted on the points of the clouds. A point truly belongs to the nearest object; points that are near
none (noise) are left out, and so are objects that hardly any point was measured on.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from icgnet.benchmark.config import PictureConfig
from icgnet.benchmark.pictures import Picture, score_pictures
from icgnet.benchmark.statistics import Metric, Spread, mean, spreads, table
from icgnet.benchmark.tables import Table
from icgnet.benchmark.true_shapes import NO_OBJECT, NamedObject
from icgnet.inference.prediction import NO_INSTANCE, Prediction
from icgnet.objects.classes import CLASSES
from icgnet.predictor import Predictor
from icgnet.training.metrics import GraspTally, average_precision, count_masks

FEWEST_POINTS = 30
"""Objects with fewer points in the cloud are not asked for: about 1 cm² of surface."""
SAME = 0.5
"""A predicted and a true object are the same when their points overlap by more than this (IoU)."""
MISSED, INVENTED = "missed", "invented"


@dataclass(frozen=True, eq=False)
class Labelling:
    """The objects that a network found in a cloud.

    Attributes:
        labels: index of the object of every point, -1 for none.
        classes: class of each object.
        scores: how sure each object is.
    """

    labels: Int[np.ndarray, "n"]
    classes: tuple[str, ...]
    scores: Float[np.ndarray, "i"]


@dataclass(frozen=True)
class Pair:
    """A true object and the predicted one that is the same: their overlap (IoU), and the class that was told.

    A true object that was missed has no predicted class, and an object that was invented is no true one.
    """

    true: NamedObject | None
    predicted_class: str | None
    iou: float = 0.0

    @property
    def is_match(self) -> bool:
        """Whether there are both."""
        return self.true is not None and self.predicted_class is not None

    @property
    def right(self) -> bool:
        """Whether the predicted class is the true one."""
        return self.true is not None and self.predicted_class == self.true.class_name

    @property
    def defensible(self) -> bool:
        """Whether the predicted class is the true one, or the one that the object could have had as well."""
        return self.right or (self.true is not None and self.predicted_class == self.true.alternative)


@dataclass(frozen=True)
class SceneMasks:
    """The instances of one scene.

    Attributes:
        index: number of the scene.
        best_ious: the largest overlap of each true object with any predicted one.
        detections: score and overlap of each predicted object, 0 if its object is taken.
        pairs: every true and every predicted object once.
    """

    index: int
    best_ious: tuple[float, ...]
    detections: tuple[tuple[float, float], ...]
    pairs: tuple[Pair, ...]


@dataclass(frozen=True)
class SegmentationNumbers:
    """The instances of many scenes, counted together.

    Attributes:
        scores: each of `METRICS` [percent].
        by_object: number of times that each object was told to be of a class, or missed, by its key in the set.
        confusion: number of objects by true class, then by predicted one; "missed" and "invented" have no partner.
        scenes: with at least one object to find.
        objects: to find.
        predicted: objects.
        rows: what was measured on each scene.
    """

    scores: dict[str, Spread | None]
    by_object: dict[str, dict[str, int]]
    confusion: dict[str, dict[str, int]]
    scenes: int
    objects: int
    predicted: int
    rows: tuple[SceneMasks, ...]


def measure(config: PictureConfig) -> SegmentationNumbers:
    """The instances that a network finds in the pictures of a configuration.

    Raises:
        IcgnetError: unusable objects, weights or gripper, weights of other classes, or no scene with an object that can
            be seen.
    """
    predictor = Predictor.load(config.weights, config.threads, config.gripper)
    return summarise(score_pictures(config, predictor, score_picture))


def tables(numbers: SegmentationNumbers) -> list[Table]:
    """What is printed; of the confusion, rows are true classes and columns predicted ones, without empty ones."""
    told = tuple(next(iter(numbers.confusion.values())))
    columns = [name for name in told if name == MISSED or any(row[name] for row in numbers.confusion.values())]
    counts = [
        (name, *(str(row[column] or "") for column in columns))
        for name, row in numbers.confusion.items()
        if any(row.values())
    ]
    note = f"{numbers.objects} visible objects in {numbers.scenes} scenes; {numbers.predicted} predicted"
    return [
        table(("percent ± std over scenes", "all scenes [95 %]"), METRICS, numbers.scores),
        Table(("true \\ predicted", *columns), counts, title="classes: number of objects", notes=(note,)),
    ]


def label_overlaps(
    labels: Int[np.ndarray, "n"], predicted: int, owners: Int[np.ndarray, "n"], objects: int
) -> Float[np.ndarray, "p i"]:
    """IoU of the points of all pairs of predicted and true objects; points with a negative owner do not count."""
    known = owners >= 0
    both = np.zeros((predicted + 1, objects))
    np.add.at(both, (labels[known], owners[known]), 1)  # the last row takes the label -1
    sizes = both.sum(axis=0)
    both = both[:predicted]
    return both / np.maximum(both.sum(axis=1, keepdims=True) + sizes - both, 1)


def visible_objects(owners: Int[np.ndarray, "n"], objects: int) -> Bool[np.ndarray, "i"]:
    """Which true objects have enough points to be asked for."""
    return np.bincount(owners[owners >= 0], minlength=objects) >= FEWEST_POINTS


def score_picture(picture: Picture, prediction: Prediction | None) -> SceneMasks | None:
    """The instances of one picture; None without any visible object."""
    if prediction is None:
        return None
    owners = picture.truth.owners(prediction.cloud.points)
    if not visible_objects(owners, len(picture.truth)).any():
        return None
    objects = tuple(each.known_to(prediction.classes) for each in picture.truth.objects)
    return compare_masks(picture.index, labelling(prediction), owners, objects)


def labelling(prediction: Prediction) -> Labelling:
    """The objects that the network found, with its own scores."""
    return Labelling(
        prediction.cloud_instances,
        tuple(item.class_name for item in prediction.objects),
        np.array([item.score for item in prediction.objects]),
    )


def compare_masks(
    index: int, predicted: Labelling, owners: Int[np.ndarray, "n"], objects: tuple[NamedObject, ...]
) -> SceneMasks:
    """What a scene tells about the answer to it.

    Predicted objects that lie on points without a true object, or on those of objects that are not asked for, by more
    than a half are neither right nor wrong.

    Args:
        index: number of the scene.
        predicted: by the network.
        owners: index of the true object of every point, `NO_OBJECT` where none is near.
        objects: that stand there.
    """
    asked = np.flatnonzero(visible_objects(owners, len(objects)))
    owners = np.where(np.isin(owners, asked), owners, NO_OBJECT)
    found = np.flatnonzero(_mostly_known(predicted, owners))
    overlaps = label_overlaps(predicted.labels, len(predicted.classes), owners, len(objects))[found][:, asked]
    # More than half of both: no other pair can have one of the two.
    same = np.argwhere(overlaps > SAME)
    pairs = [Pair(objects[asked[i]], predicted.classes[found[p]], float(overlaps[p, i])) for p, i in same]
    pairs += [Pair(objects[i], None) for i in np.delete(asked, same[:, 1]).tolist()]
    pairs += [Pair(None, predicted.classes[p]) for p in np.delete(found, same[:, 0]).tolist()]
    tally = GraspTally()
    masks = torch.from_numpy((predicted.labels == found[:, None]) & (owners >= 0))
    count_masks(tally, (masks, torch.from_numpy(predicted.scores[found])), torch.from_numpy(owners == asked[:, None]))
    return SceneMasks(index, tuple(tally.mask_ious), tuple(tally.detections), tuple(pairs))


def _mostly_known(predicted: Labelling, owners: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "p"]:
    """Which predicted objects have at least half of their points on objects that are asked for."""
    count = len(predicted.classes)
    every = np.bincount(predicted.labels[predicted.labels != NO_INSTANCE], minlength=count)
    known = np.bincount(predicted.labels[(predicted.labels != NO_INSTANCE) & (owners >= 0)], minlength=count)
    return (every > 0) & (2 * known >= every)


def summarise(scenes: Sequence[SceneMasks]) -> SegmentationNumbers:
    """The numbers of at least one scene."""
    by_object: dict[str, Counter[str]] = defaultdict(Counter)
    names = _class_names(scenes)
    confusion: dict[str, dict[str, int]] = {row: dict.fromkeys((*names, MISSED), 0) for row in (*names, INVENTED)}
    for pair in _pairs(scenes):
        told = pair.predicted_class or MISSED
        confusion[pair.true.class_name if pair.true else INVENTED][told] += 1
        if pair.true:
            by_object[pair.true.name][told] += 1
    return SegmentationNumbers(
        scores=spreads(METRICS, scenes),
        by_object={name: dict(by_object[name]) for name in sorted(by_object)},
        confusion=confusion,
        scenes=len(scenes),
        objects=sum(len(each.best_ious) for each in scenes),
        predicted=sum(len(each.detections) for each in scenes),
        rows=tuple(scenes),
    )


def _pairs(scenes: Sequence[SceneMasks]) -> list[Pair]:
    return [pair for each in scenes for pair in each.pairs]


def _matches(scenes: Sequence[SceneMasks]) -> list[Pair]:
    return [pair for pair in _pairs(scenes) if pair.is_match]


def _average_precision(scenes: Sequence[SceneMasks]) -> float:
    detections = [detection for each in scenes for detection in each.detections]
    return average_precision(detections, sum(len(each.best_ious) for each in scenes))


def panoptic_quality(scenes: Sequence[SceneMasks]) -> tuple[float, float, float]:
    """Panoptic, segmentation and recognition quality, whatever the classes, each from 0 to 1."""
    matches = _matches(scenes)
    return _qualities([match.iou for match in matches], len(_pairs(scenes)) - len(matches))


def class_panoptic_quality(scenes: Sequence[SceneMasks]) -> float | None:
    """Panoptic quality where a match needs the right class, mean over the classes that are true or predicted."""
    classes = [(pair.true and pair.true.class_name, pair.predicted_class, pair.iou) for pair in _pairs(scenes)]
    qualities = []
    for name in _class_names(scenes):
        ious = [iou for true, told, iou in classes if true == told == name]
        failures = sum((true == name) != (told == name) for true, told, _ in classes)
        if ious or failures:
            qualities.append(_qualities(ious, failures)[0])
    return mean(qualities)


def _class_names(scenes: Sequence[SceneMasks]) -> tuple[str, ...]:
    """The classes of objects that are labelled today, and whatever else weights told."""
    told = {pair.predicted_class for pair in _pairs(scenes) if pair.predicted_class is not None}
    return (*CLASSES, *sorted(told - set(CLASSES)))


def _qualities(ious: Sequence[float], failures: int) -> tuple[float, float, float]:
    """Panoptic quality and its factors, of matches with these overlaps and of objects without a partner."""
    segmentation = float(np.mean(ious)) if ious else 0.0
    recognition = len(ious) / max(len(ious) + 0.5 * failures, 0.5)
    return segmentation * recognition, segmentation, recognition


def _percent(label: str, share: Callable[[Sequence[SceneMasks]], float | None]) -> Metric[Sequence[SceneMasks]]:
    """A share of 1, as a number in percent."""
    return Metric(label, lambda scenes: None if (value := share(scenes)) is None else 100.0 * value, ".1f")


METRICS = {
    "instance_miou": _percent("instance mIoU", lambda scenes: mean(iou for each in scenes for iou in each.best_ious)),
    "ap50": _percent("AP50, ranked by the object's score", _average_precision),
    "pq": _percent("panoptic quality, any class", lambda scenes: panoptic_quality(scenes)[0]),
    # Not defined without any match.
    "sq": _percent("  segmentation quality", lambda scenes: panoptic_quality(scenes)[1] or None),
    "rq": _percent("  recognition quality", lambda scenes: panoptic_quality(scenes)[2]),
    "class_pq": _percent("panoptic quality, right class", class_panoptic_quality),
    "class_accuracy": _percent(
        "class accuracy of the matches", lambda scenes: mean(match.right for match in _matches(scenes))
    ),
    "class_accuracy_alternative": _percent(
        "  or the class that the labels name as alternative",
        lambda scenes: mean(match.defensible for match in _matches(scenes)),
    ),
}
"""What is measured; AP50 whatever the class, and a match of `class_pq` must have the right one."""
