"""`icgnet benchmark clutter`: grasp success rate and declutter rate of a planner."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from icgnet.benchmark.config import ClutterConfig
from icgnet.cli.measurement import Flat
from icgnet.cli.notices import load_objects
from icgnet.cli.tables import print_table
from icgnet.errors import InputError

if TYPE_CHECKING:
    from icgnet.benchmark.rounds import Round


@dataclass(frozen=True, kw_only=True)
class Clutter:
    """Let a planner grasp scenes empty, and count. Run it again to go on after an interruption."""

    out: Path
    """Folder for report.json, rounds.jsonl with all attempts, and what is needed to go on."""
    config: Annotated[ClutterConfig, Flat]
    """What decides the numbers."""
    workers: int = 1
    """Processes; every round draws the same whatever their number is."""
    gallery: int = 0
    """Draw so many of the worst failures into the folder's gallery/, the causes mixed; also of a finished benchmark."""

    def run(self) -> None:
        """Plays all rounds, and prints the rates and why attempts failed.

        Raises:
            IcgnetError: unknown planner or objects, settings out of range, or a folder with another benchmark.
        """
        if self.gallery < 0:
            raise InputError(f"gallery must be at least 0 pictures, got {self.gallery}")
        from icgnet.benchmark.clutter import run_clutter, summarise, tables

        config = self.config
        load_objects(config.objects)  # the workers load their own; here it says what is left out
        console = Console()
        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
        with Progress(TextColumn("rounds"), *columns, console=console) as progress:
            task = progress.add_task("", total=config.runs * config.rounds)

            def show(rounds: Sequence["Round"]) -> None:
                text = ""
                if rounds:
                    numbers = summarise(rounds)
                    rates = {"GSR": numbers.gsr, "DR": numbers.dr}
                    text = " ".join(f"{name} {rate.mean:.1f}" for name, rate in rates.items() if rate)
                progress.update(task, completed=len(rounds), description=text)

            numbers = run_clutter(config, self.out, self.workers, show)
        console.print(config.describe(), soft_wrap=True, markup=False, highlight=False)
        for table in tables(numbers):
            print_table(table)
        if self.gallery:
            from icgnet.benchmark.gallery import draw_gallery

            folder = draw_gallery(config, self.out, self.gallery)
            console.print(f"pictures of the worst attempts: {folder}", soft_wrap=True)
