"""Generates labelled scenes on any number of workers: resumable, and the same files whoever made the scenes."""

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, field
from pathlib import Path

from icgnet.datagen.config import GenerateConfig
from icgnet.datagen.job import GenerateJob
from icgnet.datagen.manifest import make_manifest, prepare_folder
from icgnet.datagen.recipe import LabelHeader, Recipe, count_scenes, read_shard, write_shard
from icgnet.datagen.report import GenerationReport, GenerationTally, make_report
from icgnet.datagen.usable_objects import usable_objects
from icgnet.files import remove_partial_files, write_json
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.kinds import Kind
from icgnet.parallel.cluster import RayPool
from icgnet.parallel.lock import locked
from icgnet.parallel.pool import Pool, local_pool

REPORT = "report.json"
"""Numbers of the last run that made scenes."""


@dataclass(frozen=True)
class Shard:
    """A file of the folder.

    Attributes:
        path: of the file.
        ids: numbers of the scenes that belong in it.
        found: the recipes of these that are there already, from an earlier run that asked for fewer scenes.
    """

    path: Path
    ids: range
    found: dict[int, Recipe] = field(default_factory=dict)

    @property
    def missing(self) -> list[int]:
        """Numbers of the scenes that must be made."""
        return [scene_id for scene_id in self.ids if scene_id not in self.found]


def generate(
    directory: str | Path,
    config: GenerateConfig,
    on_progress: Callable[[int], None] = lambda done: None,
    on_notice: Callable[[str], None] = lambda notice: None,
) -> GenerationReport:
    """Writes labelled scenes into a folder: a manifest, Parquet files, and the numbers of the run as report.json.

    Finished files stay when a run is killed, and the next run with the same configuration goes on from there.

    Args:
        directory: output folder, made if it is missing.
        config: what to generate.
        on_progress: called with the number of finished scenes, at the start and after each scene.
        on_notice: called with one line on each object that is left out, and one on all that look odd.

    Raises:
        InputError: unknown objects, none that can be used for these scenes and split, or no Ray where it is asked for.
        DataError: a folder that another run is writing into, one that was made with another configuration or has a
            broken file, a disk that cannot be written to, or a scene that kills its workers.
    """
    directory = Path(directory)
    usable = usable_objects(config)
    for notice in usable.notices():
        on_notice(notice)
    job = GenerateJob(config, usable.object_set, load_gripper(config.gripper))
    directory.mkdir(parents=True, exist_ok=True)
    with locked(directory):
        prepare_folder(directory, make_manifest(job, usable.doubtful, usable.never_drawn))
        remove_partial_files(directory)
        result = _fill(directory, job, on_progress)
        if result.scenes:
            write_json(directory / REPORT, asdict(result))
    return result


def _fill(directory: Path, job: GenerateJob, on_progress: Callable[[int], None]) -> GenerationReport:
    """Makes the scenes that a folder lacks."""
    shards = list(_unfinished_shards(directory, job.config, job.header))
    missing = [scene_id for shard in shards for scene_id in shard.missing]
    found = job.config.scenes - len(missing)
    on_progress(found)
    tallies: dict[Kind, GenerationTally] = {kind: GenerationTally() for kind in job.config.kinds}
    workers, start = job.config.workers, time.perf_counter()
    if missing:
        with closing(_make_pool(job)) as pool:
            start = time.perf_counter()
            for done, recipe in enumerate(_write_when_full(shards, pool.make(missing), job.header), found + 1):
                tallies[recipe.kind].add(recipe)
                on_progress(done)
            workers = pool.workers
    return make_report(tallies, found, time.perf_counter() - start, workers, _bytes_per_scene(directory))


def _make_pool(job: GenerateJob) -> Pool[Recipe]:
    if job.config.ray is not None:
        return RayPool(job, job.config.ray, job.config.workers)
    return local_pool(job, job.config.workers)


def _unfinished_shards(directory: Path, config: GenerateConfig, header: LabelHeader) -> Iterator[Shard]:
    """The files to write, in the order of their scenes."""
    for start in range(0, config.scenes, config.shard_scenes):
        path = directory / f"scenes-{start:07d}.parquet"
        ids = range(start, min(start + config.shard_scenes, config.scenes))
        if not path.exists():
            yield Shard(path, ids)
        elif count_scenes(path) < len(ids):
            yield Shard(path, ids, {recipe.scene_id: recipe for recipe in read_shard(path, header)})


def _write_when_full(shards: Sequence[Shard], recipes: Iterable[Recipe], header: LabelHeader) -> Iterator[Recipe]:
    """Hands the recipes on, whose order is any, and writes each file as soon as its last scene is there."""
    shard_of = {scene_id: shard for shard in shards for scene_id in shard.missing}
    for recipe in recipes:
        shard = shard_of[recipe.scene_id]
        shard.found[recipe.scene_id] = recipe
        if len(shard.found) == len(shard.ids):
            write_shard(shard.path, [shard.found.pop(scene_id) for scene_id in shard.ids], header)
        yield recipe


def _bytes_per_scene(directory: Path) -> float:
    """Size of the files, divided by the number of scenes in them."""
    paths = list(directory.glob("scenes-*.parquet"))
    return sum(path.stat().st_size for path in paths) / max(1, sum(map(count_scenes, paths)))
