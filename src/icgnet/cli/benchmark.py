"""`icgnet benchmark`: the numbers that this project reports, one subcommand each."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.console import Console
from rich.table import Table

from icgnet.benchmark.record import write_report
from icgnet.cli.benchmark_clutter import Clutter
from icgnet.cli.benchmark_labels import LabelCeilings
from icgnet.cli.benchmark_network import Latency, Reconstruction, Segmentation
from icgnet.cli.benchmark_report import Report
from icgnet.cli.benchmark_training import Speed
from icgnet.cli.notices import load_objects

if TYPE_CHECKING:
    from icgnet.benchmark.simulation import Agreement, SceneNumbers, Trace
    from icgnet.simulation.holds import Hold


@dataclass(frozen=True)
class Simulation:
    """Scenes and grasps of the simulator beside the published ones; creep, top speeds, and the label filter."""

    objects: Path
    """Folder of the VGN object set."""
    split: Literal["train", "val", "test"] = "test"
    """Which objects the scenes are made of."""
    scenes: int = 60
    """Scenes of each kind."""
    trials: int = 2000
    """Trials whose filtered decision is compared with the whole physics."""
    seed: int = 0
    """Of every random draw."""
    out: Path | None = None
    """Folder for report.json."""

    def run(self) -> None:
        """Measures, and prints ours beside the published values.

        Raises:
            IcgnetError: not the VGN object set, or settings out of range.
        """
        from icgnet.benchmark.simulation import measure_agreement, measure_creep, measure_scenes, measure_traces
        from icgnet.grasping.gripper import load_gripper

        object_set, gripper = load_objects(self.objects), load_gripper()
        console = Console()
        traces = measure_traces(object_set, gripper)
        console.print(_trace_table(traces))
        holds = measure_creep(object_set, self.split, gripper)
        console.print(_creep_line(holds))
        numbers = [measure_scenes(kind, object_set, self.split, self.scenes, self.seed) for kind in ("packed", "pile")]
        console.print(_scene_table(numbers))
        agreement = measure_agreement(object_set, self.split, gripper, self.trials, self.seed)
        console.print(_agreement_table(agreement))
        report = {
            "benchmark": "simulation",
            "settings": {"objects": str(self.objects), "split": self.split, "seed": self.seed},
            "traces": [asdict(trace) for trace in traces],
            "creep": {name: asdict(hold) for name, hold in holds.items()},
            "scenes": [asdict(each) for each in numbers],
            "agreement": asdict(agreement),
        }
        write_report(self.out, report)


@dataclass(frozen=True)
class Loader:
    """How many scenes a second one core makes ready for training."""

    data: tyro.conf.Positional[tuple[Path, ...]]
    """Folders that `icgnet generate` wrote."""
    objects: tuple[str, ...] = ("procedural",)
    """The object sets that the scenes were made of."""
    preset: Literal["cpu", "paper"] = "cpu"
    """Training preset."""
    visits: int = 60
    """Visits to time."""
    out: Path | None = None
    """Folder for report.json."""

    def run(self) -> None:
        """Measures, and prints the time of a visit.

        Raises:
            IcgnetError: no usable scenes, or settings out of range.
        """
        from icgnet.benchmark.loader import measure_loader
        from icgnet.training.config import TRAININGS

        numbers = measure_loader(self.data, self.objects, TRAININGS[self.preset], self.visits)
        Console().print(
            f"{numbers.scenes_per_second:.1f} scenes a second on one core; a visit takes {numbers.median_ms:.0f} ms "
            f"({numbers.p10_ms:.0f} to {numbers.p90_ms:.0f} ms, 10th to 90th percentile of {numbers.visits})",
            soft_wrap=True,
        )
        settings = {"data": [str(folder) for folder in self.data], "preset": self.preset}
        write_report(self.out, {"benchmark": "loader", "settings": settings, "loader": asdict(numbers)})


@dataclass(frozen=True)
class Benchmark:
    """Measure what this project claims."""

    number: Annotated[
        Annotated[Clutter, tyro.conf.subcommand("clutter")]
        | Annotated[Simulation, tyro.conf.subcommand("simulation")]
        | Annotated[Loader, tyro.conf.subcommand("loader")]
        | Annotated[LabelCeilings, tyro.conf.subcommand("label-ceiling")]
        | Annotated[Speed, tyro.conf.subcommand("training-speed")]
        | Annotated[Reconstruction, tyro.conf.subcommand("reconstruction")]
        | Annotated[Segmentation, tyro.conf.subcommand("segmentation")]
        | Annotated[Latency, tyro.conf.subcommand("latency")]
        | Annotated[Report, tyro.conf.subcommand("report")],
        tyro.conf.arg(name=""),
    ]
    """What to measure."""

    def run(self) -> None:
        """Measures."""
        self.number.run()


def _trace_table(traces: list["Trace"]) -> Table:
    from icgnet.benchmark.published import TRACE_RISE, TRACE_STANDOFF

    title = f"grasps from above, in mm; the published hand rises by {1e3 * TRACE_RISE:.1f}"
    table = Table("object", "width", "published", "less standoff", "difference", "rise", "creep", title=title)
    for trace in traces:
        ours, theirs = trace.ours, trace.published.width
        solid = theirs - TRACE_STANDOFF
        values = (ours.lifted, theirs, solid, ours.lifted - solid, ours.rise, ours.creep)
        table.add_row(trace.published.name.partition("/")[2][:20], *(f"{1e3 * value:.1f}" for value in values))
    return table


def _creep_line(holds: dict[str, "Hold"]) -> str:
    held = {name: hold.creep for name, hold in holds.items() if hold.is_held}
    worst = max(held, key=lambda name: held[name])
    return (
        f"held still for 5 s: {len(held)} of {len(holds)} pile objects could be grasped from above; the most that one "
        f"moved in the hand is {1e3 * held[worst]:.2f} mm ({worst})"
    )


def _scene_table(numbers: list["SceneNumbers"]) -> Table:
    from icgnet.benchmark.published import PILE_FELL_THROUGH, SCENES

    table = Table("scenes of five objects", *(header for each in numbers for header in (each.kind, "published")))
    packed, pile = (SCENES[each.kind] for each in numbers)
    stood, dropped = numbers
    rows: dict[str, tuple[float | None, ...]] = {
        "placed, mean": (stood.placed, packed.placed, dropped.placed, pile.placed),
        "lost": (stood.lost, packed.lost, dropped.lost, pile.lost),
        "lost by falling through the table": (0.0, 0.0, 0.0, PILE_FELL_THROUGH),
        "rejected share of attempts": (stood.rejected, packed.rejected, None, None),
        "tilted by more than 20 degrees": (stood.tilted, packed.tilted, None, None),
        "top speed, m/s": (stood.top_speed, None, dropped.top_speed, None),
    }
    for name, values in rows.items():
        table.add_row(name, *("-" if value is None else f"{value:.2f}" for value in values))
    return table


def _agreement_table(agreement: "Agreement") -> Table:
    table = Table("label filter against the whole physics", "")
    table.add_row("trials", str(agreement.trials))
    for name in ("filtered", "same_collision", "same_success", "success", "success_of_free"):
        table.add_row(name.replace("_", " "), f"{100 * getattr(agreement, name):.2f} %")
    return table
