"""Generates labelled scenes on all cores of a machine: resumable, and the same rows on any number of workers."""

import json
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from importlib.metadata import PackageNotFoundError, version
from multiprocessing import get_context
from pathlib import Path
from typing import Literal, get_args

import numpy as np

from icgnet.datagen.label_scene import LabelSettings, label_scene
from icgnet.datagen.recipe import FORMAT_VERSION, MANIFEST, Recipe, read_manifest, read_shard, write_shard
from icgnet.errors import DataError, InputError
from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.object_set import KINDS, SPLITS, Kind, ObjectSet, Split, load_object_set

SHARD_SCENES = 50
SceneChoice = Literal["packed", "pile", "both"]


@dataclass(frozen=True)
class GenerateConfig:
    """What to generate.

    Attributes:
        objects: "procedural", or a folder of URDFs or meshes.
        scene: kind of scenes; "both" makes one packed scene for every two piles.
        scenes: number of scenes; a larger number continues a folder that has fewer.
        split: which objects: train, val or test.
        workers: processes.
        seed: of every random draw.
        gripper: name or YAML file.
        labels: contacts a scene, physics, jitter.
    """

    objects: str = "procedural"
    scene: SceneChoice = "both"
    scenes: int = 100
    split: Split = "train"
    workers: int = 1
    seed: int = 0
    gripper: str = "franka"
    labels: LabelSettings = field(default_factory=LabelSettings)

    def __post_init__(self) -> None:
        if self.scene not in get_args(SceneChoice):
            raise InputError(f"scene must be one of {', '.join(get_args(SceneChoice))}, got {self.scene!r}")
        if self.split not in SPLITS:
            raise InputError(f"split must be one of {', '.join(SPLITS)}, got {self.split!r}")
        for name, least in (("scenes", 1), ("workers", 1), ("seed", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name} must be at least {least}, got {getattr(self, name)}")


@dataclass(frozen=True)
class Report:
    """What a run did; scenes that an earlier run had finished count as `scenes_found` only.

    `labels_per_second_per_core` has the wall time times the number of workers in its denominator, building and
    settling of scenes included.
    """

    scenes: int
    scenes_found: int
    objects: int
    labels: int
    positives: int
    collided: int
    disturbed_positives: int
    seconds: float
    workers: int
    labels_per_second_per_core: float


def generate(
    directory: str | Path,
    config: GenerateConfig,
    report: str | Path | None = None,
    on_scene: Callable[[Recipe], None] | None = None,
) -> Report:
    """Writes labelled scenes into a folder: a manifest and Parquet files of 50 scenes each.

    Finished files stay when a run is killed, and the next run with the same configuration goes on from there.

    Args:
        directory: output folder, made if it is missing.
        config: what to generate.
        report: file for the run's numbers, as JSON.
        on_scene: called with every new scene, for progress.

    Raises:
        InputError: unknown objects, or none for this kind of scene and split.
        DataError: broken object files, a broken file in the folder, or a folder made with another configuration.
    """
    directory = Path(directory)
    object_set, gripper = load_object_set(config.objects), load_gripper(config.gripper)
    _prepare(directory, _manifest(config, object_set, gripper))
    todo = {
        shard: ids for shard, ids in _shards(config.scenes).items() if not _is_complete(directory / shard, len(ids))
    }
    tasks: list[tuple[int, Kind]] = [
        (scene_id, kind_of(config.scene, scene_id)) for ids in todo.values() for scene_id in ids
    ]

    tally = _Tally()
    start = time.perf_counter()
    recipes = _label_scenes(tasks, config, object_set, gripper)
    for shard, ids in todo.items():
        finished = []
        for _ in ids:
            finished.append(next(recipes))
            tally.add(finished[-1])
            if on_scene is not None:
                on_scene(finished[-1])
        write_shard(directory / shard, finished)
    result = tally.report(config.scenes - len(tasks), time.perf_counter() - start, config.workers)
    if report is not None:
        _write_json(Path(report), asdict(result))
    return result


def kind_of(choice: SceneChoice, scene_id: int) -> Kind:
    """The kind of a scene in a run."""
    if choice == "both":
        return "packed" if scene_id % 3 == 0 else "pile"
    return choice


def _shards(scenes: int) -> dict[str, range]:
    """File names and the scene ids that belong in each."""
    starts = range(0, scenes, SHARD_SCENES)
    return {f"scenes-{start:07d}.parquet": range(start, min(start + SHARD_SCENES, scenes)) for start in starts}


def _is_complete(path: Path, scenes: int) -> bool:
    """Whether a shard is there with at least this many scenes; an earlier, smaller run leaves a shorter last one."""
    return path.exists() and len(read_shard(path)) >= scenes


def _label_scenes(
    tasks: list[tuple[int, Kind]], config: GenerateConfig, object_set: ObjectSet, gripper: Gripper
) -> Iterator[Recipe]:
    """The labelled scenes in the order of the tasks."""
    if config.workers == 1 or len(tasks) < 2:
        worker = _Worker(config, object_set, gripper)
        yield from (worker(task) for task in tasks)
        return
    pool = ProcessPoolExecutor(
        config.workers, get_context("spawn"), initializer=_start_worker, initargs=(config, object_set, gripper)
    )
    try:
        yield from pool.map(_work, tasks)
    finally:
        pool.shutdown(cancel_futures=True)


@dataclass(frozen=True)
class _Worker:
    config: GenerateConfig
    object_set: ObjectSet
    gripper: Gripper

    def __call__(self, task: tuple[int, Kind]) -> Recipe:
        scene_id, kind = task
        config = self.config
        return label_scene(scene_id, config.seed, kind, config.split, self.object_set, self.gripper, config.labels)


# A process of the pool keeps its object set, so that meshes are read once and not for every scene.
_worker: _Worker | None = None


def _start_worker(config: GenerateConfig, object_set: ObjectSet, gripper: Gripper) -> None:
    global _worker
    _worker = _Worker(config, object_set, gripper)


def _work(task: tuple[int, Kind]) -> Recipe:
    assert _worker is not None
    return _worker(task)


def _manifest(config: GenerateConfig, object_set: ObjectSet, gripper: Gripper) -> dict[str, object]:
    """Everything that decides what the rows are, and the version of the code that made them."""
    kinds = KINDS if config.scene == "both" else (config.scene,)
    labels = asdict(config.labels)
    return {
        "format_version": FORMAT_VERSION,
        "code_version": _code_version(),
        "object_set": object_set.name,
        "object_counts": {kind: len(object_set.names(kind, config.split)) for kind in kinds},
        "split": config.split,
        "scene": config.scene,
        "seed": config.seed,
        "angles_deg": np.rad2deg(APPROACH_ANGLES).round(6).tolist(),
        "gripper": asdict(gripper) | {"T_grasp_base": gripper.T_grasp_base.tolist()},
        **labels,
    }


def _prepare(directory: Path, manifest: dict[str, object]) -> None:
    """Makes the folder with its manifest, or checks that the one that is there asks for the same rows."""
    manifest = json.loads(json.dumps(manifest))
    path = directory / MANIFEST
    if not path.exists():
        directory.mkdir(parents=True, exist_ok=True)
        if any(directory.glob("*.parquet")):
            raise DataError(f"{directory}: has Parquet files but no {MANIFEST}; give another folder")
        _write_json(path, manifest)
        return
    found = read_manifest(directory)
    differences = [
        f"{key} is {found.get(key)} there, {manifest.get(key)} now"
        for key in sorted(manifest.keys() | found.keys())
        if key != "code_version" and manifest.get(key) != found.get(key)
    ]
    if differences:
        raise DataError(f"{directory}: made with another configuration: {'; '.join(differences)}")


def _code_version() -> str:
    try:
        return version("icgnet")
    except PackageNotFoundError:
        return "unknown"


def _write_json(path: Path, values: dict[str, object]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(json.dumps(values, indent=2) + "\n")
    os.replace(partial, path)


@dataclass
class _Tally:
    scenes: int = 0
    objects: int = 0
    labels: int = 0
    positives: int = 0
    collided: int = 0
    disturbed_positives: int = 0

    def add(self, recipe: Recipe) -> None:
        contacts = recipe.contacts
        self.scenes += 1
        self.objects += len(recipe.objects)
        self.labels += len(APPROACH_ANGLES) * len(contacts)
        self.positives += _count_bits(contacts.success)
        self.collided += _count_bits(contacts.collided)
        self.disturbed_positives += _count_bits(contacts.success & contacts.disturbed)

    def report(self, found: int, seconds: float, workers: int) -> Report:
        rate = self.labels / (seconds * workers) if self.labels else 0.0
        return Report(
            **asdict(self), scenes_found=found, seconds=seconds, workers=workers, labels_per_second_per_core=rate
        )


def _count_bits(bits: np.ndarray) -> int:
    return int(np.bitwise_count(bits).sum())
