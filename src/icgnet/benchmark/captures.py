"""How well real frames are understood: objects, classes, grasps, the support and the time; see `capture_scores`."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from icgnet.benchmark.capture_scores import GOOD, KINDS, FrameScores, score
from icgnet.benchmark.config import EVERY, IN_CLICKS, IN_LABELS, CapturesConfig
from icgnet.benchmark.labelled_frames import LabelledFrame, find_frames, read_frame
from icgnet.benchmark.pictures import progress_bar
from icgnet.benchmark.published import PUBLISHED
from icgnet.benchmark.statistics import Spread, spread
from icgnet.benchmark.tables import NOTHING, Table
from icgnet.errors import IcgnetError
from icgnet.inference.prediction import Prediction
from icgnet.predictor import Predictor


@dataclass(frozen=True)
class GroupNumbers:
    """The numbers of some frames; percent unless named otherwise, None where nothing defines one.

    Attributes:
        frames: how many.
        objects: labelled or clicked in them.
        precision: of the overlap, mean of the frames with label images; so are the next three.
        recall: see `Overlap`.
        f: see `Overlap`.
        boundary_f: see `Overlap`.
        good: share of the labelled objects with a good F.
        whole: share of the objects that one label carries alone; the next three are the others.
        split: carried by several labels or by one in part.
        merged: that share their label.
        missed: that hardly any label carries.
        false: number of predicted objects a frame that are none.
        class_accuracy: share of the whole objects whose class was told, of those whose class is given.
        grasped: share of the graspable objects with a grasp.
        support_right: share of the frames, of those where the support is known.
        support_angle_deg: median error of its normal, where one was predicted [degrees].
        support_height_mm: median error of its height, where one was predicted [mm].
        seconds: median time of a prediction [s].
        worst_seconds: the longest [s].
        errors: frames without a prediction.
    """

    frames: int
    objects: int
    precision: Spread | None
    recall: Spread | None
    f: Spread | None
    boundary_f: Spread | None
    good: Spread | None
    whole: Spread | None
    split: Spread | None
    merged: Spread | None
    missed: Spread | None
    false: Spread | None
    class_accuracy: Spread | None
    grasped: Spread | None
    support_right: Spread | None
    support_angle_deg: Spread | None
    support_height_mm: Spread | None
    seconds: Spread | None
    worst_seconds: float
    errors: int


@dataclass(frozen=True)
class CaptureNumbers:
    """The numbers of a folder of frames.

    Attributes:
        groups: by subset, and of all frames.
        unknown_classes: how many clicked objects have a class that the weights do not know, by class.
        rows: what was measured on each frame.
    """

    groups: dict[str, GroupNumbers]
    unknown_classes: dict[str, int]
    rows: tuple[FrameScores, ...]


Look = Callable[[LabelledFrame, Prediction | None, FrameScores], None]


def measure(config: CapturesConfig, look: Look | None = None) -> CaptureNumbers:
    """The numbers of all frames in a folder.

    Args:
        config: what is measured.
        look: is shown each frame, its prediction (None where there was an error) and what was measured on it.

    Raises:
        IcgnetError: no frames, a frame that cannot be used, or unusable weights.
    """
    paths = find_frames(config.folder)
    for path in paths:
        read_frame(path)  # what is wrong with one is said before the first prediction
    predictor = Predictor.load(config.weights, config.threads)
    predict(predictor, read_frame(paths[0], config.pose))  # the first one takes longer
    rows = []
    for path in progress_bar(paths, "frames"):
        frame = read_frame(path, config.pose)
        prediction, seconds, error = predict(predictor, frame)
        rows.append(score(frame, prediction, predictor.classes, seconds, error))
        if look is not None:
            look(frame, prediction, rows[-1])
    return summarise(rows)


def predict(predictor: Predictor, frame: LabelledFrame) -> tuple[Prediction | None, float, str | None]:
    """The prediction, the seconds that it took, and why there is none."""
    prediction, error, start = None, None, time.perf_counter()
    try:
        prediction = predictor.predict_depth(frame.depth, frame.intrinsics, frame.camera_pose)
    except IcgnetError as raised:
        error = str(raised)
    return prediction, time.perf_counter() - start, error


def summarise(rows: Sequence[FrameScores]) -> CaptureNumbers:
    """The numbers of at least one frame, by subset and of all."""
    groups = {name: [row for row in rows if row.subset == name] for name in sorted({row.subset for row in rows})}
    labelled, clicked = ([row for row in rows if (row.overlap is None) == wanted] for wanted in (False, True))
    if labelled and clicked:
        groups |= {IN_LABELS: labelled, IN_CLICKS: clicked}
    groups[EVERY] = list(rows)
    unknown = Counter(name for row in rows for name in row.unknown_classes)
    return CaptureNumbers({name: _numbers(group) for name, group in groups.items()}, dict(unknown), tuple(rows))


def _numbers(rows: Sequence[FrameScores]) -> GroupNumbers:
    overlaps = [row.overlap for row in rows if row.overlap is not None]

    def share(parts: Sequence[tuple[int | float, int]], unit: float = 100.0) -> Spread | None:
        """A sum over the frames divided by another one."""
        return spread(
            parts, lambda some: unit * sum(a for a, _ in some) / of if (of := sum(b for _, b in some)) else None
        )

    def middle(values: Sequence[float]) -> Spread | None:
        return spread(values, lambda some: float(np.median(some))) if values else None

    def kind(name: str) -> Spread | None:
        return share([(row.kinds.count(name), len(row.kinds)) for row in rows])

    supports = [row.support for row in rows if row.support is not None]
    return GroupNumbers(
        frames=len(rows),
        objects=sum(len(row.kinds) for row in rows),
        precision=share([(each.precision, 1) for each in overlaps]),
        recall=share([(each.recall, 1) for each in overlaps]),
        f=share([(each.f, 1) for each in overlaps]),
        boundary_f=share([(each.boundary_f, 1) for each in overlaps]),
        good=share([(sum(f >= GOOD for f in each.best), len(each.best)) for each in overlaps]),
        whole=kind("whole"),
        split=kind("split"),
        merged=kind("merged"),
        missed=kind("missed"),
        false=share([(row.false, 1) for row in rows], 1.0),
        class_accuracy=share([(sum(row.classes), len(row.classes)) for row in rows]),
        grasped=share([(sum(row.grasped), len(row.grasped)) for row in rows]),
        support_right=share([(each.right, 1) for each in supports]),
        support_angle_deg=middle([each.angle_deg for each in supports if each.angle_deg is not None]),
        support_height_mm=middle([each.height_mm for each in supports if each.height_mm is not None]),
        seconds=middle([row.seconds for row in rows]),
        worst_seconds=max(row.seconds for row in rows),
        errors=sum(row.error is not None for row in rows),
    )


OVERLAP = {"P": "precision", "R": "recall", "F": "f", "boundary F": "boundary_f", f"F >= {GOOD}": "good"}
"""Columns that papers have as well, and what they are called in `GroupNumbers`."""
OBJECTS = {
    **{name: name for name in KINDS},
    **{"false a frame": "false", "right class": "class_accuracy", "with grasp": "grasped"},
}
SUPPORT = {"right, percent": "support_right", "angle, degrees": "support_angle_deg", "height, mm": "support_height_mm"}
OVERLAP_TITLE = "overlap with label images, percent, and 95 % interval"
CROPPED = (
    "published values are of all frames of OSD as recorded; the version of Alexandrov is another one: floor, walls and "
    "far things are cut away"
)


def tables(numbers: CaptureNumbers) -> list[Table]:
    """What is printed: overlap beside published values, what became of the objects, support and time."""
    groups = numbers.groups
    labelled = [name for name, each in groups.items() if each.f is not None]
    overlaps = [_row(name, groups[name], OVERLAP) for name in labelled if name != EVERY or IN_LABELS not in groups]
    objects = [_row(name, each, OBJECTS) for name, each in groups.items()]
    rest = [
        (*_row(name, each, {**SUPPORT, "s": "seconds"}), f"{each.worst_seconds:.1f}", str(each.errors or NOTHING))
        for name, each in groups.items()
    ]
    unknown = ", ".join(f"{name} ({count})" for name, count in sorted(numbers.unknown_classes.items()))
    notes = (f"classes that the weights do not know, so never right: {unknown}",) if unknown else ()
    first = "frames / objects"
    printed = [
        Table((first, *OBJECTS), objects, title="objects, percent, and 95 % interval", notes=notes),
        Table((first, *SUPPORT, "seconds, median", "worst", "errors"), rest, title="support and time"),
    ]
    if overlaps:
        published = [(method, *values) for method, _, _, *values in PUBLISHED["captures"]]
        sources = (f"{method}: {who}" for method, _, who, *_ in PUBLISHED["captures"])
        printed.insert(0, Table((first, *OVERLAP), overlaps + published, OVERLAP_TITLE, (*sources, CROPPED)))
    return printed


def _row(name: str, numbers: GroupNumbers, columns: dict[str, str]) -> tuple[str, ...]:
    values = (getattr(numbers, field) for field in columns.values())
    return (f"{name}\n{numbers.frames} / {numbers.objects}", *map(_cell, values))


def _cell(value: Spread | None) -> str:
    """A number with its interval on a line below, so that tables stay narrow."""
    if value is None:
        return NOTHING
    digits = 0 if value.high >= 10 else 1
    return f"{value.mean:.1f}\n{value.low:.{digits}f}-{value.high:.{digits}f}"
