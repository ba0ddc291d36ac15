"""`icgnet predict`: objects, shapes and grasps from a file."""

import json
import math
import sys
from dataclasses import dataclass, field
from operator import le
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console

from icgnet.cli.notices import print_notice
from icgnet.cli.predictor_options import PredictorOptions
from icgnet.cli.report import print_tables, with_median_timings, with_meshes, write_folder
from icgnet.errors import InputError
from icgnet.files import write_text
from icgnet.output_folder import check_replaceable
from icgnet.settings import check_range

if TYPE_CHECKING:
    from icgnet.inference.prediction import Prediction

DEFAULT_OUT = Path("prediction")
STDOUT = "-"


@dataclass(frozen=True)
class Predict:
    """Find objects and grasps in a depth image or a cloud.

    INPUT is a depth image (png, tif, npy) with --intrinsics, an npz with `depth` and `K`, or a cloud (ply, npy, npz,
    xyz). Without a camera pose or a table height the table is found, and results are in the camera's frame.
    """

    input: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="INPUT")]
    """Depth image or cloud."""
    out: Path | None = None
    """Folder for result.json, grasps.npz, meshes and picture.png ('prediction' unless --json is given)."""
    json: str | None = None
    """File for the JSON result; '-' prints it, and nothing else, to stdout."""
    intrinsics: tuple[str, ...] = ()
    """fx fy cx cy [pixels], or a JSON, YAML, npz or mat file with the camera matrix."""
    depth_scale: float = 1.0
    """Depth units per metre: 1000 for millimetres."""
    camera_pose: tuple[str, ...] = ()
    """T_world_camera (OpenCV axes, world z up): a file with the 4x4 matrix, its 16 numbers row by row, or the 7 numbers
    x y z [m] qw qx qy qz."""
    frame: str = "world"
    """How the world is called in the result."""
    viewpoint: tuple[float, float, float] | None = None
    """Where the camera stood, in the frame of the cloud [m]."""
    table_height: float | None = None
    """Height of the table plane in the world [m]; found in the input if not given."""
    level_table: bool = False
    """Multiply the depth with what brings the table to --table-height: for cameras whose depth scale drifts."""
    mask: Path | None = None
    """Image of the size of the depth image: objects are looked for where it is not 0."""
    object_class: str | None = None
    """Grasps of objects of this class only."""
    instance: int | None = None
    """Grasps of this object only."""
    region: tuple[float, float, float, float, float, float] | None = None
    """Grasps in this box only: x y z of its lower, then of its upper corner [m]."""
    overwrite: bool = False
    """Replace the output folder even if it is no earlier prediction."""
    repeat: int = 1
    """Predict so many times and report the median of each timing."""
    predictor: Annotated[PredictorOptions, tyro.conf.arg(name="")] = field(default_factory=PredictorOptions)

    def run(self) -> None:
        """Predicts, writes and reports.

        Raises:
            IcgnetError: for everything that the caller can mend.
        """
        out = self.out or (None if self.json else DEFAULT_OUT)
        if out is not None:
            check_replaceable(out, "result.json", self.overwrite)
        check_range(self, 1.0, "repeat")
        if self.table_height is not None and not math.isfinite(self.table_height):
            raise InputError(f"table_height must be a finite number [m], got {self.table_height}")
        if self.region is not None and not all(map(le, self.region[:3], self.region[3:])):
            raise InputError(f"region must have lower <= upper, got {self.region[:3]} and {self.region[3:]}")
        if self.json not in (None, STDOUT) and not Path(self.json).parent.is_dir():
            raise InputError(f"cannot write {self.json}: there is no folder {Path(self.json).parent}")
        self.predictor.check(self.object_class)
        result = self._choose(self._predict(meshes=out is not None))
        if out is not None:
            write_folder(result, out, self.overwrite, self.input.name)
        self._report(result, out)

    def _predict(self, meshes: bool) -> "Prediction":
        from icgnet.inference.capture import DepthCapture, read_capture, read_mask

        capture = read_capture(self.input, self.intrinsics, self.depth_scale, self.camera_pose, self.viewpoint)
        mask = None if self.mask is None else read_mask(self.mask)
        for name, given in (("mask", mask is not None), ("level-table", self.level_table)):
            if given and not isinstance(capture, DepthCapture):
                raise InputError(f"{self.input} is a cloud: --{name} is for depth images")

        predictor = self.predictor.load()  # after everything that needs no torch has been checked

        def predict_once() -> "Prediction":
            if isinstance(capture, DepthCapture):
                given = (capture.depth, capture.intrinsics, capture.camera_pose, self.table_height, mask)
                return predictor.predict_depth(*given, level_table=self.level_table, frame_id=self.frame)
            return predictor.predict_cloud(capture.points, capture.viewpoint, self.table_height, self.frame)

        finish = with_meshes if meshes else lambda prediction: prediction
        return with_median_timings([finish(predict_once()) for _ in range(self.repeat)])

    def _choose(self, result: "Prediction") -> "Prediction":
        """The prediction with the grasps that were asked for."""
        if self.object_class is not None:
            seen = sorted({item.class_name for item in result.objects})
            if self.object_class not in seen:
                print_notice(f"no {self.object_class} is seen, but {', '.join(seen) or 'no object at all'}")
            result = result.of_class(self.object_class)
        if self.instance is not None:
            result = result.of_instance(self.instance)
        if self.region is not None:
            import numpy as np

            result = result.in_region(np.array(self.region[:3]), np.array(self.region[3:]))
        return result

    def _report(self, result: "Prediction", out: Path | None) -> None:
        for warning in result.warnings:
            print_notice(warning)
        if self.json is not None:
            text = json.dumps(result.to_dict(meshes=out is not None), indent=1)
            if self.json == STDOUT:
                sys.stdout.write(text + "\n")
                return
            write_text(Path(self.json), text + "\n")
        console = Console()
        print_tables(result, console, meshes=out is not None)
        if out is not None:
            console.print(f"written to {out}; look at {out / 'picture.png'}, or run: icgnet view {out}", soft_wrap=True)
