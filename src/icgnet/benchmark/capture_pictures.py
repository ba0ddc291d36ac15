"""Pictures of the benchmark on real frames: every frame, contact sheets by subset, and the worst ones."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from icgnet.benchmark.capture_scores import FrameScores
from icgnet.benchmark.labelled_frames import LabelledFrame
from icgnet.geometry.transforms import invert_transform
from icgnet.grasping.grasps import Grasps
from icgnet.inference.prediction import NO_INSTANCE, Prediction
from icgnet.viewer.capture_sheet import CaptureView, draw_capture
from icgnet.viewer.sheet import draw_sheet

PER_PAGE, COLUMNS = 12, 3
"""Frames on a contact sheet."""
WORST_COLUMNS = 2
SMALL, LARGE = 0.5, 0.75
"""Size of a frame's picture on contact sheets, and among the worst."""
WORST_FILE = "worst.png"


class CapturePictures:
    """Draws frames as they are measured, and sheets of them at the end.

    Args:
        out: folder for frames/NAME.png, sheets/SUBSET_PAGE.png and worst.png.
    """

    def __init__(self, out: Path) -> None:
        self.out = out
        (out / "frames").mkdir(parents=True, exist_ok=True)
        (out / "sheets").mkdir(exist_ok=True)

    def draw(self, frame: LabelledFrame, prediction: Prediction | None, scores: FrameScores) -> None:
        """Draws one frame."""
        clicks = frame.clicks
        view = CaptureView(
            frame.depth,
            frame.intrinsics,
            frame.colour,
            frame.labels,
            () if clicks is None else [item.clicks for item in clicks.objects],
            np.zeros((0, 2), dtype=np.int64) if clicks is None else np.concatenate([clicks.support, clicks.background]),
        )
        instances, grasps = np.full(frame.depth.shape, NO_INSTANCE, dtype=np.int64), Grasps.empty()
        if prediction is not None:
            instances, grasps = prediction.instance_mask, prediction.grasps
        if frame.camera_pose is not None:
            grasps = grasps.transformed(invert_transform(frame.camera_pose))
        path = self._picture(scores)
        path.parent.mkdir(parents=True, exist_ok=True)
        draw_capture(view, instances, grasps).save(path)

    def collect(self, rows: Sequence[FrameScores], gallery: int) -> None:
        """Draws contact sheets of all frames, and the worst ones large with what went wrong below.

        Args:
            rows: frames that have been drawn.
            gallery: how many of the worst; 0 for no such picture.
        """
        for subset in sorted({row.subset for row in rows}):
            own = [row for row in rows if row.subset == subset]
            for page, first in enumerate(range(0, len(own), PER_PAGE), start=1):
                name = f"{re.sub(r'[^A-Za-z0-9_.-]', '_', subset)}_{page}.png"
                self._sheet(own[first : first + PER_PAGE], self.out / "sheets" / name, SMALL, COLUMNS)
        if gallery:
            worst = sorted(rows, key=lambda row: (row.quality, -len(row.kinds) - row.false))[:gallery]
            self._sheet(worst, self.out / WORST_FILE, LARGE, WORST_COLUMNS)

    def _picture(self, scores: FrameScores) -> Path:
        return self.out / "frames" / f"{scores.name}.png"

    def _sheet(self, rows: Sequence[FrameScores], path: Path, size: float, columns: int) -> None:
        images = []
        for row in rows:
            with Image.open(self._picture(row)) as image:
                images.append(image.resize((round(size * image.width), round(size * image.height))))
        captions = [f"{Path(row.name).name}: {row.story()}" for row in rows]
        draw_sheet(images, captions, path, min(columns, len(rows)))
