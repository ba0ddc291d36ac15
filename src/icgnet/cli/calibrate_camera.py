"""`icgnet calibrate-camera`: where a camera is, from pictures of a printed board."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro
from rich.console import Console
from rich.table import Table

from icgnet.camera_calibration.settings import BoardLayout, Setup
from icgnet.cli.notices import print_notice
from icgnet.errors import InputError

if TYPE_CHECKING:
    from icgnet.camera_calibration.calibrate import Calibration, Lens


@dataclass(frozen=True)
class CalibrateCamera:
    """Find where a camera is, on an arm or beside it, from pictures of a printed board, or print the board.

    IMAGES is a folder of pictures, --poses says where the arm was at each. Writes the file that `icgnet pick
    --hand-eye` takes. Needs the package of icgnet[calibrate].
    """

    images: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="IMAGES")] = None
    """Folder of pictures of the board."""
    poses: Path | None = None
    """YAML, JSON or CSV file: for every picture the pose of the link that carries the hand, or the arm's joints."""
    setup: Setup = "eye-in-hand"
    """The camera is on the arm and the board stands, or it is beside the arm and the hand holds the board."""
    out: Path = Path("hand_eye.yaml")
    """Hand-eye file to write, YAML or JSON."""
    intrinsics: tuple[str, ...] = ()
    """fx fy cx cy [pixels], or a file with the camera matrix, and perhaps the distortion; estimated from the pictures
    if not given."""
    distortion: tuple[str, ...] = ()
    """k1 k2 p1 p2 [k3 ...] as OpenCV orders them, or a file; of the file of --intrinsics, or 0, if not given."""
    arm: str | None = None
    """Name of an arm or an arm file, for poses that are given as joints (needs icgnet[arm])."""
    print_board: Path | None = None
    """Write the board to this PNG or PDF file, in its true size, and do nothing else."""
    board: Annotated[BoardLayout, tyro.conf.arg(name="")] = field(default_factory=BoardLayout)

    def run(self) -> None:
        """Prints the board, or calibrates and reports.

        Raises:
            IcgnetError: for everything that the caller can mend.
        """
        from icgnet.camera_calibration.board import Board

        board, console = Board(self.board), Console()
        if self.print_board is not None:
            if self.images is not None:
                raise InputError("--print-board prints and calibrates nothing: leave IMAGES out")
            paper = board.print_to(self.print_board)
            console.print(f"{self.print_board}: {paper}; print at 100 % and measure the bar", soft_wrap=True)
            return
        if self.images is None or self.poses is None:
            raise InputError("give IMAGES, a folder of pictures, and --poses; or --print-board FILE")
        from icgnet.arm.hand_eye import SUFFIXES, HandEye
        from icgnet.camera_calibration.calibrate import calibrate
        from icgnet.camera_calibration.pictures import picture_names, read_grey
        from icgnet.camera_calibration.poses import read_poses

        if self.out.suffix.lower() not in SUFFIXES:
            raise InputError(f"a hand-eye file ends in {', '.join(SUFFIXES)}, got {self.out.name!r}")
        lens = self._lens()
        names = picture_names(self.images)
        poses = read_poses(self.poses, self._from_joints())
        missing = [name for name in poses if name not in names]
        if missing:
            raise InputError(
                f"{self.poses}: {self.images} holds no picture {missing[0]!r} ({len(missing)} are missing)"
            )
        found = calibrate(
            {name: read_grey(self.images / name) for name in names if name in poses}, poses, board, self.setup, lens
        )
        without = [name for name in names if name not in poses]
        notes = summary(found)
        if self.setup == "eye-in-hand":
            hand_eye = HandEye(T_tool_camera=found.pose)
        else:
            hand_eye = HandEye(T_base_camera=found.pose)
        console.print(residual_table(found))
        for note in notes:
            console.print(note, soft_wrap=True, markup=False, highlight=False)
        if without:
            print_notice(f"{len(without)} pictures without a pose were not used: {', '.join(without)}")
        if any(each.pixels is None for each in found.residuals):
            print_notice("pictures in which the board was not found were not used")
        if any(each.stands_out for each in found.residuals):
            print_notice(
                "the marked pictures fit much worse than the others, and were used: look at them and their poses"
            )
        hand_eye.write(self.out, notes)
        console.print(f"written to {self.out}", soft_wrap=True)

    def _lens(self) -> "Lens | None":
        from icgnet.camera_calibration.calibrate import make_lens
        from icgnet.inference.capture import read_distortion, read_intrinsics

        if not self.intrinsics:
            if self.distortion:
                raise InputError("--distortion needs --intrinsics: without it both are estimated from the pictures")
            return None
        of_file = self.intrinsics if len(self.intrinsics) == 1 else ()
        source: Sequence[str] = self.distortion or of_file
        return make_lens(read_intrinsics(self.intrinsics), read_distortion(source) if source else ())

    def _from_joints(self) -> Any:
        """What makes a pose of joint positions; None without an arm."""
        if self.arm is None:
            return None
        from icgnet.arm.arm import Arm

        arm = Arm.load(self.arm)
        return lambda joints: arm.mount_pose(arm.check_joints(joints, "joints"))


def residual_table(found: "Calibration") -> Table:
    """One row for every picture."""
    table = Table("picture", "corners", "corners off [px]", "board off [mm]", "[degrees]", "", title=found.setup)
    for each in found.residuals:
        if each.pixels is None:
            table.add_row(each.name, str(each.corners), "", "", "", "board not found")
        else:
            values = (f"{each.pixels:.2f}", f"{each.millimetres:.2f}", f"{each.degrees:.3f}")
            table.add_row(each.name, str(each.corners), *values, "stands out" if each.stands_out else "")
    return table


def summary(found: "Calibration") -> list[str]:
    """The result in a few lines."""
    import numpy as np

    all_off = [(each.millimetres, each.degrees) for each in found.residuals if each.pixels is not None]
    millimetres, degrees = np.array(all_off, float).T
    name = "T_tool_camera" if found.setup == "eye-in-hand" else "T_base_camera"
    x, y, z = 1e3 * found.pose[:3, 3]
    matrix = found.lens.intrinsics
    lens = f"fx fy cx cy = {matrix[0, 0]:.1f} {matrix[1, 1]:.1f} {matrix[0, 2]:.1f} {matrix[1, 2]:.1f}"
    if found.lens_error is not None:
        numbers = " ".join(f"{value:.4f}" for value in found.lens.distortion)
        lens += f", distortion {numbers}, estimated from these pictures ({found.lens_error:.2f} px left)"
    return [
        f"{name}: x y z = {x:.1f} {y:.1f} {z:.1f} mm, standard error {found.error_mm:.2f} mm and "
        f"{found.error_deg:.3f} degrees (jackknife)",
        f"{len(all_off)} of {len(found.residuals)} pictures; the board's pose differs from their mean by "
        f"{millimetres.mean():.2f} mm and {degrees.mean():.3f} degrees, at most {millimetres.max():.2f} mm and "
        f"{degrees.max():.3f} degrees",
        lens,
    ]
