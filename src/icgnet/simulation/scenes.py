"""Random scenes: as in the published benchmark, objects packed side by side or dropped into a pile; or wide ones."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform, random_rotation, rotation_z, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.objects.kinds import WIDE_KINDS, Kind, Split
from icgnet.objects.model import ObjectModel
from icgnet.objects.object_set import ObjectSet, check_kind_and_split
from icgnet.simulation.config import Physics, WideScenes, default_physics
from icgnet.simulation.layouts import spawn_wide
from icgnet.simulation.physics import Body
from icgnet.simulation.scene import PlacedObject, Scene
from icgnet.simulation.settling import Settling
from icgnet.simulation.world import World

PACKED_ATTEMPTS = 12
PACKED_GAP = 0.002  # objects nearer than this count as touching [m]
PACKED_FALL = 0.005  # packed objects start this far above the table [m]
PILE_DROP = 0.2  # height above the table from which pile objects are dropped [m]
PILE_RAISE = 0.02  # ... and by how much higher, again and again, while that is inside another object [m]


@dataclass(frozen=True)
class Spawn:
    """A random scene at rest, and how it came about.

    Attributes:
        scene: what stands there.
        attempts: objects that were tried.
        rejected: packed objects that had no room where they were tried.
        lost: objects that left the workspace; all of them, should the simulation have become unstable. Of wide scenes
            also those that found no room or did not come to rest.
        top_speed: largest speed of any object [m/s]; nan if it was not watched.
    """

    scene: Scene
    attempts: int
    rejected: int
    lost: int
    top_speed: float


@dataclass(frozen=True, eq=False)
class _Draw:
    name: str
    model: ObjectModel
    scale: float
    rotation: Float[np.ndarray, "3 3"]
    xy: Float[np.ndarray, "2"]


def draw_count(rng: np.random.Generator) -> int:
    """A number of objects for training scenes: Poisson(4) + 1, at most 10."""
    return int(np.clip(rng.poisson(4) + 1, 1, 10))


def spawn_scene(
    kind: Kind,
    object_set: ObjectSet,
    split: Split,
    rng: np.random.Generator,
    count: int | None = None,
    physics: Physics | None = None,
    wide: WideScenes | None = None,
) -> Scene:
    """A random scene at rest; see `spawn`."""
    return spawn(kind, object_set, split, rng, count, physics, wide=wide).scene


def spawn(
    kind: Kind,
    object_set: ObjectSet,
    split: Split,
    rng: np.random.Generator,
    count: int | None = None,
    physics: Physics | None = None,
    watch_speed: bool = False,
    wide: WideScenes | None = None,
) -> Spawn:
    """A random scene at rest. It may hold fewer than `count` objects, even none.

    Args:
        kind: "packed", "pile", "table" or "bin".
        object_set: where objects come from.
        split: "train", "val" or "test".
        rng: source of every draw.
        count: number of objects to try for; drawn by `draw_count`, or as `wide` says, if None.
        physics: engine settings; `default_physics` if None.
        watch_speed: look at the speeds after every step, which is slower.
        wide: ranges from which tables and bins are drawn; the defaults if None.

    Raises:
        InputError: unknown kind or split, or the object set has nothing for them.
    """
    check_kind_and_split(kind, split)
    names = object_set.names(kind, split)
    if not names:
        raise InputError(f"object set {object_set.name!r} has no objects for {kind} scenes in split {split!r}")
    physics = physics or default_physics(kind)
    if kind in WIDE_KINDS:
        scene, ways = spawn_wide(kind, object_set, split, rng, count, physics, wide or WideScenes())
        return Spawn(scene, ways.total(), 0, ways["lost"], float("nan"))
    count = draw_count(rng) if count is None else count
    if kind == "packed":
        draws = [_draw(object_set, names, rng, (0.08, 0.22), (0.7, 0.8), upright=True) for _ in range(PACKED_ATTEMPTS)]
    else:
        draws = [_draw(object_set, names, rng, (0.1, 0.2), (0.8, 1.0), upright=False) for _ in range(count)]
    spawner = _Spawner(draws, physics, drop_box=kind == "pile", watch_speed=watch_speed)
    if kind == "packed":
        spawner.pack(count)
    else:
        spawner.pile()
    return spawner.result(kind)


def _draw(
    object_set: ObjectSet,
    names: tuple[str, ...],
    rng: np.random.Generator,
    xy_range: tuple[float, float],
    scale_range: tuple[float, float],
    upright: bool,
) -> _Draw:
    name = names[rng.integers(len(names))]
    xy = rng.uniform(*xy_range, size=2)
    rotation = rotation_z(rng.uniform(0.0, 2.0 * np.pi)) if upright else random_rotation(rng)
    return _Draw(name, object_set.model(name), rng.uniform(*scale_range), rotation, xy)


class _Spawner:
    """Places drawn objects in a world, one after the other, and counts what happens."""

    def __init__(self, draws: list[_Draw], physics: Physics, drop_box: bool, watch_speed: bool) -> None:
        self._draws = draws
        self._world = World([Body(draw.model, draw.scale, np.eye(4)) for draw in draws], physics, drop_box=drop_box)
        for index in range(len(draws)):
            self._world.park(index)
        self._settling = Settling(self._world, watch_speed=watch_speed)
        self._attempts = self._rejected = 0

    def pack(self, count: int) -> None:
        """Stands objects on free places of the table until there are `count`, or the draws are used up."""
        world = self._world
        for index, draw in enumerate(self._draws):
            if world.present.sum() == count:
                break
            self._attempts += 1
            before = world.snapshot()
            vertices = draw.model.visual.vertices * draw.scale
            lowest = transform_points(make_transform(draw.rotation, np.zeros(3)), vertices)[:, 2].min()
            height = TABLE_HEIGHT + PACKED_FALL - lowest
            world.place(index, make_transform(draw.rotation, np.array([*draw.xy, height])))
            if world.touches_anything(index, PACKED_GAP):
                self._rejected += 1
                world.restore(before)
            else:
                self._settling.remove_outside()

    def pile(self) -> None:
        """Drops all objects into the drop box and takes the box away."""
        for index, draw in enumerate(self._draws):
            self._attempts += 1
            self._place_above(index, draw)
            self._settling.wait_for_rest(timeout=1.0)
        self._world.remove_drop_box()
        self._settling.remove_outside()

    def _place_above(self, index: int, draw: _Draw) -> None:
        """Puts an object where it is dropped, higher where the pile already reaches: inside of it, it would explode."""
        height = TABLE_HEIGHT + PILE_DROP
        self._world.place(index, make_transform(draw.rotation, np.array([*draw.xy, height])))
        while self._world.touches_anything(index, margin=0.0):
            height += PILE_RAISE
            self._world.place(index, make_transform(draw.rotation, np.array([*draw.xy, height])))

    def result(self, kind: Kind) -> Spawn:
        """The scene as it is now."""
        world = self._world
        present = np.flatnonzero(world.present & ~world.is_unstable())
        poses = world.object_poses()
        objects = tuple(PlacedObject(self._draws[i].name, self._draws[i].scale, poses[i]) for i in present)
        lost = self._settling.lost + int(world.present.sum()) - len(objects)
        return Spawn(Scene(kind, objects), self._attempts, self._rejected, lost, self._settling.top_speed)
