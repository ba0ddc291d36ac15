"""Is the simulation true? Scenes and grasps beside the published ones, creep, explosions, and the label filter."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from icgnet.benchmark.tables import NOTHING, Table
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.collision import draw_back
from icgnet.grasping.frame import grasp_poses
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.kinds import KINDS, Kind, Split
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.simulation.config import Jitter, Physics
from icgnet.simulation.contacts import sample_contacts
from icgnet.simulation.holds import Hold, hold_from_above
from icgnet.simulation.physics import Body
from icgnet.simulation.scene import Scene, world_mesh
from icgnet.simulation.scenes import spawn, spawn_scene
from icgnet.simulation.trials import Trials
from icgnet.studies.config import SimulationConfig
from icgnet.studies.published import (
    PILE_FELL_THROUGH,
    SCENES,
    TRACE_RISE,
    TRACE_STANDOFF,
    TRACES,
    PublishedTrace,
)

OBJECTS = 5  # objects to try for in every scene, as in the benchmark
TILTED = np.deg2rad(20.0)
CONTACTS = 40  # contacts of a scene whose decisions are compared


@dataclass(frozen=True)
class SceneNumbers:
    """Statistics of random scenes; means are over scenes.

    Attributes:
        kind: "packed" or "pile".
        scenes: how many.
        placed: objects at rest, mean.
        placed_histogram: scenes with 0, 1, ... objects.
        attempts: objects tried, mean.
        rejected: share of the attempts that had no room.
        lost: objects that left the workspace, mean.
        tilted: share of the objects whose axis is tilted by more than 20 degrees; of interest where they were stood up.
        top_speed: largest speed of any object [m/s].
    """

    kind: Kind
    scenes: int
    placed: float
    placed_histogram: tuple[int, ...]
    attempts: float
    rejected: float
    lost: float
    tilted: float
    top_speed: float


def measure_scenes(kind: Kind, object_set: ObjectSet, split: Split, scenes: int, seed: int) -> SceneNumbers:
    """Makes random scenes of five objects and counts.

    Raises:
        InputError: the object set has nothing for this kind and split.
    """
    streams = np.random.SeedSequence(seed).spawn(scenes)
    spawns = [
        spawn(kind, object_set, split, np.random.default_rng(stream), OBJECTS, watch_speed=True) for stream in streams
    ]
    placed = np.array([len(each.scene.objects) for each in spawns])
    attempts = sum(each.attempts for each in spawns)
    tilts = np.concatenate([_tilts(each.scene) for each in spawns])
    return SceneNumbers(
        kind,
        scenes,
        placed=float(placed.mean()),
        placed_histogram=tuple(np.bincount(placed, minlength=OBJECTS + 1).tolist()),
        attempts=attempts / scenes,
        rejected=sum(each.rejected for each in spawns) / attempts,
        lost=sum(each.lost for each in spawns) / scenes,
        tilted=float((tilts > TILTED).mean()) if len(tilts) else 0.0,
        top_speed=max(each.top_speed for each in spawns),
    )


def _tilts(scene: Scene) -> np.ndarray:
    """Angle of each object's z axis from the vertical [rad]."""
    upright = np.array([placed.T_world_object[2, 2] for placed in scene.objects])
    return np.arccos(np.clip(upright, -1.0, 1.0))


@dataclass(frozen=True)
class Trace:
    """One published grasp and ours."""

    published: PublishedTrace
    ours: Hold


def measure_traces(object_set: ObjectSet, gripper: Gripper) -> list[Trace]:
    """Repeats the published reference grasps.

    Raises:
        InputError: the object set is not VGN's.
    """
    return [
        Trace(each, hold_from_above(object_set.model(each.name), each.scale, gripper, Physics())) for each in TRACES
    ]


def measure_creep(object_set: ObjectSet, split: Split, gripper: Gripper, scale: float = 0.9) -> dict[str, Hold]:
    """Holds every pile object that fits into the hand for five seconds; results by name.

    Some stand too badly on their own, or are too thin where the hand closes, to be held at all.
    """
    holds = {}
    for name in object_set.names("pile", split):
        model = object_set.model(name)
        if (model.visual.extents[:2] * scale).min() < gripper.max_opening:
            holds[name] = hold_from_above(model, scale, gripper, Physics())
    return holds


@dataclass(frozen=True)
class Agreement:
    """How often the collision check and the whole simulation of a trial say the same.

    Attributes:
        trials: random contacts and angles.
        filtered: share that the check alone decides.
        collided: share that touches something on its way in physics.
        same_collision: share of trials where both agree on the collision.
        same_success: share of trials where both agree on the success.
        success: share of successes, by check and physics as labels are made.
        success_of_free: share of successes among the trials whose hand fits.
    """

    trials: int
    filtered: float
    collided: float
    same_collision: float
    same_success: float
    success: float
    success_of_free: float


def measure_agreement(object_set: ObjectSet, split: Split, gripper: Gripper, trials: int, seed: int) -> Agreement:
    """Runs random trials twice: filtered as for labels, and with the approach simulated as well.

    Raises:
        InputError: the object set has nothing for this split.
    """
    rows: list[tuple[bool, bool, bool, bool]] = []
    stream = 0
    while len(rows) < trials:
        kind: Kind = "packed" if stream % 2 == 0 else "pile"
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream,)))
        rows += _compare(spawn_scene(kind, object_set, split, rng, OBJECTS), object_set, gripper, rng)
        stream += 1
    filtered, collided, fast, full = np.array(rows[:trials]).T
    return Agreement(
        trials,
        filtered=float(filtered.mean()),
        collided=float(collided.mean()),
        same_collision=float((filtered == collided).mean()),
        same_success=float((fast == full).mean()),
        success=float(fast.mean()),
        success_of_free=float(fast[~filtered].mean()) if not filtered.all() else float("nan"),
    )


def _compare(
    scene: Scene, object_set: ObjectSet, gripper: Gripper, rng: np.random.Generator
) -> list[tuple[bool, bool, bool, bool]]:
    """One random angle at each contact of a scene: filtered, collided in physics, both successes."""
    if not scene.objects:
        return []
    bodies = [Body(object_set.model(each.name), each.scale, each.T_world_object) for each in scene.objects]
    trials = Trials(bodies, gripper, Physics())
    contacts = sample_contacts([world_mesh(each, object_set) for each in scene.objects], CONTACTS, rng)
    widths = contacts.widths[:, 0]
    jittered = Jitter().apply(contacts.positions, contacts.normals, rng)
    poses, openings = grasp_poses(*jittered, widths, gripper.finger_reach), gripper.opening(widths)
    rows = []
    for index in np.flatnonzero(widths < gripper.max_opening):
        angle, opening = int(rng.integers(poses.shape[1])), float(openings[index])
        pose = draw_back(poses[index, [angle]], openings[[index]], gripper, TABLE_HEIGHT)[0]
        target = int(contacts.objects[index])
        filtered = bool(trials.checker.collides(pose[None], np.array([opening]))[0])
        fast = False if filtered else trials.run(pose, opening, target).success
        full = trials.run_with_approach(pose, opening, target)
        rows.append((filtered, full.collided, fast, full.success))
    return rows


@dataclass(frozen=True)
class SimulationNumbers:
    """Everything that the study measures.

    Attributes:
        traces: the published grasps.
        creep: of every object that can be held, by name.
        scenes: packed ones, then piles.
        agreement: of the label filter with the whole physics.
    """

    traces: tuple[Trace, ...]
    creep: dict[str, Hold]
    scenes: tuple[SceneNumbers, ...]
    agreement: Agreement


def measure(config: SimulationConfig) -> SimulationNumbers:
    """Measures all of it.

    Raises:
        IcgnetError: not the VGN object set, or an unusable gripper.
    """
    object_set, gripper = load_object_set(config.objects), load_gripper(config.gripper)
    return SimulationNumbers(
        traces=tuple(measure_traces(object_set, gripper)),
        creep=measure_creep(object_set, config.split, gripper),
        scenes=tuple(measure_scenes(kind, object_set, config.split, config.scenes, config.seed) for kind in KINDS),
        agreement=measure_agreement(object_set, config.split, gripper, config.trials, config.seed),
    )


def tables(numbers: SimulationNumbers) -> list[Table]:
    """Ours beside the published values."""
    return [
        _trace_table(numbers.traces, numbers.creep),
        _scene_table(*numbers.scenes),
        _agreement_table(numbers.agreement),
    ]


def _trace_table(traces: Sequence[Trace], holds: Mapping[str, Hold]) -> Table:
    rows = []
    for trace in traces:
        ours, theirs = trace.ours, trace.published.width
        solid = theirs - TRACE_STANDOFF
        values = (ours.lifted, theirs, solid, ours.lifted - solid, ours.rise, ours.creep)
        rows.append((trace.published.name.partition("/")[2][:20], *(f"{1e3 * value:.1f}" for value in values)))
    held = {name: hold.creep for name, hold in holds.items() if hold.is_held}
    note = f"held still for 5 s: {len(held)} of {len(holds)} pile objects could be grasped from above"
    if held:
        worst = max(held, key=lambda name: held[name])
        note += f"; the most that one moved in the hand is {1e3 * held[worst]:.2f} mm ({worst})"
    return Table(
        ("object", "width", "published", "less standoff", "difference", "rise", "creep"),
        rows,
        title=f"grasps from above, in mm; the published hand rises by {1e3 * TRACE_RISE:.1f}",
        notes=(note,),
    )


def _scene_table(stood: SceneNumbers, dropped: SceneNumbers) -> Table:
    packed, pile = SCENES[stood.kind], SCENES[dropped.kind]
    values: dict[str, tuple[float | None, ...]] = {
        "placed, mean": (stood.placed, packed.placed, dropped.placed, pile.placed),
        "lost": (stood.lost, packed.lost, dropped.lost, pile.lost),
        "lost by falling through the table": (0.0, 0.0, 0.0, PILE_FELL_THROUGH),
        "rejected share of attempts": (stood.rejected, packed.rejected, None, None),
        "tilted by more than 20 degrees": (stood.tilted, packed.tilted, None, None),
        "top speed, m/s": (stood.top_speed, None, dropped.top_speed, None),
    }
    rows = [
        (name, *(NOTHING if value is None else f"{value:.2f}" for value in numbers)) for name, numbers in values.items()
    ]
    return Table(("scenes of five objects", stood.kind, "published", dropped.kind, "published"), rows)


def _agreement_table(agreement: Agreement) -> Table:
    names = ("filtered", "same_collision", "same_success", "success", "success_of_free")
    shares = [(name.replace("_", " "), f"{100 * getattr(agreement, name):.2f} %") for name in names]
    return Table(("label filter against the whole physics", ""), [("trials", str(agreement.trials)), *shares])
