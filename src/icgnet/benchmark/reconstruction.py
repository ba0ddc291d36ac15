"""How well the network completes shapes: IoU, Chamfer-L1 and F-score, of whole scenes and of single objects.

Paper: "Scene Reconstruction", with the protocol of the published code: 100,000 points on each surface and 100,000 in
the box around the true scene, 2 cm wider. True surfaces are the visual meshes, inner walls and hidden bottoms included.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Bool, Float
from scipy.optimize import linear_sum_assignment
from scipy.spatial import KDTree

from icgnet.benchmark.config import PictureConfig
from icgnet.benchmark.pictures import Picture, score_pictures
from icgnet.benchmark.segmentation import label_overlaps, visible_objects
from icgnet.benchmark.statistics import Metric, Spread, mean, spreads, table
from icgnet.benchmark.tables import Table
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.inference.prediction import Prediction
from icgnet.predictor import Predictor

SAMPLES = 100_000
INSTANCE_SAMPLES = 20_000
ROOM = 0.02
"""The box in which occupancies are compared is wider than the true shapes by this on each side [m]."""
CELL = 0.01  # surface points are ordered by cells of this [m]
F_NEAR, F_FAR = 0.003, 0.010  # F-scores count what is within 1 % of the workspace's 0.3 m, and within 1 cm [m]


@dataclass(frozen=True)
class ShapeScores:
    """A predicted shape against the true one; None where nothing was predicted.

    Attributes:
        iou: of the insides [percent].
        chamfer_l1_mm: mean of accuracy and completeness [mm].
        accuracy_mm: mean distance from the predicted surface to the true one [mm].
        completeness_mm: mean distance from the true surface to the predicted one [mm].
        f_score_3mm: harmonic mean of the shares of both surfaces within 3 mm of the other [percent].
        f_score_10mm: the same within 10 mm [percent].
    """

    iou: float
    chamfer_l1_mm: float | None = None
    accuracy_mm: float | None = None
    completeness_mm: float | None = None
    f_score_3mm: float = 0.0
    f_score_10mm: float = 0.0


@dataclass(frozen=True)
class SceneScores:
    """The shapes of one scene.

    Attributes:
        index: number of the scene.
        objects: that stand there.
        visible: of these, those with points in the cloud.
        predicted: objects that the network found.
        scene: everything predicted against everything true.
        instances: the visible objects that an instance was matched to.
    """

    index: int
    objects: int
    visible: int
    predicted: int
    scene: ShapeScores
    instances: tuple[ShapeScores, ...]


@dataclass(frozen=True)
class ReconstructionNumbers:
    """The shapes of many scenes; every spread is over the scenes.

    Attributes:
        scene: each of `SHAPE_METRICS`, mean over the scenes; distances over those with a predicted surface.
        per_instance: each of `INSTANCE_METRICS`.
        scenes: with at least one object.
        without_shape: of these, scenes in which no surface was predicted.
        visible: objects with points in the clouds.
        matched: of these, the objects that an instance was matched to.
        rows: what was measured on each scene.
    """

    scene: dict[str, Spread | None]
    per_instance: dict[str, Spread | None]
    scenes: int
    without_shape: int
    visible: int
    matched: int
    rows: tuple[SceneScores, ...]


def measure(config: PictureConfig) -> ReconstructionNumbers:
    """The shapes that a network predicts for the pictures of a configuration.

    Raises:
        IcgnetError: unusable objects, weights or gripper, or no scene with an object that can be seen.
    """
    predictor = Predictor.load(config.weights, config.threads, config.gripper)
    return summarise(score_pictures(config, predictor, score_picture))


def tables(numbers: ReconstructionNumbers) -> list[Table]:
    """What is printed."""
    notes = (
        "3 mm is 1 % of the workspace.",
        f"{numbers.matched} of {numbers.visible} visible objects found; "
        f"{numbers.without_shape} of {numbers.scenes} scenes without any predicted shape.",
    )
    headers = ("± std [95 %]", "scene", "object found")
    return [table(headers, INSTANCE_METRICS, numbers.scene, numbers.per_instance, notes=notes)]


def score_picture(picture: Picture, prediction: Prediction | None) -> SceneScores | None:
    """The shapes of one picture; None without any object."""
    return score_scene(picture.index, picture.truth, prediction) if len(picture.truth) else None


def score_scene(index: int, truth: TrueShapes, prediction: Prediction | None) -> SceneScores:
    """The shapes that were predicted for a scene with at least one object; None if nothing could be predicted.

    Args:
        index: number of the scene, from which the random points are drawn.
        truth: what stands there.
        prediction: in the world frame.
    """
    rng = np.random.default_rng(np.random.SeedSequence(index))
    shapes = [] if prediction is None else [item.mesh() for item in prediction.objects]
    scene = compare_shapes(shapes, truth, range(len(truth)), SAMPLES, rng)
    if prediction is None:
        return SceneScores(index, len(truth), 0, 0, scene, ())
    owners = truth.owners(prediction.cloud.points)
    visible = visible_objects(owners, len(truth))
    overlaps = label_overlaps(prediction.cloud_instances, len(shapes), owners, len(truth))
    pairs = [(p, i) for p, i in match(overlaps) if visible[i]]
    instances = tuple(compare_shapes([shapes[p]], truth, [i], INSTANCE_SAMPLES, rng) for p, i in pairs)
    return SceneScores(index, len(truth), int(visible.sum()), len(shapes), scene, instances)


def match(overlaps: Float[np.ndarray, "p i"]) -> list[tuple[int, int]]:
    """Pairs of predicted and true objects, each in one pair at most, with the largest sum of overlaps, none of 0."""
    rows, columns = linear_sum_assignment(overlaps, maximize=True)
    return [(int(p), int(i)) for p, i in zip(rows, columns, strict=True) if overlaps[p, i] > 0]


def compare_shapes(
    predicted: Sequence[trimesh.Trimesh],
    truth: TrueShapes,
    objects: Sequence[int],
    samples: int,
    rng: np.random.Generator,
) -> ShapeScores:
    """The union of predicted meshes against the union of some true objects.

    Args:
        predicted: closed meshes in the world frame [m]; empty ones count as not predicted.
        truth: the scene.
        objects: which of its objects; at least one.
        samples: points on each surface, and in the box.
        rng: source of the points.
    """
    meshes = [mesh for mesh in predicted if len(mesh.faces)]
    true_meshes = [truth.meshes[index] for index in objects]
    overlap = _volume_iou(meshes, truth, objects, samples, rng)
    if not meshes:
        return ShapeScores(overlap)
    ours, theirs = _surface_points(meshes, samples, rng), _surface_points(true_meshes, samples, rng)
    accuracy, completeness = _nearest(ours, theirs), _nearest(theirs, ours)
    return ShapeScores(
        iou=overlap,
        chamfer_l1_mm=500.0 * float(accuracy.mean() + completeness.mean()),
        accuracy_mm=1e3 * float(accuracy.mean()),
        completeness_mm=1e3 * float(completeness.mean()),
        f_score_3mm=_f_score(accuracy, completeness, F_NEAR),
        f_score_10mm=_f_score(accuracy, completeness, F_FAR),
    )


def _volume_iou(
    meshes: Sequence[trimesh.Trimesh],
    truth: TrueShapes,
    objects: Sequence[int],
    samples: int,
    rng: np.random.Generator,
) -> float:
    """IoU [percent] by points in the box around the true objects."""
    bounds = np.array([truth.meshes[index].bounds for index in objects])
    points = rng.uniform(bounds[:, 0].min(axis=0) - ROOM, bounds[:, 1].max(axis=0) + ROOM, (samples, 3))
    depth = np.min([truth.distance(index, points) for index in objects], axis=0)
    ours, theirs = inside_any(meshes, points), depth < 0
    return 100.0 * float((ours & theirs).sum() / max((ours | theirs).sum(), 1))


def inside_any(meshes: Sequence[trimesh.Trimesh], points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, "n"]:
    """Which points are inside of any of some closed meshes, by the parity of ray crossings."""
    inside = np.zeros(len(points), dtype=bool)
    for mesh in meshes:
        lower, upper = mesh.bounds
        near = np.flatnonzero(((points >= lower) & (points <= upper)).all(axis=1) & ~inside)
        if len(near):
            inside[near] = mesh.contains(points[near])
    return inside


def _surface_points(
    meshes: Sequence[trimesh.Trimesh], count: int, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Points drawn evenly from the surfaces of meshes, whether or not they are inside of each other."""
    whole = trimesh.util.concatenate([trimesh.Trimesh(mesh.vertices, mesh.faces, process=False) for mesh in meshes])
    points, *_ = trimesh.sample.sample_surface(whole, count, seed=int(rng.integers(2**31)))
    # Neighbours follow each other, so that the search for the nearest ones stays in the processor's cache.
    return np.asarray(points, dtype=np.float64)[np.lexsort((points // CELL).T)]


def _nearest(points: Float[np.ndarray, "n 3"], others: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "n"]:
    """Distance from each point to the nearest of the others [m]."""
    return KDTree(others, balanced_tree=False, compact_nodes=False).query(points)[0]


def _f_score(accuracy: Float[np.ndarray, "n"], completeness: Float[np.ndarray, "m"], limit: float) -> float:
    """Harmonic mean of the shares of distances below a limit [percent]."""
    precision, recall = float((accuracy < limit).mean()), float((completeness < limit).mean())
    return 200.0 * precision * recall / max(precision + recall, 1e-9)


def summarise(scenes: Sequence[SceneScores]) -> ReconstructionNumbers:
    """The numbers of at least one scene."""
    return ReconstructionNumbers(
        scene=spreads(SHAPE_METRICS, scenes),
        per_instance=spreads(INSTANCE_METRICS, scenes),
        scenes=len(scenes),
        without_shape=sum(each.scene.chamfer_l1_mm is None for each in scenes),
        visible=sum(each.visible for each in scenes),
        matched=sum(len(each.instances) for each in scenes),
        rows=tuple(scenes),
    )


def _shape_metrics(
    shapes: Callable[[SceneScores], Sequence[ShapeScores]],
) -> dict[str, Metric[Sequence[SceneScores]]]:
    """The mean of every field of `ShapeScores` over some shapes of the scenes."""

    def metric(label: str, name: str, form: str) -> Metric[Sequence[SceneScores]]:
        return Metric(
            label, lambda scenes: mean(getattr(shape, name) for each in scenes for shape in shapes(each)), form
        )

    return {
        "iou": metric("IoU, %", "iou", ".1f"),
        "chamfer_l1_mm": metric("Chamfer-L1, mm", "chamfer_l1_mm", ".2f"),
        "accuracy_mm": metric("  accuracy", "accuracy_mm", ".2f"),
        "completeness_mm": metric("  completeness", "completeness_mm", ".2f"),
        "f_score_3mm": metric("F-score 3 mm, %", "f_score_3mm", ".1f"),
        "f_score_10mm": metric("F-score 10 mm, %", "f_score_10mm", ".1f"),
    }


def _of_visible(total: float, scenes: Sequence[SceneScores]) -> float | None:
    """A sum by the number of visible objects."""
    visible = sum(each.visible for each in scenes)
    return total / visible if visible else None


def _found(scenes: Sequence[SceneScores]) -> list[ShapeScores]:
    return [shape for each in scenes for shape in each.instances]


SHAPE_METRICS = _shape_metrics(lambda each: (each.scene,))
"""Of whole scenes."""
INSTANCE_METRICS: dict[str, Metric[Sequence[SceneScores]]] = {
    **_shape_metrics(lambda each: each.instances),
    "iou_of_visible": Metric(
        "IoU, missed = 0, %", lambda some: _of_visible(sum((shape.iou for shape in _found(some)), 0.0), some), ".1f"
    ),
    "found": Metric("found, %", lambda some: _of_visible(100.0 * len(_found(some)), some), ".1f"),
}
"""Of the matched objects; the last two are of all visible ones."""
