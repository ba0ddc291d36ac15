"""`icgnet demo`: the predictor on the captures that ship with the package."""

from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from icgnet.cli.report import print_tables, with_meshes, write_folder
from icgnet.errors import DataError
from icgnet.output_folder import check_replaceable

FOLDER = Path(__file__).parent.parent / "captures"
CAPTURES = {"demo": "", "table": "_table"}
"""Names of the captures, and what is put behind the name of the output folder."""


@dataclass(frozen=True)
class Demo:
    """Find objects and grasps in the depth images that ship with the package: of a workspace and of a whole table."""

    out: Path = Path("demo_output")
    """Folder for result.json, grasps.npz, meshes and picture.png; that of the table has "_table" behind its name."""
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
        folders = {FOLDER / f"{name}.npz": self.out.with_name(self.out.name + end) for name, end in CAPTURES.items()}
        for capture, out in folders.items():
            check_replaceable(out, "result.json", self.overwrite)
            if not capture.is_file():
                raise DataError(f"this installation has no demo capture ({capture} is missing)")
        from icgnet.inference.capture import DepthCapture, read_capture
        from icgnet.predictor import Predictor

        predictor = Predictor.load(self.weights, self.threads)
        console = Console()
        for path, out in folders.items():
            capture = read_capture(path)
            if not isinstance(capture, DepthCapture):
                raise DataError(f"{path} is not a depth capture")
            result = with_meshes(predictor.predict_depth(capture.depth, capture.intrinsics, capture.camera_pose))
            write_folder(result, out, self.overwrite, path.stem)
            print_tables(result, console, meshes=True)
            console.print(f"written to {out}: look at {out / 'picture.png'}", soft_wrap=True)
        for out in folders.values():
            console.print(f"to turn it around in the browser, run: icgnet view {out}", soft_wrap=True)
