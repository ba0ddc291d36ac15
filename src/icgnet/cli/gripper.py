"""`icgnet gripper check`: whether a gripper file describes a hand, and what hand."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro
from rich.console import Console
from rich.table import Table

from icgnet.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from icgnet.grasping.gripper import Box
    from icgnet.grasping.gripper import Gripper as Hand


@dataclass(frozen=True)
class CheckGripper:
    """Check a gripper file, print the measures of the hand, draw it."""

    gripper: tyro.conf.Positional[str]
    """Gripper file, or the name of a gripper that ships with the package."""
    out: Path | None = None
    """Picture of the hand open, closed and on a cup, ending in .png."""

    def run(self) -> None:
        """Prints the measures of the hand, and draws it.

        Raises:
            DataError: the file does not describe a hand; the message names the entry, its value and what is valid.
            InputError: a name for the picture that does not end in .png.
        """
        if self.out is not None and self.out.suffix != ".png":
            raise InputError(f"the picture to write must end in .png, got {self.out.name!r}")
        from icgnet.grasping.gripper import load_gripper

        hand = load_gripper(self.gripper)
        table = Table("measure", "value", title=f"gripper {hand.name}")
        for name, value in measures(hand).items():
            table.add_row(name, value)
        console = Console()
        console.print(table)
        if self.out is not None:
            from icgnet.viewer.gripper_picture import gripper_panels
            from icgnet.viewer.sheet import draw_sheet

            panels = gripper_panels(hand)
            draw_sheet(list(panels.values()), list(panels), self.out, columns=len(panels))
            console.print(f"drawn in {self.out}", soft_wrap=True, markup=False)


def measures(hand: "Hand") -> dict[str, str]:
    """What a reader of a gripper file wants to hold against a ruler, by name."""
    from icgnet.grasping.gripper import extents

    width, thickness, length = extents(hand.finger)
    palm = " x ".join(f"{1e3 * extent:.1f}" for extent in extents(hand.palm)) + " mm" if hand.palm else "none"
    front = max((box.corners()["upper"][2] for box in hand.palm), default=None)
    offset = ", ".join(f"{1e3 * value:.1f}" for value in hand.base_offset)
    return {
        "opening": f"0 to {1e3 * hand.max_opening:.1f} mm between the pads",
        "widest object": f"{1e3 * (hand.max_opening - 2 * hand.clearance):.1f} mm with {1e3 * hand.clearance:.1f} mm "
        "of clearance on both sides",
        "finger (x, y, z)": f"{1e3 * width:.1f} x {1e3 * thickness:.1f} x {1e3 * length:.1f} mm, {_count(hand.finger)}",
        "finger in front of the palm": "no palm" if front is None else f"{-1e3 * front:.1f} mm",
        "palm (x, y, z)": f"{palm}, {_count(hand.palm)}",
        "reach past a contact": f"{1e3 * hand.finger_reach:.1f} mm",
        "force of each finger": f"{hand.finger_force:g} N",
        "friction of the pads": f"{hand.friction:g}",
        "base link in the grasp frame": f"at ({offset}) mm, quaternion wxyz "
        f"({', '.join(f'{value:g}' for value in hand.base_quaternion)})",
    }


def _count(boxes: "Sequence[Box]") -> str:
    return "1 box" if len(boxes) == 1 else f"{len(boxes)} boxes"
