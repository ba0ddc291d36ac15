from dataclasses import replace

import numpy as np
import pytest

from icgnet.grasping.gripper import Box, load_gripper
from icgnet.viewer.gripper_picture import cup_diameter, gripper_panels

FRANKA = load_gripper()
PANEL = (200, 210)


def green(image) -> np.ndarray:
    """Pixels [h w] of the fingers."""
    red, green, blue = np.moveaxis(np.asarray(image, int), 2, 0)
    return (green > red + 40) & (green > blue + 40)


def blue(image) -> np.ndarray:
    """Pixels [h w] of the cup."""
    red, _, blue = np.moveaxis(np.asarray(image, int), 2, 0)
    return blue > red + 40


@pytest.fixture(scope="module")
def panels():
    return list(gripper_panels(FRANKA, PANEL).values())


def test_there_is_a_panel_each_for_open_closed_and_cup(panels):
    assert list(gripper_panels(replace(FRANKA, max_opening=0.05), PANEL)) == [
        "open, 50 mm between the pads; x red, y green, z blue",
        "closed",
        "on a cup of 38 mm",
    ]
    assert [image.size for image in panels] == [PANEL[::-1]] * 3


def test_the_finger_on_the_left_comes_to_the_middle_when_the_hand_closes(panels):
    apart, together = (int(np.flatnonzero(green(image).any(axis=0)).min()) for image in panels[:2])
    assert apart + 10 < together <= PANEL[1] / 2


def test_the_cup_is_between_the_fingers(panels):
    cup, fingers = blue(panels[2]), green(panels[2])
    assert cup.sum() > 5 * blue(panels[0]).sum()
    columns = np.flatnonzero(fingers.any(axis=0))
    assert columns.min() < np.flatnonzero(cup.any(axis=0)).mean() < columns.max()


@pytest.mark.parametrize("opening", [0.005, 0.03, 0.08, 0.3])
def test_the_cup_fits_into_any_hand(opening):
    assert 0.0 < cup_diameter(replace(FRANKA, max_opening=opening)) <= opening


def test_a_hand_without_a_palm_is_drawn():
    finger = (Box((0.0, 0.005, -0.02), (0.02, 0.01, 0.04)),)
    assert len(gripper_panels(replace(FRANKA, palm=(), finger=finger), PANEL)) == 3
