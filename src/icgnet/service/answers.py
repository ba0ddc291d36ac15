"""What a request is answered with: JSON, an npz with the meshes, or a table of the grasps."""

import csv
import io
import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from icgnet.files import finite
from icgnet.inference.prediction import Prediction

MEDIA = {"json": "application/json", "npz": "application/x-npz", "csv": "text/csv; charset=utf-8"}
COLUMNS = (
    *("score", "width", "opening", "instance_id"),
    *(f"m{row}{column}" for row in range(4) for column in range(4)),
    "class_name",
)
"""Of the table: the numbers first, the pose row by row, and last the one text."""


def json_bytes(values: Mapping[str, Any]) -> bytes:
    """Values as JSON, in which null stands for numbers that are not finite."""
    return json.dumps(finite(values), allow_nan=False).encode()


def answer_bytes(prediction: Prediction, kind: str, service: Mapping[str, Any]) -> bytes:
    """A prediction in one of the forms of `MEDIA`.

    Args:
        prediction: what was found.
        kind: json, npz or csv.
        service: what the service adds to the entries of `result.json`, under `service`.
    """
    if kind == "csv":
        return _table(prediction)
    result = json_bytes({**prediction.to_dict(), "service": service})
    return result if kind == "json" else _archive(prediction, result)


def _table(prediction: Prediction) -> bytes:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for entry in prediction.to_dict()["grasps"]:
        pose = [number for row in entry["pose"] for number in row]
        writer.writerow([*(entry[name] for name in COLUMNS[:4]), *pose, entry["class_name"]])
    return text.getvalue().encode()


def _archive(prediction: Prediction, result: bytes) -> bytes:
    """The result as text, the instance of every input point or pixel, and the mesh of each object."""
    arrays: dict[str, Any] = {
        "result": np.frombuffer(result, np.uint8),
        "instance_mask": prediction.instance_mask.astype(np.int16),
    }
    for item in prediction.objects:
        mesh = item.mesh()
        arrays[f"vertices_{item.instance_id}"] = np.asarray(mesh.vertices, dtype=np.float32)
        arrays[f"faces_{item.instance_id}"] = np.asarray(mesh.faces, dtype=np.int32)
    content = io.BytesIO()
    np.savez_compressed(content, **arrays)
    return content.getvalue()
