"""Is the simulation true? Scenes and grasps beside the published ones, creep, explosions, and the label filter."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Bool

from icgnet.benchmark.statistics import Metric, evaluate, mean, table
from icgnet.benchmark.tables import Table
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.collision import draw_back
from icgnet.grasping.frame import grasp_poses
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.kinds import CUBE_KINDS, Kind, Split
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.simulation.config import Jitter, Physics
from icgnet.simulation.contacts import sample_contacts
from icgnet.simulation.holds import Hold, hold_from_above
from icgnet.simulation.physics import scene_bodies
from icgnet.simulation.scene import Scene, world_mesh
from icgnet.simulation.scenes import Spawn, spawn, spawn_scene
from icgnet.simulation.trials import Trials
from icgnet.studies.config import SimulationConfig

PUBLISHED: dict[str, Any] = yaml.safe_load((Path(__file__).parent / "published.yaml").read_text(encoding="utf-8"))
"""What the published simulators do; the file names the sources."""

OBJECTS = 5  # objects to try for in every scene, as in the benchmark
TILTED = np.deg2rad(20.0)
CONTACTS = 40  # contacts of a scene whose decisions are compared
CREEP_SCALE = 0.9  # of the objects that are held still


@dataclass(frozen=True)
class Trace:
    """One published grasp (name and scale of the object, width after the lift [m]) and ours."""

    published: dict[str, Any]
    ours: Hold


@dataclass(frozen=True, eq=False)
class TwiceDecided:
    """Random trials, decided as for labels and again with the approach simulated as well.

    Attributes:
        filtered: the collision check alone decides.
        collided: the hand touches something on its way in physics.
        success: by check and physics, as labels are made.
        full_success: with the approach simulated.
    """

    filtered: Bool[np.ndarray, "n"]
    collided: Bool[np.ndarray, "n"]
    success: Bool[np.ndarray, "n"]
    full_success: Bool[np.ndarray, "n"]


@dataclass(frozen=True)
class SimulationNumbers:
    """Everything that the study measures.

    Attributes:
        traces: the published grasps.
        creep: of every object that can be held, by name.
        scenes: what `measure_scenes` finds for both kinds.
        agreement: each of `AGREEMENT_NUMBERS`.
    """

    traces: tuple[Trace, ...]
    creep: dict[str, Hold]
    scenes: dict[Kind, dict[str, Any]]
    agreement: dict[str, Any]


def measure(config: SimulationConfig) -> SimulationNumbers:
    """Measures all of it.

    Raises:
        IcgnetError: not the VGN object set, or an unusable gripper.
    """
    object_set, gripper = load_object_set(config.objects), load_gripper(config.gripper)
    return SimulationNumbers(
        traces=measure_traces(object_set, gripper),
        creep=measure_creep(object_set, config.split, gripper),
        scenes={
            kind: measure_scenes(kind, object_set, config.split, config.scenes, config.seed) for kind in CUBE_KINDS
        },
        agreement=measure_agreement(object_set, config.split, gripper, config.trials, config.seed),
    )


def tables(numbers: SimulationNumbers) -> list[Table]:
    """Ours beside the published values."""
    published = PUBLISHED["scenes"]
    beside = [column for kind, ours in numbers.scenes.items() for column in (ours, published[kind])]
    headers = [header for kind in numbers.scenes for header in (kind, "published")]
    fell = f"of the published lost ones in piles, {published['pile']['fell_through']} a scene fall through the table"
    return [
        _trace_table(numbers),
        table(("scenes of five objects", *headers), SCENE_NUMBERS, *beside, notes=(fell,)),
        table(("label filter against the whole physics", ""), AGREEMENT_NUMBERS, numbers.agreement),
    ]


def measure_traces(object_set: ObjectSet, gripper: Gripper) -> tuple[Trace, ...]:
    """Repeats the published reference grasps.

    Raises:
        InputError: the object set is not VGN's.
    """
    return tuple(
        Trace(each, hold_from_above(object_set.model(each["name"]), each["scale"], gripper, Physics()))
        for each in PUBLISHED["traces"]
    )


def measure_creep(object_set: ObjectSet, split: Split, gripper: Gripper) -> dict[str, Hold]:
    """Holds every pile object that fits into the hand for five seconds; results by name.

    Some stand too badly on their own, or are too thin where the hand closes, to be held at all.
    """
    models = {name: object_set.model(name) for name in object_set.names("pile", split)}
    return {
        name: hold_from_above(model, CREEP_SCALE, gripper, Physics())
        for name, model in models.items()
        if (model.visual.extents[:2] * CREEP_SCALE).min() < gripper.max_opening
    }


def measure_scenes(kind: Kind, object_set: ObjectSet, split: Split, scenes: int, seed: int) -> dict[str, Any]:
    """Makes random scenes of five objects; `SCENE_NUMBERS`, and how many scenes have 0, 1, ... objects.

    Raises:
        InputError: the object set has nothing for this kind and split.
    """
    streams = map(np.random.default_rng, np.random.SeedSequence(seed).spawn(scenes))
    spawns = [spawn(kind, object_set, split, stream, OBJECTS, watch_speed=True) for stream in streams]
    placed = np.bincount([len(each.scene.objects) for each in spawns], minlength=OBJECTS + 1)
    return evaluate(SCENE_NUMBERS, spawns) | {"placed_histogram": tuple(placed.tolist())}


def measure_agreement(object_set: ObjectSet, split: Split, gripper: Gripper, trials: int, seed: int) -> dict[str, Any]:
    """Runs random trials twice, filtered as for labels and with the approach simulated, and finds `AGREEMENT_NUMBERS`.

    Raises:
        InputError: the object set has nothing for this split.
    """
    rows: list[tuple[bool, bool, bool, bool]] = []
    stream = 0
    while len(rows) < trials:
        kind: Kind = "packed" if stream % 2 == 0 else "pile"
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(stream,)))
        rows += _decide_twice(spawn_scene(kind, object_set, split, rng, OBJECTS), object_set, gripper, rng)
        stream += 1
    return evaluate(AGREEMENT_NUMBERS, TwiceDecided(*np.array(rows[:trials]).T))


def _decide_twice(
    scene: Scene, object_set: ObjectSet, gripper: Gripper, rng: np.random.Generator
) -> list[tuple[bool, bool, bool, bool]]:
    """The fields of `TwiceDecided` for one random angle at each contact of a scene."""
    if not scene.objects:
        return []
    bodies = scene_bodies(scene, object_set)
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


def _tilted(spawns: Sequence[Spawn]) -> float | None:
    """Share of the objects whose z axis is tilted; of interest where they were stood up."""
    upright = [placed.T_world_object[2, 2] for each in spawns for placed in each.scene.objects]
    return mean(np.arccos(np.clip(upright, -1.0, 1.0)) > TILTED)


SCENE_NUMBERS: dict[str, Metric[Sequence[Spawn]]] = {
    "scenes": Metric("scenes", len, "d"),
    "placed": Metric("placed, mean", lambda spawns: mean(len(each.scene.objects) for each in spawns)),
    "attempts": Metric("attempts, mean", lambda spawns: mean(each.attempts for each in spawns)),
    "rejected": Metric(
        "rejected share of attempts", lambda spawns: sum(s.rejected for s in spawns) / sum(s.attempts for s in spawns)
    ),
    "lost": Metric("lost, mean", lambda spawns: mean(each.lost for each in spawns)),
    "tilted": Metric("tilted by more than 20 degrees", _tilted),
    "top_speed": Metric("top speed, m/s", lambda spawns: max(each.top_speed for each in spawns)),
}
"""Of random scenes; rejected are objects that had no room, lost are those that left the workspace."""

AGREEMENT_NUMBERS: dict[str, Metric[TwiceDecided]] = {
    "trials": Metric("trials", lambda trials: len(trials.filtered), "d"),
    "filtered": Metric("filtered", lambda trials: mean(trials.filtered), ".2%"),
    "collided": Metric("collided in physics", lambda trials: mean(trials.collided), ".2%"),
    "same_collision": Metric("same collision", lambda trials: mean(trials.filtered == trials.collided), ".2%"),
    "same_success": Metric("same success", lambda trials: mean(trials.success == trials.full_success), ".2%"),
    "success": Metric("success", lambda trials: mean(trials.success), ".2%"),
    "success_of_free": Metric("success of free", lambda trials: mean(trials.success[~trials.filtered]), ".2%"),
}
"""How often the collision check and the whole simulation of a trial say the same; free are those it lets through."""


def _trace_table(numbers: SimulationNumbers) -> Table:
    rows = []
    for trace in numbers.traces:
        ours, theirs = trace.ours, trace.published["width"]
        solid = theirs - PUBLISHED["trace_standoff"]
        values = (ours.lifted, theirs, solid, ours.lifted - solid, ours.rise, ours.creep)
        rows.append((trace.published["name"].partition("/")[2][:20], *(f"{1e3 * value:.1f}" for value in values)))
    held = {name: hold.creep for name, hold in numbers.creep.items() if hold.is_held}
    note = f"held still for 5 s: {len(held)} of {len(numbers.creep)} pile objects could be grasped from above"
    if held:
        worst = max(held, key=lambda name: held[name])
        note += f"; the most that one moved in the hand is {1e3 * held[worst]:.2f} mm ({worst})"
    return Table(
        ("object", "width", "published", "less standoff", "difference", "rise", "creep"),
        rows,
        title=f"grasps from above, in mm; the published hand rises by {1e3 * PUBLISHED['trace_rise']:.1f}",
        notes=(note,),
    )
