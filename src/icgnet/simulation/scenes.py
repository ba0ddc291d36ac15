"""Random scenes as in the published benchmark: objects packed side by side, or dropped into a pile."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform, random_rotation, rotation_z, transform_points
from icgnet.geometry.workspace import SIZE, TABLE_HEIGHT
from icgnet.objects.model import ObjectModel
from icgnet.objects.object_set import Kind, ObjectSet, Split, check_kind_and_split
from icgnet.simulation.physics import Body, Physics
from icgnet.simulation.scene import PlacedObject, Scene
from icgnet.simulation.world import World

PACKED_ATTEMPTS = 12
PACKED_GAP = 0.002  # objects nearer than this count as touching [m]
PACKED_FALL = 0.005  # packed objects start this far above the table [m]
PILE_DROP = 0.2  # height above the table from which pile objects are dropped [m]
REST_SPEED = 0.01  # [m/s and rad/s together]
REST_CHECK = 0.25  # time between two looks at the speeds [s]


@dataclass(frozen=True)
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
) -> Scene:
    """A random scene at rest. It may hold fewer than `count` objects, even none.

    Args:
        kind: "packed" or "pile".
        object_set: where objects come from.
        split: "train", "val" or "test".
        rng: source of every draw.
        count: number of objects to try for; drawn by `draw_count` if None.
        physics: engine settings; the benchmark's if None.

    Raises:
        InputError: unknown kind or split, or the object set has nothing for them.
    """
    check_kind_and_split(kind, split)
    count = draw_count(rng) if count is None else count
    physics = physics or Physics()
    names = object_set.names(kind, split)
    if not names:
        raise InputError(f"object set {object_set.name!r} has no objects for {kind} scenes in split {split!r}")
    if kind == "packed":
        draws = [_draw(object_set, names, rng, (0.08, 0.22), (0.7, 0.8), upright=True) for _ in range(PACKED_ATTEMPTS)]
        world = _pack(draws, count, physics)
    else:
        draws = [_draw(object_set, names, rng, (0.1, 0.2), (0.8, 1.0), upright=False) for _ in range(count)]
        world = _pile(draws, physics)
    poses = world.object_poses()
    return Scene(
        kind, tuple(PlacedObject(draws[i].name, draws[i].scale, poses[i]) for i in np.flatnonzero(world.present))
    )


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


def _empty_world(draws: list[_Draw], physics: Physics, drop_box: bool) -> World:
    world = World([Body(draw.model, draw.scale, np.eye(4)) for draw in draws], physics, drop_box=drop_box)
    for index in range(len(draws)):
        world.park(index)
    return world


def _pack(draws: list[_Draw], count: int, physics: Physics) -> World:
    world = _empty_world(draws, physics, drop_box=False)
    for index, draw in enumerate(draws):
        if world.present.sum() == count:
            break
        before = world.snapshot()
        vertices = transform_points(make_transform(draw.rotation, np.zeros(3)), draw.model.visual.vertices * draw.scale)
        height = TABLE_HEIGHT + PACKED_FALL - vertices[:, 2].min()
        world.place(index, make_transform(draw.rotation, np.array([*draw.xy, height])))
        if world.touches_anything(index, PACKED_GAP):
            world.restore(before)
        else:
            _remove_outside(world)
    return world


def _pile(draws: list[_Draw], physics: Physics) -> World:
    world = _empty_world(draws, physics, drop_box=True)
    for index, draw in enumerate(draws):
        world.place(index, make_transform(draw.rotation, np.array([*draw.xy, TABLE_HEIGHT + PILE_DROP])))
        _wait_for_rest(world, timeout=1.0)
    world.remove_drop_box()
    _remove_outside(world)
    return world


def _wait_for_rest(world: World, timeout: float) -> None:
    steps = round(REST_CHECK / world.physics.timestep)
    for _ in range(round(timeout / REST_CHECK)):
        world.step(steps)
        if world.speeds().max(initial=0.0) <= REST_SPEED:
            return


def _remove_outside(world: World) -> None:
    """Waits for rest and takes away what has left the workspace, until nothing more leaves it.

    An object has left when its centre of mass is beside the cube or below its floor; there is no upper limit.
    """
    while True:
        _wait_for_rest(world, timeout=2.0)
        centres = world.centres_of_mass()
        outside = ((centres < 0.0).any(axis=1) | (centres[:, :2] > SIZE).any(axis=1)) & world.present
        for index in np.flatnonzero(outside):
            world.park(int(index))
        if not outside.any():
            return
