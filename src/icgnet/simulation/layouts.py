"""Random scenes on whole tables and in bins: objects spread, touching, stacked, leaning, nested and dropped."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform, random_rotation, rotation_z, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.objects.kinds import Kind, Split
from icgnet.objects.model import ObjectModel
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.config import LARGEST_PART, Physics, WideScenes
from icgnet.simulation.furniture import draw_bin, draw_table
from icgnet.simulation.physics import Body
from icgnet.simulation.scene import PlacedObject, Scene
from icgnet.simulation.settling import Settling
from icgnet.simulation.world import World

Mode = Literal["spread", "touching", "stacked", "leaning", "nested", "dropped"]

MODES: dict[str, dict[Mode, float]] = {
    "table": {"spread": 3.0, "touching": 3.0, "stacked": 4.0, "leaning": 0.7, "nested": 0.8, "dropped": 1.0},
    "bin": {"spread": 1.0, "touching": 1.0, "stacked": 2.0, "leaning": 0.3, "nested": 0.5, "dropped": 7.0},
}
"""How objects come into a scene, and how often on the average; every scene draws its own mixture around that."""
STORED_MODES: dict[Mode, float] = {"spread": 1.0, "touching": 3.0, "stacked": 5.0, "leaning": 0.3, "dropped": 0.5}
"""As `MODES`, for boxes that are stored."""
SQUARE, SQUARE_DEG = 0.7, 4.0
"""Share of stored boxes that are turned as the one beside or below them, and how far they are off [degrees]."""
SIDEWAYS = 0.35
"""Part of its length by which a box is out of line with the one that it stands beside, at the most."""
ON_SUPPORT = ("spread", "touching")
AREA_PER_OBJECT = {"table": 0.014, "bin": 0.008}
"""Smallest part of the support that an object needs [m^2]."""
UPRIGHT = 0.6
"""Share of the objects that are put down as they stand; all of those that are put on others are."""
FLAT, SMALLEST_TOP = 0.004, 1e-5
"""How uneven the top is that an object is put on [m], and what is added to its area [m^2], so that none is left out."""
GAP = (0.003, 0.03)
"""Objects that are spread are farther apart than a distance from this range [m]."""
FALL = 0.003
"""What is put on something starts this far above it [m]."""
RAISE, HIGHEST = 0.006, 0.5
"""Where that is inside of something, it starts higher by such steps, up to this height above the support [m]."""
STEP = 0.004
"""Steps in which an object is moved towards the one that it shall touch [m]."""
STACK_TRIES, RAISED = 2, 0.01
"""What is to be stacked but ends less than this above the support [m] is put on something again, so often in all."""
PLACES = 8
"""Places that are tried for an object."""
TRIES = 50
"""Objects that are drawn before a support counts as too small for all of them."""
HOLLOW = 0.5
"""Objects whose parts fill less than this share of their convex hull can hold others."""
SHORT_REST, LONG_REST = 0.5, 3.0
"""Time to come to rest after each object that is put on others, and in the end [s]."""
MOVING = 0.05
"""What is faster than this in the end has not come to rest, and is taken away [m/s and rad/s together]."""
SUNK = 0.003
"""What is deeper than this inside of another object in the end is taken away [m]."""


class NothingFitsError(InputError):
    """All objects that were drawn are too large, or too small, for a table or bin; another one may be larger."""


@dataclass(frozen=True, eq=False)
class _Draw:
    """An object and how it is to come into the scene."""

    name: str
    model: ObjectModel
    scale: float
    stretch: tuple[float, float, float]
    rotation: Float[np.ndarray, "3 3"]
    mode: Mode
    vertices: Float[np.ndarray, "v 3"]
    """Of its convex parts, scaled and stretched, not turned [m]."""
    square: bool = False
    """Whether it is turned as what it is put beside or on."""

    @property
    def is_hollow(self) -> bool:
        """Whether something else may fit into it."""
        return self.model.fill < HOLLOW


def spawn_wide(
    kind: Kind,
    object_set: ObjectSet,
    split: Split,
    rng: np.random.Generator,
    count: int | None,
    physics: Physics,
    config: WideScenes,
) -> tuple[Scene, Counter[str]]:
    """A random table or bin at rest, and how many of its objects came into it in which way ("lost" for the others).

    Args:
        kind: "table" or "bin".
        object_set: where objects come from.
        split: which of them.
        rng: source of every draw.
        count: number of objects to try for; drawn if None.
        physics: engine settings.
        config: ranges of what is drawn.

    Raises:
        NothingFitsError: all objects that were drawn are too large or too small for the support.
    """
    surroundings = draw_table(config, rng) if kind == "table" else draw_bin(config, rng)
    lower_x, lower_y, upper_x, upper_y = surroundings.extent or (0.0, 0.0, 0.0, 0.0)
    size = np.array([upper_x - lower_x, upper_y - lower_y])
    if count is None:
        most = int(np.prod(size) / AREA_PER_OBJECT[kind])
        count = int(rng.integers(config.objects[0], max(min(config.objects[1], most), config.objects[0]) + 1))
    draws = _draw_objects(kind, object_set, split, rng, count, float(size.min()), config)
    bodies = [Body(each.model, each.scale, np.eye(4), each.stretch) for each in draws]
    world = World(bodies, physics, surroundings=surroundings)
    layout = _Layout(world, draws, Settling(world, surroundings), np.array([lower_x, lower_y]), size, rng)
    layout.build()
    poses, present = world.object_poses(), np.flatnonzero(world.present & ~world.is_unstable())
    objects = tuple(PlacedObject(draws[i].name, draws[i].scale, poses[i], draws[i].stretch) for i in present)
    ways = Counter(str(draws[i].mode) for i in present)
    ways["lost"] = len(draws) - len(present)
    return Scene(kind, objects, surroundings), ways


def _draw_objects(
    kind: Kind,
    object_set: ObjectSet,
    split: Split,
    rng: np.random.Generator,
    count: int,
    narrow: float,
    config: WideScenes,
) -> list[_Draw]:
    """Objects in the order in which they come: first those on the support, then those on and in others."""
    names, weights = object_set.names(kind, split), object_set.draw_weights(kind, split)
    boxes = np.array([object_set.class_name(name) == "box" for name in names])
    stored = bool(config.stored and rng.random() < config.stored and boxes.any())
    if stored:
        names, weights = tuple(np.array(names)[boxes]), weights[boxes] / weights[boxes].sum()
    ways = STORED_MODES if stored else MODES[kind]
    modes = list(ways)
    mixture = np.array(list(ways.values())) * rng.gamma(1.0, size=len(modes))
    mixture /= mixture.sum()
    largest = min(config.longest[1], LARGEST_PART * narrow)
    draws = []
    for number in range(count):
        mode: Mode = modes[rng.choice(len(modes), p=mixture)] if number else "spread"
        draw = _draw_object(object_set, names, weights, mode, rng, largest, config)
        draws.append(_on_a_face(draw, rng) if stored and mode not in ("dropped", "leaning") else draw)
    return sorted(draws, key=lambda each: each.mode not in ON_SUPPORT)


def _draw_object(
    object_set: ObjectSet,
    names: tuple[str, ...],
    weights: Float[np.ndarray, "n"],
    mode: Mode,
    rng: np.random.Generator,
    largest: float,
    config: WideScenes,
) -> _Draw:
    for _ in range(TRIES):
        name = names[rng.choice(len(names), p=weights)]
        model = object_set.model(name)
        stretch = np.ones(3)
        if rng.random() < 0.5:
            stretch[rng.integers(3)] += rng.uniform(-config.stretch, config.stretch)
        longest = float((model.visual.extents * stretch).max())
        least, most = max(config.scale[0], config.longest[0] / longest), min(config.scale[1], largest / longest)
        if least > most:
            continue
        scale = float(np.float32(rng.uniform(least, most)))
        along_x, along_y, along_z = stretch.astype(np.float32).tolist()
        kept = along_x, along_y, along_z
        upright = mode == "stacked" or (mode not in ("dropped", "leaning") and rng.random() < UPRIGHT)
        rotation = rotation_z(rng.uniform(0.0, 2.0 * np.pi)) if upright else random_rotation(rng)
        vertices = np.concatenate([part.vertices for part in model.parts]) * (scale * np.array(kept))
        return _Draw(name, model, scale, kept, rotation, mode, vertices)
    raise NothingFitsError(
        f"object set {object_set.name!r}: none of {TRIES} objects is {config.longest[0]:g} to {largest:g} m long with "
        f"a scale of {config.scale[0]:g} to {config.scale[1]:g}"
    )


def _on_a_face(draw: _Draw, rng: np.random.Generator) -> _Draw:
    """The same box on one of its sides, the larger the more often."""
    sides = np.ptp(draw.vertices, axis=0)
    areas = sides.prod() / sides
    up = int(rng.choice(3, p=areas / areas.sum()))
    onto_a_face = np.roll(np.eye(3), 2 - up, axis=0)
    turn = rotation_z(rng.uniform(0.0, 2.0 * np.pi))
    return replace(draw, rotation=turn @ onto_a_face, square=bool(rng.random() < SQUARE))


def _heading(rotation: Float[np.ndarray, "3 3"]) -> float:
    """Direction of the most level axis of something [rad]."""
    axis = rotation[:, np.abs(rotation[2]).argmin()]
    return float(np.arctan2(axis[1], axis[0]))


class _Layout:
    """Brings drawn objects into a world, one after the other."""

    def __init__(
        self,
        world: World,
        draws: list[_Draw],
        settling: Settling,
        lower: Float[np.ndarray, "2"],
        size: Float[np.ndarray, "2"],
        rng: np.random.Generator,
    ) -> None:
        self._world, self._draws, self._settling = world, draws, settling
        self._lower, self._size, self._rng = lower, size, rng
        for index in range(len(draws)):
            world.park(index)

    def build(self) -> None:
        """Places all objects that find room, and waits until they rest."""
        ways: dict[Mode, Callable[[int, _Draw], bool]] = {
            "spread": self._spread,
            "touching": self._touching,
            "stacked": self._stacked,
            "leaning": self._leaning,
            "nested": self._nested,
            "dropped": self._dropped,
        }
        settled = False
        for index, draw in enumerate(self._draws):
            if draw.mode not in ON_SUPPORT and not settled:
                self._settling.wait_for_rest(SHORT_REST)
                settled = True
            for _ in range(STACK_TRIES if draw.mode == "stacked" else 1):
                if not ways[draw.mode](index, draw):
                    self._world.park(index)
                elif settled:
                    self._settling.wait_for_rest(SHORT_REST)
                if self._corners(index)[:, 2].min() > TABLE_HEIGHT + RAISED:
                    break
        self._settling.wait_for_rest(LONG_REST)
        self._settling.remove_outside()
        for index in self._world.sunk_objects(SUNK).tolist():
            self._world.park(index)
        self._settling.remove_outside()
        for index in np.flatnonzero(self._world.speeds() > MOVING).tolist():
            self._world.park(index)

    def _spread(self, index: int, draw: _Draw) -> bool:
        """Somewhere on the support, away from everything else."""
        return any(self._put(index, draw, self._anywhere(), self._rng.uniform(*GAP)) for _ in range(PLACES))

    def _touching(self, index: int, draw: _Draw) -> bool:
        """Beside another object, as near as it gets."""
        present = self._present(index)
        if not present:
            return self._spread(index, draw)
        for _ in range(PLACES):
            base = int(self._rng.choice(present))
            draw, angle = self._squared(draw, base)
            way = np.array([np.cos(angle), np.sin(angle)])
            corners = self._corners(base)[:, :2]
            middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
            if draw.square:
                across = np.array([-way[1], way[0]])
                middle = middle + self._rng.uniform(-SIDEWAYS, SIDEWAYS) * np.ptp(corners @ across) * across
            reach = np.linalg.norm(draw.vertices @ draw.rotation.T[:, :2], axis=1).max()
            start = float(((corners - middle) @ way).max() + reach) + STEP
            if not self._put(index, draw, middle + start * way, margin=0.0):
                continue
            for distance in np.arange(start - STEP, 0.0, -STEP):
                if not self._put(index, draw, middle + distance * way, margin=0.0):
                    return self._put(index, draw, middle + (distance + STEP) * way, margin=0.0)
        return False

    def _stacked(self, index: int, draw: _Draw) -> bool:
        """On another object, or on the pile that is there: the larger and flatter its top, the more often."""
        present = self._present(index)
        if not present:
            return self._spread(index, draw)
        tops = [self._top(base) for base in present]
        areas = np.array([np.ptp(top[:, :2], axis=0).prod() + SMALLEST_TOP for top in tops])
        base = int(self._rng.choice(len(tops), p=areas / areas.sum()))
        draw, top = self._squared(draw, present[base])[0], tops[base]
        lower, upper = top.min(axis=0), top.max(axis=0)
        shift = self._rng.uniform(-0.2, 0.2, 2) * (upper - lower)[:2]
        return self._put_above(index, draw, (lower + upper)[:2] / 2 + shift, float(upper[2]))

    def _nested(self, index: int, draw: _Draw) -> bool:
        """Into a hollow object, if there is one."""
        hollow = [base for base in self._present(index) if self._draws[base].is_hollow]
        if not hollow:
            return self._stacked(index, draw)
        corners = self._corners(int(self._rng.choice(hollow)))
        lower, upper = corners.min(axis=0), corners.max(axis=0)
        return self._put_above(index, draw, (lower + upper)[:2] / 2, float(lower[2] + 0.01))

    def _leaning(self, index: int, draw: _Draw) -> bool:
        """Aslant beside another object."""
        base = self._any_base(index)
        if base is None:
            return self._spread(index, draw)
        corners = self._corners(base)
        lower, upper = corners.min(axis=0), corners.max(axis=0)
        angle = self._rng.uniform(0.0, 2.0 * np.pi)
        away = np.array([np.cos(angle), np.sin(angle)]) * self._rng.uniform(0.8, 1.3) * (upper - lower)[:2]
        return self._put_above(index, draw, (lower + upper)[:2] / 2 + away / 2, TABLE_HEIGHT)

    def _dropped(self, index: int, draw: _Draw) -> bool:
        """From a little above what lies at some place."""
        return self._put_above(index, draw, self._anywhere(), TABLE_HEIGHT + 0.03)

    def _squared(self, draw: _Draw, base: int) -> tuple[_Draw, float]:
        """What is to be put beside or on `base`, turned as that is if it shall be, and a direction from there [rad]."""
        if not draw.square:
            return draw, self._rng.uniform(0.0, 2.0 * np.pi)
        angle = _heading(self._world.object_poses()[base][:3, :3]) + np.pi / 2 * self._rng.integers(4)
        off = np.deg2rad(SQUARE_DEG) * self._rng.standard_normal()
        turn = rotation_z(angle - _heading(draw.rotation) + off)
        return replace(draw, rotation=turn @ draw.rotation), angle

    def _anywhere(self) -> Float[np.ndarray, "2"]:
        return self._lower + self._size * self._rng.uniform(0.08, 0.92, 2)

    def _present(self, index: int) -> list[int]:
        """The other objects that are there."""
        return [other for other in np.flatnonzero(self._world.present).tolist() if other != index]

    def _any_base(self, index: int) -> int | None:
        present = self._present(index)
        return int(self._rng.choice(present)) if present else None

    def _top(self, index: int) -> Float[np.ndarray, "v 3"]:
        """The vertices of an object that are about as high as its highest one [m]."""
        corners = self._corners(index)
        return corners[corners[:, 2] > corners[:, 2].max() - FLAT]

    def _corners(self, index: int) -> Float[np.ndarray, "v 3"]:
        """Vertices of an object where it is now [m]."""
        return transform_points(self._world.object_poses()[index], self._draws[index].vertices)

    def _put(self, index: int, draw: _Draw, place: Float[np.ndarray, "2"], margin: float) -> bool:
        """Puts an object on the support; False where it would touch anything, or come nearer than `margin` [m]."""
        lowest = (draw.vertices @ draw.rotation[2]).min()
        at = np.array([*place, TABLE_HEIGHT + max(FALL, margin + 1e-4) - lowest])
        self._world.place(index, make_transform(draw.rotation, at))
        if ((place < self._lower) | (place > self._lower + self._size)).any():
            return False
        return not self._world.touches_anything(index, margin)

    def _put_above(self, index: int, draw: _Draw, place: Float[np.ndarray, "2"], height: float) -> bool:
        """Puts an object with its lowest point at a height [m], or higher, where it touches nothing."""
        lowest = (draw.vertices @ draw.rotation[2]).min()
        for lift in np.arange(FALL, HIGHEST, RAISE):
            at = np.array([*place, height + lift - lowest])
            self._world.place(index, make_transform(draw.rotation, at))
            if not self._world.touches_anything(index, margin=0.0):
                return True
        return False
