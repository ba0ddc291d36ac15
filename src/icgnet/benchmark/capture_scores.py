"""What a prediction of a real frame is worth: objects, classes, grasps and the support, against labels or clicks.

Overlap and boundary F are those of papers on unseen objects (UOIS-Net, UCN): objects are matched one to one by F,
pixels are summed within a frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy import ndimage
from scipy.optimize import linear_sum_assignment

from icgnet.benchmark.labelled_frames import Clicks, LabelledFrame
from icgnet.geometry.camera import unproject
from icgnet.geometry.plane import Plane
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.prediction import Prediction

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
        if False in self.grasped:
            said.append(f"no grasp on {self.grasped.count(False)} of {len(self.grasped)}")
        off = self.support
        if off is not None and off.angle_deg is not None and not off.right:
            said.append(f"support off by {off.angle_deg:.0f} degrees, {off.height_mm:.0f} mm")
        return "; ".join(said) or "all right"


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
    both = _pairs(labels.ravel(), found.ravel(), int(labels.max()) + 1, int(found.max()) + 1)
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
    columns = int(found.max()) + 1
    if frame.clicks is None:
        assert frame.labels is not None
        measured = np.isfinite(frame.depth)
        return _pairs(frame.labels[measured], found[measured], int(frame.labels.max()) + 1, columns)[1:]
    clicked = [item.clicks for item in frame.clicks.objects]
    u, v = np.concatenate(clicked).T
    owners = np.repeat(np.arange(len(clicked)), [len(each) for each in clicked])
    return _pairs(owners, found[v, u], len(clicked), columns)


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


def _pairs(true: Int[np.ndarray, "n"], found: Int[np.ndarray, "n"], rows: int, columns: int) -> Int[np.ndarray, "o p"]:
    """How often each number of one list, below `rows`, stands beside each of the other, below `columns`."""
    return np.bincount(true * columns + found, minlength=rows * columns).reshape(rows, columns)


def _boundary(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Pixels that differ from the one right of them, below, or right below, as in the papers."""
    more = np.pad(mask, ((0, 1), (0, 1)), mode="edge")
    return (mask != more[:-1, 1:]) | (mask != more[1:, :-1]) | (mask != more[1:, 1:])


def _f(precision: float, recall: float) -> float:
    return 2 * precision * recall / max(precision + recall, 1e-12)
