"""What pictures and the web viewer say about a prediction."""

import numpy as np
from jaxtyping import Float, Int

from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.workspace import above_table
from icgnet.grasping.grasps import Grasps
from icgnet.inference.prediction import NO_INSTANCE, DetectedObject, Prediction

SEPARATOR = "  \u00b7  "
SURROUNDINGS = 0.10
"""Points that belong to no object are shown up to this far from the objects [m]."""


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
