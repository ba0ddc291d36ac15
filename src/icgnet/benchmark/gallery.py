"""Pictures of the worst attempts of a finished clutter benchmark: each is seen and planned again, and drawn."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain, zip_longest
from pathlib import Path

import numpy as np

from icgnet.benchmark.attempt_story import meeting_points, plain, story, target_index, title
from icgnet.benchmark.clutter import ROUNDS_FILE, read_rounds
from icgnet.benchmark.config import NOTHING_FOUND, ClutterConfig
from icgnet.benchmark.observation import Observation
from icgnet.benchmark.pictures import progress_bar
from icgnet.benchmark.planner import Plan, Planner
from icgnet.benchmark.planners.registry import load_planner
from icgnet.benchmark.rounds import Attempt, ClutterJob, Round, Shot, round_scene
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.errors import InputError
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.prediction import NO_INSTANCE, Prediction
from icgnet.objects.kinds import WIDE_KINDS
from icgnet.objects.object_set import load_object_set
from icgnet.output_folder import output_folder
from icgnet.simulation.scene import PlacedObject, Scene
from icgnet.viewer.attempt_picture import (
    PANEL,
    AttemptScene,
    DrawnGrasp,
    PredictedObject,
    Role,
    TrueObject,
    attempt_picture,
)
from icgnet.viewer.describe import object_name

GALLERY_FOLDER, INDEX_FILE = "gallery", "index.json"
ABOVE = 0.001  # a structure that rises this far above the support is drawn [m]; the table's edge and the floor do not


@dataclass(frozen=True, eq=False)
class Replay:
    """A picture of a round, seen and planned again.

    Attributes:
        shot: what was recorded.
        truth: the shapes that stood there.
        observation: what the planner saw.
        plan: what it made of that.
    """

    shot: Shot
    truth: TrueShapes
    observation: Observation
    plan: Plan


def cause_of(shot: Shot) -> str:
    """How an attempt ended, or that nothing was found."""
    return shot.cause if isinstance(shot, Attempt) else NOTHING_FOUND


def worst(rounds: Sequence[Round], count: int) -> list[Shot]:
    """At most `count` failures, one of each cause after the other, the most frequent cause first.

    Of a cause, those that the planner trusted most come first. Of the pictures in which nothing was found, the first
    ones of their round come first, and of these those with the most objects.

    Raises:
        InputError: fewer than none wanted.
    """
    if count < 0:
        raise InputError(f"the number of pictures must be at least 0, got {count}")
    ranked: list[tuple[float, Shot]] = []
    for each in rounds:
        ranked += [(-attempt.score, attempt) for attempt in each.attempts if not attempt.success]
        ranked += [(rank - 0.01 * len(shot.scene), shot) for rank, shot in enumerate(each.skipped)]
    ranked.sort(key=lambda item: (item[0], item[1].run, item[1].round, item[1].attempt))
    by_cause: dict[str, list[Shot]] = {}
    for _, shot in ranked:
        by_cause.setdefault(cause_of(shot), []).append(shot)
    groups = sorted(by_cause.items(), key=lambda item: (-len(item[1]), item[0]))
    mixed = chain.from_iterable(zip_longest(*(shots for _, shots in groups)))
    return [shot for shot in mixed if shot is not None][:count]


def scene_again(job: ClutterJob, shot: Shot) -> Scene:
    """What stood there: the objects as recorded; tables and bins as the round's random stream draws them again."""
    kind, stretches = job.config.scene, shot.stretches or [[1.0, 1.0, 1.0]] * len(shot.scene)
    placed = zip(shot.scene, shot.scales, shot.object_poses, stretches, strict=True)
    objects = tuple(PlacedObject(name, scale, np.array(pose), (x, y, z)) for name, scale, pose, (x, y, z) in placed)
    if kind not in WIDE_KINDS:
        return Scene(kind, objects)
    return Scene(kind, objects, round_scene(job.config, shot.run, shot.round, job.object_set).surroundings)


def look_again(job: ClutterJob, shot: Shot, planner: Planner) -> Replay:
    """The picture as it was taken, and the plan that was made of it, if the planner depends on nothing else."""
    scene = scene_again(job, shot)
    observation = job.look(shot.run, shot.round, shot.attempt, scene, planner.needs_truth)
    return Replay(shot, TrueShapes(scene, job.object_set), observation, planner.plan(observation))


def draw_replay(seen: Replay, panel: tuple[int, int] = PANEL) -> AttemptScene:
    """What the picture of a replay shows, in panels of this height and width [pixels]."""
    shot, cloud = seen.shot, seen.observation.cloud
    prediction = seen.plan.details if isinstance(seen.plan.details, Prediction) else None
    instances = np.full(len(cloud), NO_INSTANCE)
    predicted: tuple[PredictedObject, ...] = ()
    if prediction is not None:
        cloud, instances = prediction.cloud, prediction.cloud_instances
        predicted = tuple(
            PredictedObject(item.mesh(), item.instance_id, object_name(item), item.points)
            for item in prediction.objects
        )
    grasp = None
    if isinstance(shot, Attempt):
        marks = meeting_points(shot, seen.truth, seen.observation)
        grasp = DrawnGrasp(np.array(shot.pose), shot.opening, seen.observation.gripper, marks)
    structures = [each.mesh() for each in seen.truth.scene.surroundings.structures]
    return AttemptScene(
        title(shot),
        story(shot, seen.truth, seen.observation, seen.plan),
        _true_objects(seen),
        predicted,
        cloud,
        instances,
        seen.observation.T_world_camera,
        seen.observation.table_height,
        grasp,
        tuple(mesh for mesh in structures if mesh.bounds[1, 2] > seen.observation.table_height + ABOVE),
        panel,
    )


def draw_gallery(config: ClutterConfig, out: Path, count: int, panel: tuple[int, int] = PANEL) -> Path:
    """Draws the worst failures of a benchmark's folder into its folder `gallery`, which is replaced.

    Beside the pictures, index.json says what each shows.

    Args:
        config: of the benchmark.
        out: its folder.
        count: pictures at most.
        panel: height and width of each of the four parts of a picture [pixels].

    Returns:
        The folder with the pictures.

    Raises:
        InputError: a negative count, or a folder `gallery` with other files.
    """
    shots = worst(read_rounds(out / ROUNDS_FILE), count)
    job = ClutterJob(config, load_object_set(config.objects), load_gripper(config.gripper))
    planner = load_planner(config)
    with output_folder(out / GALLERY_FOLDER, INDEX_FILE) as folder:
        index = []
        for number, shot in enumerate(progress_bar(shots, "pictures")):
            seen = look_again(job, shot, planner)
            scene = draw_replay(seen, panel)
            name = f"{number:02d}_{cause_of(shot).replace(' ', '-')}_{shot.run}-{shot.round}-{shot.attempt}.png"
            attempt_picture(scene).save(folder / name)
            place = {"run": shot.run, "round": shot.round, "attempt": shot.attempt}
            index.append({"file": name, "cause": cause_of(shot), **place, "title": scene.title, "story": scene.story})
        (folder / INDEX_FILE).write_text(json.dumps(index, indent=1) + "\n")
    return out / GALLERY_FOLDER


def _true_objects(seen: Replay) -> tuple[TrueObject, ...]:
    """What stands there; after an attempt only what it met has a name, as of many those would not be seen."""
    shot, truth = seen.shot, seen.truth
    if not isinstance(shot, Attempt):
        labels = [f"{plain(each.name)} ({each.class_name})" for each in truth.objects]
        return tuple(TrueObject(mesh, "other", label) for mesh, label in zip(truth.meshes, labels, strict=True))
    target = target_index(shot, truth, seen.observation.gripper)
    objects = []
    for index, (name, mesh) in enumerate(zip(shot.scene, truth.meshes, strict=True)):
        role: Role = "target" if index == target else "touched" if name in shot.touched else "other"
        objects.append(TrueObject(mesh, role, "" if role == "other" else f"{role}: {plain(name)}"))
    return tuple(objects)
