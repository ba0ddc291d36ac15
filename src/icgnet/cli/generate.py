"""`icgnet generate`: labelled scenes for training."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from icgnet.cli.notices import print_notice

COLUMNS = (
    TextColumn("scenes"),
    BarColumn(),
    MofNCompleteColumn(),
    TimeElapsedColumn(),
    TextColumn("of which left:"),
    TimeRemainingColumn(),
)


@dataclass(frozen=True)
class Generate:
    """Make labelled scenes in simulation, as Parquet files. Run it again to go on after an interruption."""

    out: tyro.conf.Positional[Path]
    """Folder for the Parquet files."""
    objects: str = "procedural"
    """'procedural', or a folder of URDFs (VGN layout) or meshes."""
    scene: Literal["packed", "pile", "both"] = "both"
    """Kind of scenes."""
    scenes: int = 100
    """Number of scenes."""
    contacts: int = 48
    """Contacts that are tried in each scene, at twelve angles each."""
    split: Literal["train", "val", "test"] = "train"
    """Which objects."""
    workers: int = 1
    """Processes; the result does not depend on it."""
    ray: str | None = None
    """Work on a Ray cluster instead: 'local' starts one here with so many workers, 'auto' or HOST:PORT joins one."""
    seed: int = 0
    """Of every random draw."""
    gripper: str = "franka"
    """Name of a gripper or a gripper file."""
    shard_scenes: int = 50
    """Scenes in a file."""
    report: Path | None = None
    """File for the run's numbers, as JSON."""

    def run(self) -> None:
        """Generates, with a progress bar.

        Raises:
            IcgnetError: unknown objects, settings out of range, or a folder made with other settings.
        """
        from icgnet.datagen.generate import generate
        from icgnet.datagen.job import GenerateConfig
        from icgnet.datagen.label_scene import LabelSettings

        config = GenerateConfig(
            objects=self.objects,
            scene=self.scene,
            scenes=self.scenes,
            split=self.split,
            seed=self.seed,
            gripper=self.gripper,
            labels=LabelSettings(contacts=self.contacts),
            shard_scenes=self.shard_scenes,
            workers=self.workers,
            ray=self.ray,
        )
        console = Console()
        with Progress(*COLUMNS, console=console) as progress:

            def show(done: int) -> None:
                if progress.tasks:
                    progress.update(progress.task_ids[0], completed=done)
                else:
                    progress.add_task("scenes", total=self.scenes, completed=done)

            numbers = generate(
                self.out,
                config,
                self.report,
                on_progress=show,
                on_notice=print_notice,
            )
        console.print(
            f"{numbers.scenes} new scenes, {numbers.scenes_found} were there already; {numbers.labels} labels, "
            f"{numbers.positives} of them successes, {numbers.labels_per_second_per_core:.0f} labels a second and core",
            soft_wrap=True,
        )
