"""An arm before a table with boxes of which everything is known."""

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest
import trimesh

from arm_scenes import from_above
from box_objects import predicted
from icgnet.grasping.grasps import Grasps
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
    """Makes a prediction of boxes with one grasp from above on each of some of them, in this order."""

    def make(meshes: list[trimesh.Trimesh], grasped: tuple[int, ...] = (0,), width: float = 0.04) -> Prediction:
        clouds = [np.asarray(mesh.sample(600, seed=k)) for k, mesh in enumerate(meshes)]
        labels = np.repeat(np.arange(len(meshes)), 600)
        poses = np.array([from_above(meshes[k]) for k in grasped]).reshape(-1, 4, 4)
        count = len(grasped)
        grasps = Grasps(
            poses,
            np.full(count, width),
            np.full(count, width + 0.012),
            np.linspace(0.9, 0.8, count),
            np.array(grasped, dtype=np.int64),
            poses[:, :3, 3],
            np.full(count, 5),
        )
        return replace(predicted(meshes, np.concatenate(clouds), labels), grasps=grasps)

    return make
