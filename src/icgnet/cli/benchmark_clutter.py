"""`icgnet benchmark clutter`: grasp success rate and declutter rate of a planner."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from icgnet.cli.notices import load_objects
from icgnet.errors import InputError
from icgnet.inference.grasp_search import BEST_FEW, GraspSearch

if TYPE_CHECKING:
    from icgnet.benchmark.clutter import ClutterNumbers, Rate
    from icgnet.benchmark.config import ClutterConfig
    from icgnet.benchmark.rounds import Round


@dataclass(frozen=True)
class Clutter:
    """Let a planner grasp scenes empty, and count. Run it again to go on after an interruption."""

    out: Path
    """Folder for report.json, attempts.jsonl and what is needed to go on."""
    planner: str = "icgnet"
    """icgnet, antipodal, random, oracle, or module:Class of your own."""
    scene: Literal["packed", "pile"] = "packed"
    """Kind of scenes."""
    objects: str = "procedural"
    """'procedural', or a folder of URDFs (VGN layout) or meshes."""
    split: Literal["train", "val", "test"] = "test"
    """Which objects: val for choosing, test for reporting."""
    view: Literal["random", "side", "top"] = "random"
    """Where the camera stands."""
    noise: Literal["none", "gaussian", "dex"] = "gaussian"
    """What the sensor does."""
    protocol: Literal["edge", "strict"] = "edge"
    """What counts as a success: the published rules, or a free approach and the right object held."""
    opening: Literal["full", "predicted"] | None = None
    """How far the hand is open while it approaches; full in the protocol edge, predicted in strict, if not given."""
    runs: int = 4
    """How often the rounds are repeated, with other scenes."""
    rounds: int = 100
    """Scenes of a run."""
    workers: int = 1
    """Processes; every round draws the same whatever their number is."""
    seed: int = 1
    """Of every random draw."""
    weights: Path | None = None
    """Weights file for icgnet; the one that ships with the package if not given."""
    threads: int = 1
    """CPU threads of the network in each process."""
    search: Annotated[GraspSearch, tyro.conf.arg(name="search")] = BEST_FEW
    """How icgnet looks for grasps; its opening is that of --opening."""
    level_table: bool = True
    """For icgnet: take out a wrong depth scale, which the known height of the table tells."""
    gallery: int = 0
    """Draw so many of the worst failures into the folder's gallery/, the causes mixed; also of a finished benchmark."""

    def run(self) -> None:
        """Plays all rounds, and prints the rates and why attempts failed.

        Raises:
            IcgnetError: unknown planner or objects, settings out of range, or a folder with another benchmark.
        """
        if self.gallery < 0:
            raise InputError(f"gallery must be at least 0 pictures, got {self.gallery}")
        from icgnet.benchmark.clutter import run_clutter, summarise
        from icgnet.benchmark.config import ClutterConfig
        from icgnet.benchmark.planners.registry import PlannerSource

        config = ClutterConfig(
            planner=PlannerSource(self.planner, self.weights, self.threads, self.search, self.level_table),
            scene=self.scene,
            objects=self.objects,
            split=self.split,
            view=self.view,
            noise=self.noise,
            protocol=self.protocol,
            opening=self.opening,
            runs=self.runs,
            rounds=self.rounds,
            seed=self.seed,
        )
        load_objects(self.objects)  # the workers load their own; here it says what is left out
        console = Console()
        with _progress(console, "rounds") as progress:
            task = progress.add_task("", total=self.runs * self.rounds)

            def show(rounds: Sequence["Round"]) -> None:
                text = "" if not rounds else _rates_line(summarise(rounds))
                progress.update(task, completed=len(rounds), description=text)

            numbers = run_clutter(config, self.out, self.workers, show)
        title = (
            f"{self.planner}: {self.scene} scenes of {self.split} objects from {self.objects}, view {self.view}, "
            f"noise {self.noise}, protocol {self.protocol}, opening {'full' if config.full_opening else 'predicted'}"
        )
        console.print(_table(numbers, title, self.runs))
        if self.gallery:
            self._draw(config, console)

    def _draw(self, config: "ClutterConfig", console: Console) -> None:
        from icgnet.benchmark.gallery import draw_gallery

        with _progress(console, "pictures") as progress:
            task = progress.add_task("", total=None)
            folder = draw_gallery(
                config, self.out, self.gallery, lambda done, of: progress.update(task, completed=done, total=of)
            )
        console.print(f"pictures of the worst attempts: {folder}", soft_wrap=True)


def _progress(console: Console, what: str) -> Progress:
    return Progress(
        TextColumn(what),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.description}"),
        TimeRemainingColumn(),
        console=console,
    )


def _rates_line(numbers: "ClutterNumbers") -> str:
    return f"GSR {numbers.gsr.mean:.1f} DR {numbers.dr.mean:.1f}"


def _table(numbers: "ClutterNumbers", title: str, runs: int) -> Table:
    table = Table(title=title)
    table.add_column("what")
    table.add_column("value", justify="right")
    table.add_row("grasp success rate, %", _rate(numbers.gsr, runs))
    table.add_row("declutter rate, %", _rate(numbers.dr, runs))
    table.add_row("rounds, objects, attempts", f"{numbers.rounds}, {numbers.objects}, {numbers.attempts}")
    for cause, count in sorted(numbers.failures.items(), key=lambda item: -item[1]):
        table.add_row(cause if cause == "nothing found" else f"failed: {cause}", str(count))
    table.add_row("attempts that touched something else on their way", str(numbers.touching))
    table.add_row("objects pushed out of the workspace", str(numbers.lost))
    table.add_row("planning, median", f"{numbers.plan_seconds:.2f} s")
    return table


def _rate(rate: "Rate", runs: int) -> str:
    spread = f" ± {rate.std:.1f}" if runs > 1 else ""
    return f"{rate.mean:.1f}{spread} (95 %: {rate.low:.1f} to {rate.high:.1f})"
