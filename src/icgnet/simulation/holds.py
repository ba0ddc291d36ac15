"""Does a held object stay where it is? A grasp from above on an upright object, as in the published reference runs."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.geometry.transforms import make_transform, transform_points
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT
from icgnet.grasping.gripper import Gripper
from icgnet.objects.model import ObjectModel
from icgnet.simulation.approach import APPROACH_LENGTH
from icgnet.simulation.config import Physics
from icgnet.simulation.motion import line_at_constant_speed, steps_in
from icgnet.simulation.physics import Body
from icgnet.simulation.trials import LIFT
from icgnet.simulation.workcell import APPROACH_TIME, CLOSE_TIME, LIFT_TIME
from icgnet.simulation.world import World

TIP_DEPTH = 0.03  # the finger tips go this far below the object's top [m]
TIP_CLEARANCE = 0.003  # ... but stay this far above the table [m]
REST_TIME = 0.5  # before the grasp and after the lift [s]


@dataclass(frozen=True)
class Hold:
    """What happened to one object.

    Attributes:
        closed: opening of the hand after closing [m].
        lifted: opening of the hand after the lift [m].
        rise: of the object's centre of mass when the hand has risen by 10 cm [m].
        is_held: both fingers touch the object at the end.
        creep: how far the object moved in the hand while it was held still [m].
    """

    closed: float
    lifted: float
    rise: float
    is_held: bool
    creep: float


def hold_from_above(
    model: ObjectModel, scale: float, gripper: Gripper, physics: Physics, duration: float = 5.0
) -> Hold:
    """Grasps an upright object across its narrower side, lifts it, and holds it still.

    Args:
        model: the object.
        scale: factor on its meshes.
        gripper: the hand, opened fully before.
        physics: engine and material settings.
        duration: how long to hold [s].
    """
    lower, upper = model.visual.bounds * scale
    T_world_object = make_transform(np.eye(3), np.array([CENTRE[0], CENTRE[1], TABLE_HEIGHT - lower[2]]))
    world = World([Body(model, scale, T_world_object)], physics, gripper)
    _wait(world, REST_TIME)
    tips = _tip_position(world, model, scale)
    rotation = _closing_along(int(np.argmin((upper - lower)[:2])))
    start = tips + [0.0, 0.0, APPROACH_LENGTH]
    world.hand.place(make_transform(rotation, start), gripper.max_opening)
    _move(world, start, tips, APPROACH_TIME)
    world.hand.squeeze(gripper.finger_force)
    _wait(world, CLOSE_TIME)
    closed, height = world.hand.opening(), world.centres_of_mass()[0, 2]
    _move(world, tips, tips + [0.0, 0.0, LIFT], LIFT_TIME)
    lifted, rise = world.hand.opening(), float(world.centres_of_mass()[0, 2] - height)
    _wait(world, REST_TIME)
    before = world.centres_of_mass()[0] - world.hand.position()
    _wait(world, duration)
    creep = np.linalg.norm(world.centres_of_mass()[0] - world.hand.position() - before)
    return Hold(closed, lifted, rise, world.is_held(0), float(creep))


def _tip_position(world: World, model: ObjectModel, scale: float) -> Float[np.ndarray, "3"]:
    pose = world.object_poses()[0]
    vertices = transform_points(pose, model.visual.vertices * scale)
    height = max(vertices[:, 2].max() - TIP_DEPTH, TABLE_HEIGHT + TIP_CLEARANCE)
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    return np.array([middle[0], middle[1], height])


def _closing_along(axis: int) -> Float[np.ndarray, "3 3"]:
    """A hand that looks straight down and closes along the world's x (0) or y (1)."""
    closing = np.eye(3)[axis]
    approach = np.array([0.0, 0.0, -1.0])
    return np.stack([np.cross(closing, approach), closing, approach], axis=1)


def _move(world: World, start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"], duration: float) -> None:
    world.follow(line_at_constant_speed(start, end - start, duration, world.physics))


def _wait(world: World, duration: float) -> None:
    world.step(steps_in(duration, world.physics))
