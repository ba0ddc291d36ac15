"""`icgnet pick`: a plan for an arm."""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro
from rich.console import Console
from rich.table import Table

from icgnet.arm.settings import PickSettings
from icgnet.cli.notices import print_notice
from icgnet.cli.view import View
from icgnet.errors import InputError
from icgnet.output_folder import check_replaceable, output_folder

if TYPE_CHECKING:
    from icgnet.arm.arm import Arm
    from icgnet.arm.hand_eye import HandEye
    from icgnet.arm.plan import Phase, PickPlan
    from icgnet.inference.prediction import Prediction

PICTURE_FILE = "picture.png"
COLUMNS = 3


@dataclass(frozen=True)
class Pick:
    """Plan how an arm picks an object up, carries it and lets go of it.

    INPUT is a depth image (png, tif, npy) with --intrinsics, an npz with `depth` and `K`, or the folder of an earlier
    `icgnet predict`. Needs the packages of icgnet[arm].
    """

    input: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="INPUT")]
    """Depth image, or folder of a saved prediction."""
    drop: tuple[float, float, float]
    """Where the object is let go of: its lowest point, x y z in the world [m]."""
    hand_eye: Path | None = None
    """YAML or JSON file with T_base_camera, or with T_tool_camera, as `icgnet calibrate-camera` writes; needed unless
    INPUT is a saved prediction in the world."""
    joints: tuple[float, ...] = ()
    """Joint positions when the picture was taken [rad], with a camera on the arm; those of the hand-eye file if not
    given."""
    arm: str = "fr3"
    """Name of an arm or an arm file."""
    object_class: str | None = None
    """Pick an object of this class."""
    instance: int | None = None
    """Pick this object of a saved prediction."""
    start: tuple[float, ...] = ()
    """Joint positions from which the arm starts and to which it returns [rad]; its home if not given."""
    out: Path = Path("pick")
    """Folder for plan.json, plan.npz, motion.npz and picture.png."""
    view: bool = False
    """Show the pick in the browser at the end; `icgnet view` does so later."""
    intrinsics: tuple[str, ...] = ()
    """fx fy cx cy [pixels], or a JSON, YAML, npz or mat file with the camera matrix."""
    depth_scale: float = 1.0
    """Depth units per metre: 1000 for millimetres."""
    table_height: float | None = None
    """Height of the table plane in the world [m]; found in the image if not given."""
    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    gripper: str | None = None
    """Name of a gripper or a gripper file: the hand on the arm; that of the weights if not given."""
    threads: int | None = None
    """CPU threads of the network."""
    overwrite: bool = False
    """Replace the output folder even if it is no earlier plan."""
    settings: Annotated[PickSettings, tyro.conf.arg(name="")] = field(default_factory=PickSettings)

    def run(self) -> None:
        """Predicts, plans, writes and reports.

        Raises:
            IcgnetError: for everything that the caller can mend; also when no grasp can be carried out.
        """
        check_replaceable(self.out, "plan.json", self.overwrite)
        if not all(map(math.isfinite, self.drop)):
            raise InputError(f"drop must be three finite numbers [m], got {self.drop}")
        import numpy as np

        from icgnet.arm.arm import Arm
        from icgnet.arm.hand_eye import HandEye
        from icgnet.arm.pick import plan_pick
        from icgnet.geometry.transforms import invert_transform, transform_points

        arm = Arm.load(self.arm)
        hand_eye = None if self.hand_eye is None else HandEye.read(self.hand_eye)
        if self.joints:
            if hand_eye is None or hand_eye.T_tool_camera is None:
                raise InputError("--joints is for a camera on the arm: give --hand-eye with T_tool_camera")
            hand_eye = replace(hand_eye, joints=np.array(self.joints))
        prediction, T_base_frame = self._prediction(arm, hand_eye)
        T_base_world = invert_transform(arm.description.T_world_base)
        drop = transform_points(T_base_world, np.array(self.drop))
        plan = plan_pick(self._chosen(prediction), arm, T_base_frame, drop, self.settings, self.start or None)
        self._write(plan, arm)
        console = Console()
        print_plan(plan, prediction, console)
        if not plan.is_found:
            raise InputError(_why_not(plan, len(self._chosen(prediction).grasps)))
        console.print(f"written to {self.out}; look at {self.out / PICTURE_FILE}", soft_wrap=True)
        if self.view:
            View(self.out).run()

    def _prediction(self, arm: "Arm", hand_eye: "HandEye | None") -> tuple["Prediction", object]:
        """What is seen, and the pose of its frame in that of the base."""
        from icgnet.geometry.transforms import invert_transform
        from icgnet.inference.prediction import Prediction

        T_world_base = arm.description.T_world_base
        if self.input.is_dir():
            prediction = Prediction.load(self.input)
            if prediction.frame_id != "camera":
                return prediction, invert_transform(T_world_base)
            if hand_eye is None:
                raise InputError(f"{self.input} is in the frame of the camera: give --hand-eye")
            return prediction, hand_eye.pose(arm)
        if hand_eye is None:
            raise InputError("a depth image needs --hand-eye, which says where the camera is")
        from icgnet.inference.capture import DepthCapture, read_capture

        capture = read_capture(self.input, self.intrinsics, self.depth_scale)
        if not isinstance(capture, DepthCapture):
            raise InputError(f"{self.input} is a cloud: pick takes a depth image or the folder of a prediction")
        from icgnet.predictor import Predictor

        predictor = Predictor.load(self.weights, self.threads, self.gripper)
        pose = T_world_base @ hand_eye.pose(arm)
        prediction = predictor.predict_depth(capture.depth, capture.intrinsics, pose, self.table_height)
        return prediction, invert_transform(T_world_base)

    def _chosen(self, prediction: "Prediction") -> "Prediction":
        """The prediction with the grasps that were asked for."""
        if self.object_class is not None:
            prediction = prediction.of_class(self.object_class)
        return prediction if self.instance is None else prediction.of_instance(self.instance)

    def _write(self, plan: "PickPlan", arm: "Arm") -> None:
        from icgnet.arm.animation import motion_of
        from icgnet.arm.motion import MOTION_FILE
        from icgnet.viewer.pick_picture import pick_panels
        from icgnet.viewer.sheet import draw_sheet

        with output_folder(self.out, "plan.json", self.overwrite) as folder:
            plan.write(folder)
            if plan.is_found:
                motion_of(plan, arm).write(folder / MOTION_FILE)
                panels = pick_panels(plan, arm)
                draw_sheet(list(panels.values()), list(panels), folder / PICTURE_FILE, COLUMNS)


def print_plan(plan: "PickPlan", prediction: "Prediction", console: Console) -> None:
    """Prints the phases, what was refused and how long planning took."""
    for warning in prediction.warnings:
        print_notice(warning)
    if plan.instance is not None:
        name = prediction.class_of(plan.instance)
        measured = any(phase.clearance is not None for phase in plan.phases)
        columns = ("phase", "time [s]", "fingers [mm]", *(("least clearance", "nearest") if measured else ()))
        table = Table(*columns, title=f"object {plan.instance}, {name}")
        for phase in plan.phases:
            row = (phase.name, f"{phase.trajectory.duration:.2f}", f"{1e3 * phase.opening:.0f}")
            table.add_row(*row, *(_clearance(phase) if measured else ()))
        table.add_row("all", f"{plan.duration:.2f}")
        console.print(table)
    refused = ", ".join(f"{count} {reason}" for reason, count in plan.refused.items())
    console.print(f"refused grasps: {refused or 'none'}", soft_wrap=True, markup=False)
    timings = ", ".join(f"{stage} {duration:.0f}" for stage, duration in plan.timings_ms.items())
    console.print(f"time of planning [ms]: {timings}", soft_wrap=True, markup=False)


def _clearance(phase: "Phase") -> tuple[str, str]:
    """How near anything comes in a phase, and what to what."""
    near, clearance = phase.nearest, phase.clearance or 0.0
    if near is None:
        return f"over {1e3 * clearance:.0f} mm", ""
    return f"{1e3 * clearance:.1f} mm", f"{near.part}, {near.body}"


def _why_not(plan: "PickPlan", grasps: int) -> str:
    if not grasps:
        return "there is no grasp to plan for"
    reasons = ", ".join(f"{count} {reason}" for reason, count in plan.refused.items())
    return f"none of the {len(plan.refusals)} grasps that were tried can be carried out: {reasons}"
