"""Do the fingers of any hand close and hold as they should? Traces of closing on objects whose widths are known."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh

from icgnet.benchmark.tables import Table
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.grasping.hand_family import HandFamily, draw_member, hand_numbers
from icgnet.objects.model import ObjectModel
from icgnet.simulation.config import Physics
from icgnet.simulation.hand import closing_time
from icgnet.simulation.motion import smooth_line, steps_in
from icgnet.simulation.physics import Body
from icgnet.simulation.trials import CLOSE_MARGIN, CLOSED_SPEED, LIFT, LIFT_TIME, SETTLE_TIME
from icgnet.simulation.world import World
from icgnet.studies.config import HandsConfig

EXTREMES: dict[str, dict[str, int]] = {
    "narrow, short, weak": {"opening": 0, "finger_length": 0, "finger_force": 0, "tip_width": 0, "tip_thickness": 0},
    "narrow, long": {"opening": 0, "finger_length": 1},
    "wide, short, strong": {"opening": 1, "finger_length": 0, "finger_force": 1},
    "wide, long, thin, weak": {"opening": 1, "finger_length": 1, "finger_force": 0, "tip_width": 0, "tip_thickness": 0},
    "wide, long, broad, strong": {"opening": 1, "finger_length": 1, "finger_force": 1, "tip_width": 1, "palm_depth": 1},
    "broad palm, weak": {"palm_width": 1, "palm_length": 1, "palm_depth": 1, "finger_force": 0},
}
"""Members of the family at ends (0 the lower, 1 the upper) of some of its ranges; the rest is drawn."""
SHARES = (0.15, 0.5, 1.0)
"""Widths of the objects, of the widest that fits between the open fingers."""
SMALLEST = 0.008
"""But not less than this [m]."""
OFFSET = 0.003
"""The hand is beside the middle of the object by this, along y [m]: the object is pushed, as after jitter."""
GRIP = 0.02
"""How far below the top of a box or cylinder the tips go, where the palm leaves room [m]."""
ROOM = 0.004
"""The tips stay this far above the table, and the palm above the object [m]."""
HOLD_TIME = 1.0
"""[s]"""
TRACE_STEPS = 5
"""Steps between two looks at the fingers, as in a trial, and between two rows of a trace."""


@dataclass(frozen=True)
class Closing:
    """One object, closed on from the largest opening, lifted and held still.

    Attributes:
        shape: box, cylinder or sphere.
        width: of the object where the fingers take it [m].
        time: until the fingers stand still, at most the time that a trial gives them [s].
        sinking: how much narrower than the object the hand is, a finger, while it holds [m].
        impact: deepest contact at any moment [m].
        slip: the object moved by this in the hand while it was held still [m].
        tilt: largest angle of the hand from where it should be, lifting included [rad].
        held: both fingers touch the object at the end.
        trace: every 20 ms: opening, and the object's place in the hand along x, y, z of the world [m].
    """

    shape: str
    width: float
    time: float
    sinking: float
    impact: float
    slip: float
    tilt: float
    held: bool
    trace: tuple[tuple[float, float, float, float], ...]


@dataclass(frozen=True)
class HandsNumbers:
    """The closings of every hand, by its name."""

    closings: dict[str, tuple[Closing, ...]]


def measure(config: HandsConfig) -> HandsNumbers:
    """Closes every hand on every object.

    Raises:
        DataError: an unusable gripper.
    """
    physics = Physics(object_mass=config.mass, pad_friction=config.friction)
    hands = {name: load_gripper(name) for name in config.grippers}
    rng, family = np.random.default_rng(config.seed), HandFamily()
    for name, ends in EXTREMES.items() if config.extremes else ():
        fixed = {key: (getattr(family, key)[end],) * 2 for key, end in ends.items()}
        hands[name] = draw_member(replace(family, **fixed), rng)
    return HandsNumbers({name: tuple(_closings(hand, physics)) for name, hand in hands.items()})


def tables(numbers: HandsNumbers) -> list[Table]:
    """The worst of every hand."""
    rows = [
        (
            name,
            f"{sum(each.held for each in found)} of {len(found)}",
            f"{max(each.time for each in found):.2f}",
            *(f"{1e3 * max(getattr(each, key) for each in found):.2f}" for key in ("sinking", "impact", "slip")),
            f"{np.rad2deg(max(each.tilt for each in found)):.2f}",
        )
        for name, found in numbers.closings.items()
    ]
    headers = ("hand", "held", "time s", "sinking mm", "impact mm", "slip mm", "tilt deg")
    return [Table(headers, rows, title="closing from the largest opening, lifting, holding for 1 s; the worst of each")]


def _closings(hand: Gripper, physics: Physics) -> list[Closing]:
    """Of one hand on boxes, cylinders and spheres of several widths."""
    widest, length = hand.max_opening - 2.0 * hand.clearance, float(hand_numbers(hand)[1])
    found = []
    for share in SHARES:
        width = max(SMALLEST, share * widest)
        shapes = {
            "box": trimesh.creation.box((0.06, width, 0.1)),
            "cylinder": trimesh.creation.cylinder(width / 2, 0.1, sections=48),
            # A sphere is taken at its middle, which the palm must leave room for.
            "sphere": trimesh.creation.icosphere(3, min(width, 1.6 * (length - hand.finger_reach)) / 2),
        }
        found += [close_on(hand, name, mesh, physics) for name, mesh in shapes.items()]
    return found


def close_on(hand: Gripper, shape: str, mesh: trimesh.Trimesh, physics: Physics) -> Closing:
    """Closes the fully open hand, which looks straight down, on an object; lifts it as in a trial, and holds it.

    Args:
        hand: the hand.
        shape: what the object is called; "sphere" is taken at its middle, everything else below its top.
        mesh: convex, with its centre at the origin, upright [m].
        physics: engine and material settings.
    """
    width, height = float(mesh.extents[1]), float(mesh.extents[2])
    below = height / 2 + hand.finger_reach / 2 if shape == "sphere" else min(GRIP, hand_numbers(hand)[1] - ROOM)
    tips = np.array([*CENTRE[:2], TABLE_HEIGHT + height - min(below, height - ROOM)])
    standing = np.array([CENTRE[0], CENTRE[1] + OFFSET, TABLE_HEIGHT + height / 2])
    body = Body(ObjectModel(shape, "box", mesh, (mesh,)), 1.0, make_transform(np.eye(3), standing))
    world = World([body], physics, hand)
    world.hand.place(make_transform(np.diag([-1.0, 1.0, -1.0]), tips), hand.max_opening)
    world.hand.squeeze(hand.finger_force)
    watch = _Watch(world)
    for _ in range(steps_in(closing_time(hand) + CLOSE_MARGIN, physics) // TRACE_STEPS):
        watch.step(TRACE_STEPS)
        if world.hand.finger_speed() < CLOSED_SPEED:
            break
    time = len(watch.trace) * physics.timestep
    for position in smooth_line(tips, np.array([0.0, 0.0, LIFT]), LIFT_TIME, physics):
        world.hand.move_to(position)
        watch.step()
    watch.step(steps_in(SETTLE_TIME, physics))
    settled = len(watch.trace)
    watch.step(steps_in(HOLD_TIME, physics))
    trace = np.array(watch.trace)
    slip = np.linalg.norm(trace[settled:, 1:] - trace[settled - 1, 1:], axis=1).max()
    return Closing(
        shape=shape,
        width=width,
        time=time,
        sinking=float(width - trace[settled:, 0].min()) / 2,
        impact=watch.impact,
        slip=float(slip),
        tilt=watch.tilt,
        held=world.is_held(0),
        trace=tuple(map(tuple, trace[TRACE_STEPS - 1 :: TRACE_STEPS].round(6).tolist())),
    )


class _Watch:
    """Steps a world and looks at it after every step."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.trace: list[list[float]] = []
        self.impact = self.tilt = 0.0

    def step(self, count: int = 1) -> None:
        world, data = self._world, self._world.data
        for _ in range(count):
            world.step()
            pushing = (world.hand.finger_of_geom[data.contact.geom] >= 0).any(axis=1)
            self.impact = max(self.impact, -float(data.contact.dist[pushing].min(initial=0.0)))
            turn = abs(float(data.body("hand").xquat @ data.mocap_quat[0]))
            self.tilt = max(self.tilt, 2.0 * float(np.arccos(min(turn, 1.0))))
            place = world.centres_of_mass()[0] - world.hand.position()
            self.trace.append([world.hand.opening(), *place.tolist()])
