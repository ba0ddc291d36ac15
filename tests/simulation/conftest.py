"""Objects with known answers, for the tests of the simulation."""

from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from icgnet.geometry.transforms import make_transform
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.model import ObjectModel
from icgnet.simulation.physics import Body


@pytest.fixture(scope="session")
def gripper() -> Gripper:
    return load_gripper("franka")


@pytest.fixture(scope="session")
def box() -> Callable[..., ObjectModel]:
    """Makes a box with these edge lengths [m]."""

    def make(*edges: float) -> ObjectModel:
        mesh = trimesh.creation.box(extents=edges)
        return ObjectModel("test/box", "box", mesh, (mesh,))

    return make


@pytest.fixture(scope="session")
def standing_box(box: Callable[..., ObjectModel]) -> Callable[..., Body]:
    """Puts a box with these edge lengths [m] on the table."""

    def make(*edges: float, x: float = 0.15, y: float = 0.15) -> Body:
        return Body(box(*edges), 1.0, make_transform(np.eye(3), np.array([x, y, 0.05 + edges[2] / 2])))

    return make


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
