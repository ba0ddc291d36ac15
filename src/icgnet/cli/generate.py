"""`icgnet generate`: labelled scenes for training."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

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
from icgnet.datagen.config import GenerateConfig

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

    out: Path
    """Folder for the Parquet files, manifest.json and report.json."""
    config: Annotated[GenerateConfig, tyro.conf.arg(name="")] = field(default_factory=GenerateConfig)
    """What to generate."""

    def run(self) -> None:
        """Generates, with a progress bar.

        Raises:
            IcgnetError: unknown objects, settings out of range, or a folder made with other settings.
        """
        from icgnet.datagen.generate import generate

        console = Console()
        with Progress(*COLUMNS, console=console) as progress:

            def show(done: int) -> None:
                if progress.tasks:
                    progress.update(progress.task_ids[0], completed=done)
                else:
                    progress.add_task("scenes", total=self.config.scenes, completed=done)

            numbers = generate(self.out, self.config, on_progress=show, on_notice=print_notice)
        console.print(
            f"{numbers.scenes} new scenes, {numbers.scenes_found} were there already; {numbers.labels} labels, "
            f"{numbers.positives} of them successes, {numbers.labels_per_second_per_core:.0f} labels a second and core",
            soft_wrap=True,
        )
