"""`icgnet demo`: the predictor on a capture that ships with the package."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from icgnet.cli.report import print_tables, with_meshes, write_folder
from icgnet.errors import DataError
from icgnet.output_folder import check_replaceable

CAPTURE = Path(__file__).parent.parent / "captures" / "demo.npz"


@dataclass(frozen=True)
class Demo:
    """Find objects and grasps in the depth image that ships with the package."""

    out: Path = Path("demo_output")
    """Folder for result.json, grasps.npz, meshes and picture.png."""
    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    threads: int | None = None
    """CPU threads."""
    overwrite: bool = False
    """Replace the output folder even if it is no earlier prediction."""

    def run(self) -> None:
        """Predicts, writes and reports.

        Raises:
            IcgnetError: the installation is not complete, or something is in the way.
        """
        check_replaceable(self.out, "result.json", self.overwrite)
        if not CAPTURE.is_file():
            raise DataError(f"this installation has no demo capture ({CAPTURE} is missing)")
        from icgnet.inference.capture import DepthCapture, read_capture
        from icgnet.predictor import Predictor

        predictor = Predictor.load(self.weights, self.threads)
        capture = read_capture(CAPTURE)
        if not isinstance(capture, DepthCapture):
            raise DataError(f"{CAPTURE} is not a depth capture")
        result = with_meshes(predictor.predict_depth(capture.depth, capture.intrinsics, capture.camera_pose))
        write_folder(result, self.out, self.overwrite, "demo")
        console = Console()
        print_tables(result, console, meshes=True)
        console.print(f"written to {self.out}: look at {self.out / 'picture.png'}", soft_wrap=True)
        console.print(f"to turn it around in the browser, run: icgnet view {self.out}", soft_wrap=True)
