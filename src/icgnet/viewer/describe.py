"""What pictures and the web viewer say about a prediction."""

import numpy as np
from jaxtyping import Float

from icgnet.geometry.transforms import transform_points
from icgnet.grasping.grasps import Grasps
from icgnet.prediction import DetectedObject, Prediction

SEPARATOR = "  \u00b7  "


def summary(prediction: Prediction) -> str:
    """Numbers of objects and grasps, and the time they took, in one line."""
    objects, grasps = len(prediction.objects), len(prediction.grasps)
    parts = [f"{objects} object{'s' * (objects != 1)}", f"{grasps} grasp{'s' * (grasps != 1)}"]
    timings = prediction.timings_ms
    if timings:
        parts.append(f"{timings.get('total', sum(timings.values())):.0f} ms")
    return SEPARATOR.join(parts)


def object_name(item: DetectedObject) -> str:
    """Number, class and how sure the class is."""
    return f"{item.instance_id}  {item.class_name}  {100 * item.class_score:.0f}%"


def object_top(item: DetectedObject, T_table_frame: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "3"]:
    """The point over the middle of an object's points, as high as the highest of them; table frame [m]."""
    points = transform_points(T_table_frame, item.points)
    return np.array([*np.median(points[:, :2], axis=0), points[:, 2].max()])


def best_per_object(grasps: Grasps, count: int) -> Grasps:
    """At most `count` grasps of each object, best first over all."""
    ranked = grasps.sorted()
    rank = np.array([np.sum(ranked.instances[:g] == ranked.instances[g]) for g in range(len(ranked))], dtype=np.int64)
    return ranked.select(rank < count)
