"""Frames of three boxes on a table whose labels are known, as objects and as files."""

import json
from pathlib import Path

import numpy as np
from PIL import Image

from icgnet.benchmark.labelled_frames import ClickedObject, Clicks, LabelledFrame
from icgnet.geometry.transforms import invert_transform
from tabletop_scenes import INTRINSICS, THREE_BOXES, camera_pose, depth_image

POSE = camera_pose()
DEPTH = depth_image(THREE_BOXES, POSE)
EMPTY = depth_image((), POSE)
LABELS = np.zeros(DEPTH.shape, dtype=np.int64)
for number, box in enumerate(THREE_BOXES):
    LABELS[(depth_image((box,), POSE) == DEPTH) & (DEPTH < EMPTY)] = number + 1
T_CAMERA_TABLE = invert_transform(POSE)
"""Pose of the true table frame."""


def pixels_on(label: int, count: int) -> np.ndarray:
    """Pixels (u, v) all over what has a label."""
    v, u = np.nonzero(label == LABELS)
    return np.stack([u, v], axis=1)[np.linspace(0, len(u) - 1, count).astype(int)]


def clicks(classes: tuple[str | None, ...] = ("box", "box", "box"), uncertain: bool = False) -> Clicks:
    """Ten clicks on each box, all graspable but the last, and on the table."""
    objects = tuple(ClickedObject(pixels_on(k + 1, 10), name, k < 2) for k, name in enumerate(classes))
    return Clicks(objects, pixels_on(0, 12), np.zeros((0, 2), dtype=np.int64), uncertain)


def frame(with_clicks: Clicks | None = None, posed: bool = False) -> LabelledFrame:
    """The frame with label image, or with these clicks."""
    depth = np.where(DEPTH > 0, DEPTH, np.nan)
    labels = LABELS if with_clicks is None else None
    return LabelledFrame("boxes", "tests", depth, INTRINSICS, POSE if posed else None, labels, with_clicks)


def write_frame(folder: Path, name: str, labelled: bool) -> None:
    """The frame as files: depth in 0.1 mm and labels, or a posed npz and clicks."""
    folder.mkdir(parents=True, exist_ok=True)
    if labelled:
        Image.fromarray(np.round(1e4 * DEPTH).astype(np.uint16)).save(folder / f"{name}_depth.png")
        Image.fromarray(LABELS.astype(np.uint8)).save(folder / f"{name}_labels.png")
        (folder / f"{name}.json").write_text(json.dumps({"K": INTRINSICS.ravel().tolist(), "depth_scale": 10000}))
        return
    np.savez(folder / f"{name}.npz", depth=DEPTH, K=INTRINSICS, camera_pose=POSE)
    objects = [{"class": "box", "graspable": True, "clicks": pixels_on(k, 5).tolist()} for k in (1, 2, 3)]
    content = {"objects": objects, "support": pixels_on(0, 12).tolist(), "background": []}
    (folder / f"{name}_clicks.json").write_text(json.dumps(content))
