"""`icgnet benchmark workcell`: a simulated arm clears a table into a box, or fetches one object."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from icgnet.benchmark.config import WorkcellConfig
from icgnet.cli.measurement import Flat
from icgnet.cli.notices import load_objects
from icgnet.cli.tables import print_table

if TYPE_CHECKING:
    from icgnet.benchmark.workcell.rounds import WorkcellRound


@dataclass(frozen=True, kw_only=True)
class Workcell:
    """Let a simulated arm with a camera on its wrist clear a table into a box, or fetch one object, and count.

    Needs the packages of icgnet[arm]. Run it again to go on after an interruption.
    """

    out: Path
    """Folder for report.json, rounds.jsonl with all picks, and what is needed to go on."""
    config: Annotated[WorkcellConfig, Flat]
    """What decides the numbers."""
    workers: int = 1
    """Processes; every round draws the same whatever their number is."""

    def run(self) -> None:
        """Plays all rounds, and prints what came of them.

        Raises:
            IcgnetError: unknown objects, unusable weights, settings out of range, a folder with another benchmark, or a
                missing extra.
        """
        from icgnet.benchmark.workcell.numbers import run_workcell, summarise, tables

        config = self.config
        load_objects(config.objects)  # the workers load their own; here it says what is left out
        console = Console()
        columns = (BarColumn(), MofNCompleteColumn(), TextColumn("{task.description}"), TimeRemainingColumn())
        with Progress(TextColumn("rounds"), *columns, console=console) as progress:
            task = progress.add_task("", total=config.rounds)

            def show(rounds: Sequence["WorkcellRound"]) -> None:
                text = ""
                if rounds:
                    numbers = summarise(rounds)
                    rates = {"GSR": numbers.gsr, "DR": numbers.dr}
                    text = " ".join(f"{name} {rate.mean:.1f}" for name, rate in rates.items() if rate)
                progress.update(task, completed=len({each.round for each in rounds}), description=text)

            numbers = run_workcell(config, self.out, self.workers, show)
        console.print(config.describe(), soft_wrap=True, markup=False, highlight=False)
        for table in tables(numbers):
            print_table(table)
