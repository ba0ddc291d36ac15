"""What pictures and the web viewer say about a prediction."""

import numpy as np
from jaxtyping import Float, Int

from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.workspace import above_table
from icgnet.grasping.grasps import Grasps
from icgnet.inference.prediction import NO_INSTANCE, DetectedObject, Prediction
from icgnet.inference.rejections import COLLISIONS, LOW_SCORE, REASONS, TOO_WIDE, UNCHECKED

SEPARATOR = "  \u00b7  "
SURROUNDINGS = 0.10
"""Points that belong to no object are shown up to this far from the objects [m]."""

REASON_WORDS = {
    LOW_SCORE: "low score",
    TOO_WIDE: "too wide for the hand",
    "table": "would hit the table",
    "object": "would hit a shape",
    "points": "would hit measured points",
    UNCHECKED: "not checked",
}
"""How the reasons are called for which grasps are dropped."""
NOT_ASKED_FOR = "not asked for"
"""Of the grasps of objects that were left out by a choice of object, class or region."""
STAGES = (COLLISIONS, (UNCHECKED,), (TOO_WIDE,), (LOW_SCORE,))
"""The reasons, those first whose grasps came farthest: what is believed in and fits the hand is checked last."""


def summary(prediction: Prediction) -> str:
    """Numbers of objects and grasps, and the time they took, in one line."""
    objects, grasps = len(prediction.objects), len(prediction.grasps)
    parts = [f"{objects} object{'s' * (objects != 1)}", f"{grasps} grasp{'s' * (grasps != 1)}"]
    # Meshes are only extracted to be looked at; grasps do not wait for them.
    timings = [duration for stage, duration in prediction.timings_ms.items() if stage != "meshes"]
    if timings:
        parts.append(f"{sum(timings):.0f} ms")
    return SEPARATOR.join(parts)


def object_name(item: DetectedObject) -> str:
    """Number, class and how sure the class is."""
    return f"{item.instance_id}  {item.class_name}  {100 * item.class_score:.0f}%"


def object_top(item: DetectedObject, T_table_frame: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"]:
    """The point over the middle of an object's points, as high as the highest of them; table frame [m]."""
    points = transform_points(T_table_frame, item.points)
    return np.array([*np.median(points[:, :2], axis=0), points[:, 2].max()])


def points_on_table(prediction: Prediction, most: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "n"]]:
    """The measured points above the table, table frame [m], and their instances.

    Only those of the objects and around them; thinned out evenly where there are more than `most`.
    """
    points = transform_points(invert_transform(prediction.T_frame_table), prediction.cloud.points)
    shown = above_table(points)
    found = prediction.cloud_instances != NO_INSTANCE
    if found.any():
        lower, upper = points[found].min(axis=0) - SURROUNDINGS, points[found].max(axis=0) + SURROUNDINGS
        shown &= ((points >= lower) & (points <= upper)).all(axis=1)
    rows = np.flatnonzero(shown | found)
    rows = rows[:: max(1, -(-len(rows) // most))]
    return points[rows], prediction.cloud_instances[rows]


def best_per_object(grasps: Grasps, count: int) -> Grasps:
    """At most `count` grasps of each object, best first over all."""
    ranked = grasps.sorted()
    rank = np.array([np.sum(ranked.instances[:g] == ranked.instances[g]) for g in range(len(ranked))], dtype=np.int64)
    return ranked.select(rank < count)


def dropped_text(prediction: Prediction, instance_id: int) -> str:
    """Why candidates of an object were dropped, and the best score of each reason; those that came farthest first."""
    counts = prediction.rejections.of_object(instance_id)
    if not counts:
        return "reasons were not saved for each object; predict again"
    told = [_counted_reason(prediction, instance_id, reason) for stage in STAGES for reason in stage if counts[reason]]
    has_grasps = (prediction.grasps.instances == instance_id).any()
    return ", ".join(told) or ("nothing" if has_grasps else NOT_ASKED_FOR)


def main_reason(prediction: Prediction, instance_id: int) -> str:
    """What was most often in the way of the grasps of an object that came farthest; empty if that is not known."""
    counts = prediction.rejections.of_object(instance_id)
    if not counts:
        return ""
    for reasons in STAGES:
        most = max(reasons, key=lambda reason: counts[reason])
        if counts[most]:
            best = _best_dropped(prediction, instance_id, most)
            return REASON_WORDS[most] + ("" if best is None or most != LOW_SCORE else f", best {best:.2f}")
    return NOT_ASKED_FOR


def _counted_reason(prediction: Prediction, instance_id: int, reason: str) -> str:
    best = _best_dropped(prediction, instance_id, reason)
    count = prediction.rejections.of_object(instance_id)[reason]
    return f"{count} {REASON_WORDS[reason]}" + ("" if best is None else f" (best {best:.2f})")


def _best_dropped(prediction: Prediction, instance_id: int, reason: str) -> float | None:
    """The best score among the grasps that were dropped for a reason; None if none of them was kept."""
    dropped = prediction.rejections
    own = (dropped.grasps.instances == instance_id) & (dropped.reasons == REASONS.index(reason))
    return float(dropped.grasps.scores[own].max()) if own.any() else None
