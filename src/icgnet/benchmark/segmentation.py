"""How well the network tells objects apart and names them: mIoU, AP50, panoptic quality, classes.

Everything is counted on the points of the clouds. A point truly belongs to the nearest object; points that are near
none (noise) are left out, and so are objects that hardly any point was measured on.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float, Int

from icgnet.benchmark.config import PictureConfig
from icgnet.benchmark.pictures import Picture, score_pictures
from icgnet.benchmark.statistics import Metric, Spread, cells, mean_or_none, spreads
from icgnet.benchmark.tables import Table
from icgnet.benchmark.true_shapes import NO_OBJECT, TrueShapes
from icgnet.inference.prediction import NO_INSTANCE, Prediction
from icgnet.objects.classes import CLASSES, known_class
from icgnet.predictor import Predictor
from icgnet.training.metrics import GraspTally, average_precision, count_masks

FEWEST_POINTS = 30
"""Objects with fewer points in the cloud are not asked for: about 1 cm² of surface."""
SAME = 0.5
"""A predicted and a true object are the same when their points overlap by more than this (IoU)."""


@dataclass(frozen=True, eq=False)
class Labelling:
    """An answer about the points of a cloud.

    Attributes:
        labels: index of the object of every point, -1 for none.
        classes: class of each object.
        scores: how sure each object is.
    """

    labels: Int[np.ndarray, "n"]
    classes: tuple[str, ...]
    scores: Float[np.ndarray, "i"]


@dataclass(frozen=True)
class NamedObject:
    """An object that really stands there.

    Attributes:
        name: key in its set.
        class_name: its class.
        alternative: the class that it could have had as well, by those who labelled it; None where it is clear.
    """

    name: str
    class_name: str
    alternative: str | None = None


@dataclass(frozen=True, eq=False)
class PointOwners:
    """What the points of a cloud really lie on.

    Attributes:
        labels: index of the object of every point, `NO_OBJECT` where none is near.
        objects: that stand there.
    """

    labels: Int[np.ndarray, "n"]
    objects: tuple[NamedObject, ...]

    @classmethod
    def of(cls, shapes: TrueShapes, points: Float[np.ndarray, "n 3"], classes: Sequence[str]) -> "PointOwners":
        """The truth about points of a scene.

        Args:
            shapes: of the scene.
            points: world frame [m].
            classes: that the weights know; objects of others count as "other".
        """
        named = [known_class(name, classes) for name in shapes.classes]
        alternatives = [name and known_class(name, classes) for name in shapes.class_alternatives]
        return cls(shapes.owners(points), tuple(map(NamedObject, shapes.names, named, alternatives)))


@dataclass(frozen=True)
class Match:
    """A true object and the predicted one that is the same."""

    true: NamedObject
    predicted_class: str
    iou: float

    @property
    def right(self) -> bool:
        """Whether the predicted class is the true one."""
        return self.predicted_class == self.true.class_name

    @property
    def defensible(self) -> bool:
        """Whether the predicted class is the true one, or the one that the object could have had as well."""
        return self.right or self.predicted_class == self.true.alternative


@dataclass(frozen=True)
class SceneMasks:
    """The instances of one scene.

    Attributes:
        index: number of the scene.
        best_ious: the largest overlap of each true object with any predicted one.
        detections: score and overlap of each predicted object, 0 if its object is taken.
        matches: the pairs of objects that are the same.
        missed: the other true objects.
        invented: classes of the other predicted objects.
    """

    index: int
    best_ious: tuple[float, ...]
    detections: tuple[tuple[float, float], ...]
    matches: tuple[Match, ...]
    missed: tuple[NamedObject, ...]
    invented: tuple[str, ...]


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

    def report(self) -> dict[str, Any]:
        """The entries of the report, in which the scores lie beside the others."""
        values = asdict(self)
        return {**values.pop("scores"), **values}


def measure(config: PictureConfig) -> SegmentationNumbers:
    """The instances that a network finds in the pictures of a configuration.

    Raises:
        IcgnetError: unusable objects, weights or gripper, weights that know neither an object's class nor "other", or
            no scene with an object that can be seen.
    """
    predictor = Predictor.load(config.weights, config.threads, config.gripper)
    return summarise(score_pictures(config, predictor, score_picture))


def tables(numbers: SegmentationNumbers) -> list[Table]:
    """What is printed; of the confusion, rows are true classes and columns predicted ones, without empty ones."""
    scores = [(metric.label, *cells(numbers.scores[name])) for name, metric in METRICS.items()]
    columns = [
        name
        for name in next(iter(numbers.confusion.values()))
        if name == "missed" or any(row[name] for row in numbers.confusion.values())
    ]
    counts = [
        (name, *(str(row[column] or "") for column in columns))
        for name, row in numbers.confusion.items()
        if any(row.values())
    ]
    note = f"{numbers.objects} visible objects in {numbers.scenes} scenes; {numbers.predicted} predicted"
    return [
        Table(("percent ± std over scenes", "all scenes", "95 %"), scores),
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
    truth = PointOwners.of(picture.truth, prediction.cloud.points, prediction.classes)
    if not visible_objects(truth.labels, len(picture.truth)).any():
        return None
    return compare_masks(picture.index, labelling(prediction), truth)


def labelling(prediction: Prediction) -> Labelling:
    """The objects that the network found, with its own scores."""
    return Labelling(
        prediction.cloud_instances,
        tuple(item.class_name for item in prediction.objects),
        np.array([item.score for item in prediction.objects]),
    )


def compare_masks(index: int, predicted: Labelling, truth: PointOwners) -> SceneMasks:
    """Compares the objects of one scene.

    Predicted objects that lie on points without a true object, or on those of objects that are not asked for, by more
    than a half are neither right nor wrong.

    Args:
        index: number of the scene.
        predicted: by the network.
        truth: about the same points.
    """
    asked = np.flatnonzero(visible_objects(truth.labels, len(truth.objects)))
    owners = np.where(np.isin(truth.labels, asked), truth.labels, NO_OBJECT)
    found = np.flatnonzero(_mostly_known(predicted, owners))
    overlaps = label_overlaps(predicted.labels, len(predicted.classes), owners, len(truth.objects))[found][:, asked]
    # More than half of both: no other pair can have one of the two.
    pairs = np.argwhere(overlaps > SAME)
    matches = tuple(
        Match(truth.objects[asked[i]], predicted.classes[found[p]], float(overlaps[p, i])) for p, i in pairs
    )
    tally = GraspTally()
    masks = torch.from_numpy((predicted.labels == found[:, None]) & (owners >= 0))
    count_masks(tally, (masks, torch.from_numpy(predicted.scores[found])), torch.from_numpy(owners == asked[:, None]))
    return SceneMasks(
        index,
        tuple(tally.mask_ious),
        tuple(tally.detections),
        matches,
        missed=tuple(truth.objects[k] for k in np.delete(asked, pairs[:, 1])),
        invented=tuple(predicted.classes[k] for k in np.delete(found, pairs[:, 0])),
    )


def _mostly_known(predicted: Labelling, owners: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "p"]:
    """Which predicted objects have at least half of their points on objects that are asked for."""
    count = len(predicted.classes)
    every = np.bincount(predicted.labels[predicted.labels != NO_INSTANCE], minlength=count)
    known = np.bincount(predicted.labels[(predicted.labels != NO_INSTANCE) & (owners >= 0)], minlength=count)
    return (every > 0) & (2 * known >= every)


def summarise(scenes: Sequence[SceneMasks]) -> SegmentationNumbers:
    """The numbers of at least one scene."""
    return SegmentationNumbers(
        scores=spreads(METRICS, scenes),
        by_object=by_object(scenes),
        confusion=confusion(scenes),
        scenes=len(scenes),
        objects=sum(len(each.best_ious) for each in scenes),
        predicted=sum(len(each.detections) for each in scenes),
        rows=tuple(scenes),
    )


def _average_precision(scenes: Sequence[SceneMasks]) -> float:
    detections = [detection for each in scenes for detection in each.detections]
    return average_precision(detections, sum(len(each.best_ious) for each in scenes))


def panoptic_quality(scenes: Sequence[SceneMasks]) -> tuple[float, float, float]:
    """Panoptic, segmentation and recognition quality, whatever the classes, each from 0 to 1."""
    ious = [match.iou for match in _matches(scenes)]
    return _qualities(ious, sum(len(each.missed) + len(each.invented) for each in scenes))


def class_panoptic_quality(scenes: Sequence[SceneMasks]) -> float | None:
    """Panoptic quality where a match needs the right class, mean over the classes that are true or predicted."""
    matches = _matches(scenes)
    wrong = [name for each in scenes for name in (*(true.class_name for true in each.missed), *each.invented)]
    qualities = []
    for name in _class_names(scenes):
        ious = [match.iou for match in matches if match.right and match.predicted_class == name]
        failures = wrong.count(name) + sum(
            (match.true.class_name == name) != (match.predicted_class == name) for match in matches
        )
        if ious or failures:
            qualities.append(_qualities(ious, failures)[0])
    return mean_or_none(qualities)


def _class_names(scenes: Sequence[SceneMasks]) -> tuple[str, ...]:
    """The classes of objects that are labelled today, and whatever else weights told."""
    told = {match.predicted_class for match in _matches(scenes)} | {name for each in scenes for name in each.invented}
    return (*CLASSES, *sorted(told - set(CLASSES)))


def _qualities(ious: Sequence[float], failures: int) -> tuple[float, float, float]:
    """Panoptic quality and its factors, of matches with these overlaps and of objects without a partner."""
    segmentation = float(np.mean(ious)) if ious else 0.0
    recognition = len(ious) / max(len(ious) + 0.5 * failures, 0.5)
    return segmentation * recognition, segmentation, recognition


def by_object(scenes: Sequence[SceneMasks]) -> dict[str, dict[str, int]]:
    """How often each object, by its key, was told to be of a class, or missed."""
    table: dict[str, Counter[str]] = defaultdict(Counter)
    for each in scenes:
        for match in each.matches:
            table[match.true.name][match.predicted_class] += 1
        for true in each.missed:
            table[true.name]["missed"] += 1
    return {name: dict(table[name]) for name in sorted(table)}


def confusion(scenes: Sequence[SceneMasks]) -> dict[str, dict[str, int]]:
    """Number of objects by true class and predicted class; of those without a partner, under missed and invented."""
    names = _class_names(scenes)
    table: dict[str, dict[str, int]] = {row: dict.fromkeys((*names, "missed"), 0) for row in (*names, "invented")}
    for each in scenes:
        for match in each.matches:
            table[match.true.class_name][match.predicted_class] += 1
        for true in each.missed:
            table[true.class_name]["missed"] += 1
        for name in each.invented:
            table["invented"][name] += 1
    return table


def _metric(label: str, share: Callable[[Sequence[SceneMasks]], float | None]) -> Metric[SceneMasks]:
    """A share of 1, as a number in percent."""
    return Metric(label, lambda scenes: None if (value := share(scenes)) is None else 100.0 * value)


def _matches(scenes: Sequence[SceneMasks]) -> list[Match]:
    return [match for each in scenes for match in each.matches]


METRICS = {
    "instance_miou": _metric(
        "instance mIoU", lambda scenes: mean_or_none([i for one in scenes for i in one.best_ious])
    ),
    "ap50": _metric("AP50, ranked by the object's score", _average_precision),
    "pq": _metric("panoptic quality, any class", lambda scenes: panoptic_quality(scenes)[0]),
    # Not defined without any match.
    "sq": _metric("  segmentation quality", lambda scenes: panoptic_quality(scenes)[1] or None),
    "rq": _metric("  recognition quality", lambda scenes: panoptic_quality(scenes)[2]),
    "class_pq": _metric("panoptic quality, right class", class_panoptic_quality),
    "class_accuracy": _metric(
        "class accuracy of the matches", lambda scenes: mean_or_none([float(m.right) for m in _matches(scenes)])
    ),
    "class_accuracy_alternative": _metric(
        "  or the class that the labels name as alternative",
        lambda scenes: mean_or_none([float(m.defensible) for m in _matches(scenes)]),
    ),
}
"""What is measured; AP50 whatever the class, and a match of `class_pq` must have the right one."""
