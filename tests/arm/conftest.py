"""An arm before a table with boxes of which everything is known."""

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from arm_scenes import boxes_seen
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.inference.prediction import Prediction

if TYPE_CHECKING:
    from icgnet.arm.arm import Arm


@pytest.fixture(scope="session")
def fr3() -> "Arm":
    from icgnet.arm.arm import Arm

    return Arm.load("fr3")


@pytest.fixture(scope="session")
def hand() -> Gripper:
    return load_gripper()


@pytest.fixture(scope="session")
def seen() -> Callable[..., Prediction]:
    """Makes a prediction of boxes, see `boxes_seen`."""
    return boxes_seen
