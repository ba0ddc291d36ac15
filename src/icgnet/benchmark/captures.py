"""How well real frames are understood: objects, classes, grasps, the support and the time, against labels or clicks.

Overlap and boundary F are those of papers on unseen objects (UOIS-Net, UCN): objects are matched one to one by F,
pixels are summed within a frame, and frames are averaged.
"""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from rich.console import Console
from rich.progress import track
from scipy import ndimage
from scipy.optimize import linear_sum_assignment

from icgnet.benchmark.config import CapturesConfig
from icgnet.benchmark.labelled_frames import Clicks, LabelledFrame, find_frames, read_frame
from icgnet.benchmark.published_results import CAPTURES
from icgnet.benchmark.statistics import Spread, spread
from icgnet.benchmark.tables import NOTHING, Table
from icgnet.errors import IcgnetError
from icgnet.geometry.camera import unproject
from icgnet.geometry.plane import Plane
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.prediction import Prediction
from icgnet.predictor import Predictor

GOOD = 0.75
"""An object with at least this F is good."""
BOUNDARY = 0.003
"""How far boundaries may be apart, as a share of the image's diagonal."""
WHOLE, SHARED, SEEN = 0.8, 0.1, 0.5
"""Shares of an object's clicks or pixels: that one label must carry, from which on a label is shared with it, and that
labels must carry lest it is missed."""
KINDS = ("whole", "split", "merged", "missed")
RIGHT_ANGLE_DEG, RIGHT_HEIGHT_MM = 5.0, 15.0
"""A support is right within these."""
FLAT = 0.008
"""Points of the true support are so near to its plane [m]."""
PATCH = 4
"""How many pixels around a click on the support are taken for it, too."""
EVERY = "all"
IN_LABELS, IN_CLICKS = "all with label images", "all with clicks"


@dataclass(frozen=True)
class Overlap:
    """The pixels of one frame, from 0 to 1.

    Attributes:
        precision: share of the predicted objects' pixels that are on their true object; 0 without any.
        recall: share of the true objects' pixels that are on their predicted object.
        f: of both.
        boundary_f: the same of boundaries, with some tolerance.
        best: F of each true object and its partner, 0 without one.
    """

    precision: float
    recall: float
    f: float
    boundary_f: float
    best: tuple[float, ...]


@dataclass(frozen=True)
class SupportError:
    """How far the predicted support is from the true one; None where none was predicted."""

    angle_deg: float | None
    height_mm: float | None

    @property
    def right(self) -> bool:
        """Whether it is near enough."""
        if self.angle_deg is None or self.height_mm is None:
            return False
        return self.angle_deg <= RIGHT_ANGLE_DEG and self.height_mm <= RIGHT_HEIGHT_MM


@dataclass(frozen=True)
class FrameScores:
    """What was measured on one frame.

    Attributes:
        name: of the frame.
        subset: that it is counted with.
        overlap: of frames with label images.
        kinds: what became of each labelled or clicked object, one of `KINDS`.
        false: number of predicted objects that are none.
        classes: of whole objects whose class is given: whether it was told; one that the weights do not know never is.
        unknown_classes: of clicked objects, which the weights do not know.
        grasped: of graspable objects: whether there is a grasp.
        support: where the true one is known.
        seconds: that the prediction took.
        error: why there is no prediction, which counts as one without objects.
    """

    name: str
    subset: str
    overlap: Overlap | None
    kinds: tuple[str, ...]
    false: int
    classes: tuple[bool, ...]
    unknown_classes: tuple[str, ...]
    grasped: tuple[bool, ...]
    support: SupportError | None
    seconds: float
    error: str | None

    @property
    def good(self) -> int:
        """Objects that were found: those with a good overlap, or whole ones where there are only clicks."""
        if self.overlap is None:
            return self.kinds.count("whole")
        return sum(f >= GOOD for f in self.overlap.best)

    @property
    def quality(self) -> float:
        """Objects that were found, among all true and false ones, from 0 to 1."""
        return self.good / (len(self.kinds) + self.false)

    def story(self) -> str:
        """What went wrong, in words."""
        if self.error is not None:
            return self.error
        count, lost = len(self.kinds), len(self.kinds) - self.good
        said = [f"{lost} of {count} objects {'not whole' if self.overlap is None else f'below {GOOD}'}"] if lost else []
        said += [f"{self.kinds.count(kind)} {kind}" for kind in KINDS[1:] if kind in self.kinds]
        said += [f"{self.false} false"] if self.false else []
        said += [f"{self.grasped.count(False)} of {len(self.grasped)} without a grasp"] if False in self.grasped else []
        if self.support is not None and not self.support.right:
            said.append(f"support off by {self.support.angle_deg:.0f} degrees, {self.support.height_mm:.0f} mm")
        return "; ".join(said) or "all right"


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
    predict(predictor, read_frame(paths[0]))  # the first one takes longer
    console = Console(stderr=True)
    rows = []
    for path in track(paths, "frames", console=console, transient=True, disable=not console.is_terminal):
        frame = read_frame(path)
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


def score(
    frame: LabelledFrame,
    prediction: Prediction | None,
    classes: Sequence[str],
    seconds: float = 0.0,
    error: str | None = None,
) -> FrameScores:
    """What a prediction is worth; without one, nothing was found.

    Args:
        frame: with labels or clicks.
        prediction: of it.
        classes: that the weights know.
        seconds: that the prediction took.
        error: why there is no prediction.
    """
    found = np.zeros(frame.depth.shape, dtype=np.int64) if prediction is None else prediction.instance_mask + 1
    table = found_by_object(frame, found)
    kinds, main = kinds_of(table)
    named, unknown, grasped = [], [], []
    grasps = set() if prediction is None else set((prediction.grasps.instances + 1).tolist())
    for item, kind, label in zip(() if frame.clicks is None else frame.clicks.objects, kinds, main, strict=False):
        if item.class_name is not None and item.class_name not in classes:
            unknown.append(item.class_name)
        if item.class_name is not None and prediction is not None and kind == "whole":
            named.append(prediction.class_of(label - 1) == item.class_name)
        if item.graspable:
            grasped.append(label in grasps)
    true_support = support_plane(support_points(frame))
    return FrameScores(
        frame.name,
        frame.subset,
        None if frame.labels is None else overlap(found, frame.labels),
        kinds,
        false_objects(frame, found, table),
        tuple(named),
        tuple(unknown),
        tuple(grasped),
        None if true_support is None else support_error(prediction, frame.camera_pose, *true_support),
        seconds,
        error,
    )


def overlap(found: Int[np.ndarray, "h w"], labels: Int[np.ndarray, "h w"]) -> Overlap:
    """The overlap of predicted and true objects, both 0 for none and from 1 on without gaps for objects."""
    both = _pairs(labels.ravel(), found.ravel())
    true_sizes, found_sizes, common = both[1:].sum(axis=1), both[:, 1:].sum(axis=0), both[1:, 1:]
    every_f = 2 * common / np.maximum(true_sizes[:, None] + found_sizes, 1)
    rows, columns = linear_sum_assignment(-every_f)
    best = np.zeros(len(true_sizes))
    best[rows] = every_f[rows, columns]
    hits = float(common[rows, columns].sum())
    precision, recall = hits / max(int(found_sizes.sum()), 1), hits / int(true_sizes.sum())

    radius = int(np.ceil(BOUNDARY * np.hypot(*labels.shape)))
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    disc = x * x + y * y <= radius * radius
    true_edges = [_boundary(labels == k + 1) for k in range(len(true_sizes))]
    found_edges = [_boundary(found == k + 1) for k in range(len(found_sizes))]
    near_true = near_found = 0
    for row, column in zip(rows, columns, strict=True):
        near_true += int((found_edges[column] & ndimage.binary_dilation(true_edges[row], disc)).sum())
        near_found += int((true_edges[row] & ndimage.binary_dilation(found_edges[column], disc)).sum())
    boundary = _f(
        near_true / max(sum(int(each.sum()) for each in found_edges), 1),
        near_found / max(sum(int(each.sum()) for each in true_edges), 1),
    )
    return Overlap(precision, recall, _f(precision, recall), boundary, tuple(best.tolist()))


def found_by_object(frame: LabelledFrame, found: Int[np.ndarray, "h w"]) -> Int[np.ndarray, "o p"]:
    """How many clicks or measured pixels of each true object carry each label, from 0 for none on."""
    if frame.clicks is None:
        assert frame.labels is not None
        measured = np.isfinite(frame.depth)
        return _pairs(frame.labels[measured], found[measured], int(frame.labels.max()), int(found.max()))[1:]
    clicked = [item.clicks for item in frame.clicks.objects]
    u, v = np.concatenate(clicked).T
    owners = np.repeat(np.arange(len(clicked)), [len(each) for each in clicked])
    return _pairs(owners, found[v, u], len(clicked) - 1, int(found.max()))


def kinds_of(table: Int[np.ndarray, "o p"]) -> tuple[tuple[str, ...], tuple[int, ...]]:
    """What became of each true object, and the label that carries most of it (0 if none does)."""
    shares = table / np.maximum(table.sum(axis=1, keepdims=True), 1)
    labelled = shares[:, 1:]
    main = labelled.argmax(axis=1) if labelled.shape[1] else np.zeros(len(table), dtype=np.int64)
    kinds = []
    for number, label in enumerate(main):
        if labelled[number].sum() < SEEN:
            kinds.append("missed")
        elif (np.delete(labelled[:, label], number) >= SHARED).any():
            kinds.append("merged")
        else:
            kinds.append("whole" if labelled[number, label] >= WHOLE else "split")
    seen = labelled.sum(axis=1) > 0
    return tuple(kinds), tuple(np.where(seen, main + 1, 0).tolist())


def false_objects(frame: LabelledFrame, found: Int[np.ndarray, "h w"], table: Int[np.ndarray, "o p"]) -> int:
    """Predicted objects that are none.

    With label images: less than half of their pixels are on objects. With clicks: no object's click is on them; where
    objects may lack clicks, only if one on the support or background is.
    """
    sizes, on_objects = np.bincount(found.ravel(), minlength=table.shape[1])[1:], table[:, 1:].sum(axis=0)
    if frame.clicks is None:
        return int((2 * on_objects < sizes).sum())
    is_false = (sizes > 0) & (on_objects == 0)
    if frame.clicks.uncertain:
        u, v = np.concatenate([frame.clicks.support, frame.clicks.background]).T
        is_false &= np.bincount(found[v, u], minlength=table.shape[1])[1:] > 0
    return int(is_false.sum())


def support_points(frame: LabelledFrame) -> Float[np.ndarray, "n 3"]:
    """Measured points that are known to belong to what carries the objects, or may: camera frame [m]."""
    points = unproject(frame.depth, frame.intrinsics)
    asked = frame.labels == 0 if frame.clicks is None else _patches(frame.clicks, frame.depth.shape)
    return points[asked & np.isfinite(frame.depth)]


def _patches(clicks: Clicks, shape: tuple[int, ...]) -> Bool[np.ndarray, "h w"]:
    """The pixels around the clicks on the support."""
    asked = np.zeros(shape, dtype=bool)
    for u, v in clicks.support:
        asked[max(v - PATCH, 0) : v + PATCH + 1, max(u - PATCH, 0) : u + PATCH + 1] = True
    return asked


def support_plane(points: Float[np.ndarray, "n 3"]) -> tuple[Plane, Float[np.ndarray, "m 3"]] | None:
    """The plane that holds at least half of the points, its normal towards the camera, and its points; None if none.

    It is found by itself and not as the predictor finds the table, which is measured against it.
    """
    if len(points) < 100:
        return None
    rng = np.random.default_rng(0)
    sample = points[rng.permutation(len(points))[:2000]]
    corners = sample[rng.integers(len(sample), size=(300, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    offsets = -(normals * corners[:, 0]).sum(axis=1)
    normals[np.linalg.norm(normals, axis=1) < 0.5] = np.nan  # three points on one line
    best = int((np.abs(normals @ sample.T + offsets[:, None]) < FLAT).sum(axis=1).argmax())
    plane = Plane(normals[best], float(offsets[best]))
    for _ in range(5):
        own = points[np.abs(plane.height(points)) < FLAT]
        if 2 * len(own) < len(points):
            return None
        mean = own.mean(axis=0)
        normal = np.linalg.eigh((own - mean).T @ (own - mean))[1][:, 0]
        normal *= -1.0 if normal @ mean > 0 else 1.0
        plane = Plane(normal, float(-normal @ mean))
    return plane, own


def support_error(
    prediction: Prediction | None,
    camera_pose: Float[np.ndarray, "4 4"] | None,
    true: Plane,
    points: Float[np.ndarray, "n 3"],
) -> SupportError:
    """How far the predicted table plane is from the true one, at its points."""
    if prediction is None:
        return SupportError(None, None)
    T_camera_frame = np.eye(4) if camera_pose is None else invert_transform(camera_pose)
    T_table_camera = invert_transform(T_camera_frame @ prediction.T_frame_table)
    angle = np.degrees(np.arccos(np.clip(T_table_camera[2, :3] @ true.normal, -1.0, 1.0)))
    height = np.median(transform_points(T_table_camera, points)[:, 2]) - TABLE_HEIGHT
    return SupportError(float(angle), float(abs(1e3 * height)))


def _pairs(
    true: Int[np.ndarray, "n"], found: Int[np.ndarray, "n"], most: int | None = None, most_found: int | None = None
) -> Int[np.ndarray, "o p"]:
    """How often each number of one list stands beside each of the other, up to the largest ones."""
    rows = 1 + int(true.max() if most is None else most)
    columns = 1 + int(found.max() if most_found is None else most_found)
    return np.bincount(true * columns + found, minlength=rows * columns).reshape(rows, columns)


def _boundary(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels that differ from the one right of them, below, or right below, as in the papers."""
    more = np.pad(mask, ((0, 1), (0, 1)), mode="edge")
    return (mask != more[:-1, 1:]) | (mask != more[1:, :-1]) | (mask != more[1:, 1:])


def _f(precision: float, recall: float) -> float:
    return 2 * precision * recall / max(precision + recall, 1e-12)


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
    overlaps = [_row(name, each, OVERLAP) for name, each in groups.items() if each.f is not None]
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
        published = [(method, *values) for method, *values, _ in CAPTURES]
        sources = (f"{method}: {who}" for method, *_, who in CAPTURES)
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
