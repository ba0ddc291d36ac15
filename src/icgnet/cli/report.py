"""What the command line says about a prediction, and the folder that it writes."""

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

from icgnet.output_folder import output_folder

if TYPE_CHECKING:
    from icgnet.inference.prediction import Prediction

MOST_GRASPS = 10


def with_meshes(prediction: "Prediction") -> "Prediction":
    """The prediction with all meshes extracted, and the time that it took."""
    start = time.perf_counter()
    for item in prediction.objects:
        item.mesh()
    timings = {**prediction.timings_ms, "meshes": 1e3 * (time.perf_counter() - start)}
    return replace(prediction, timings_ms=timings)


def with_median_timings(predictions: Sequence["Prediction"]) -> "Prediction":
    """The last of several predictions of the same input, with the median of each timing."""
    timings = {
        stage: float(np.median([prediction.timings_ms[stage] for prediction in predictions]))
        for stage in predictions[-1].timings_ms
    }
    return replace(predictions[-1], timings_ms=timings)


def write_folder(prediction: "Prediction", out: Path, overwrite: bool, title: str) -> None:
    """Writes the files of a prediction and its picture into a folder that appears whole or not at all."""
    from icgnet.inference.prediction import PICTURE_FILE, RESULT_FILE
    from icgnet.viewer.picture import draw_prediction

    with output_folder(out, RESULT_FILE, overwrite) as folder:
        prediction.write(folder)
        draw_prediction(prediction, folder / PICTURE_FILE, title)


def print_tables(prediction: "Prediction", console: Console, meshes: bool) -> None:
    """Prints the objects, the first grasps, what was rejected and how long it took; with `meshes`, the sizes."""
    from icgnet.viewer.describe import dropped_text

    console.print(_object_table(prediction, meshes))
    console.print(_grasp_table(prediction))
    rejected = ", ".join(
        f"{count} {reason.replace('_', ' ')}" for reason, count in prediction.rejected.items() if count
    )
    console.print(f"rejected: {rejected or 'none'}")
    for item in prediction.objects:
        if not (prediction.grasps.instances == item.instance_id).any():
            reasons = dropped_text(prediction, item.instance_id)
            console.print(f"no grasp on {item.instance_id} {item.class_name}: {reasons}", markup=False, soft_wrap=True)
    left_out = ", ".join(f"{count} {what}" for what, count in prediction.left_out.items() if count)
    if left_out:
        console.print(f"left out: {left_out}")
    timings = ", ".join(f"{stage} {duration:.0f}" for stage, duration in prediction.timings_ms.items())
    console.print(f"timings [ms]: {timings}", markup=False)


def _object_table(prediction: "Prediction", meshes: bool) -> Table:
    table = Table(title=f"{len(prediction.objects)} objects")
    for column in ("id", "score", "class", "points", "size, cm", "grasps", "best grasp"):
        table.add_column(column, justify="left" if column in ("class", "size, cm") else "right", no_wrap=True)
    grasps = prediction.grasps
    for item in prediction.objects:
        own = grasps.scores[grasps.instances == item.instance_id]
        is_known = meshes and not item.mesh().is_empty
        size = " x ".join(f"{100 * edge:.1f}" for edge in item.mesh().extents) if is_known else "-"
        best = f"{own.max():.2f}" if len(own) else "-"
        name = f"{item.class_name} {100 * item.class_score:.0f}%"
        row = (item.instance_id, f"{item.score:.2f}", name, len(item.points), size, len(own), best)
        table.add_row(*map(str, row))
    return table


def _grasp_table(prediction: "Prediction") -> Table:
    grasps = prediction.grasps
    shown = f", the best {MOST_GRASPS}" if len(grasps) > MOST_GRASPS else ""
    table = Table(title=f"{len(grasps)} grasps in the frame {prediction.frame_id!r}{shown}")
    for column in ("score", "object", "width / opening, mm", "position x y z, m", "approach x y z"):
        table.add_column(column, justify="left" if column == "object" else "right")
    for g in range(min(len(grasps), MOST_GRASPS)):
        pose, instance = grasps.poses[g], int(grasps.instances[g])
        table.add_row(
            f"{grasps.scores[g]:.2f}",
            f"{instance} {prediction.class_of(instance)}",
            f"{1e3 * grasps.widths[g]:.0f} / {1e3 * grasps.openings[g]:.0f}",
            _vector(pose[:3, 3], 3),
            _vector(pose[:3, 2], 2),
        )
    return table


def _vector(values: np.ndarray, digits: int) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
