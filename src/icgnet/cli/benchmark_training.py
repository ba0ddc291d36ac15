"""`icgnet benchmark training-speed`: where the time of a training step goes."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.console import Console
from rich.table import Column, Table

from icgnet.benchmark.record import origin, write_report

if TYPE_CHECKING:
    from icgnet.benchmark.training_speed import Flops, Times, TrainingSpeed
    from icgnet.training.config import TrainingConfig


@dataclass(frozen=True)
class Speed:
    """Where the time of a training step goes, how many scenes a second are trained, and the FLOPs of a scene.

    Started by torchrun, all processes train together.
    """

    data: tuple[Path, ...]
    """Folders that `icgnet generate` wrote."""
    objects: tuple[str, ...] = ("procedural",)
    """The object sets that the scenes were made of."""
    preset: Literal["tiny", "cpu", "paper"] = "cpu"
    """Training preset."""
    steps: int = 20
    """Steps to time, after up to 16 that are not: their FLOPs are counted."""
    network: Literal["tiny", "default", "paper"] | None = None
    """Network in place of the preset's."""
    batch: int | None = None
    """Scenes per step, in each process, in place of the preset's."""
    common_statistics: bool | None = None
    """Whether processes share the statistics of their batches, in place of the preset's."""
    accelerator: Literal["auto", "cpu", "gpu"] = "auto"
    """What to compute on; auto takes a GPU where there is one."""
    threads: int | None = None
    """CPU threads in place of the preset's."""
    seed: int = 0
    """Of the weights and of every draw."""
    out: Path | None = None
    """Folder for report.json."""

    def run(self) -> None:
        """Measures, and prints a table.

        Raises:
            IcgnetError: no usable scenes, or settings out of range.
        """
        from icgnet.benchmark.training_speed import measure_training

        config = self._config()
        speed = measure_training(self.data, self.objects, config, self.steps, self.accelerator)
        if speed is None:
            return
        console = Console()
        console.print(_table(speed, f"a training step of preset '{self.preset}', network '{config.network}'"))
        console.print(_speed_lines(speed, config.precision), soft_wrap=True)
        console.print(_flops_lines(speed.flops, speed.step_ms), soft_wrap=True)
        settings = {
            "data": [str(folder) for folder in self.data],
            "objects": list(self.objects),
            "preset": self.preset,
            "network": config.network,
            "precision": config.precision,
            "common_statistics": config.common_statistics,
            "seed": self.seed,
        }
        write_report(self.out, {"benchmark": "training-speed", **asdict(speed), "settings": settings})

    def _config(self) -> "TrainingConfig":
        from icgnet.training.config import TRAININGS

        given = {name: getattr(self, name) for name in ("network", "batch", "common_statistics", "threads")}
        changes = {name: value for name, value in given.items() if value is not None}
        return replace(TRAININGS[self.preset], seed=self.seed, **changes)


def _table(speed: "TrainingSpeed", title: str) -> Table:
    table = Table(
        Column("per scene", no_wrap=True), "ms, median", "10th to 90th percentile", "share", "GFLOP", title=title
    )
    whole = sum(times.median for times in speed.parts_ms.values())
    work = speed.flops.forward | {"backward": speed.flops.backward}
    for part, times in speed.parts_ms.items():
        flops = f"{work[part]:.2f}" if part in work else ""
        table.add_row(part, *_cells(times), f"{100 * times.median / whole:.0f} %", flops)
    table.add_section()
    table.add_row("whole step", *_cells(speed.step_ms), "", f"{speed.flops.total:.2f}")
    return table


def _cells(times: "Times") -> tuple[str, str]:
    return f"{times.median:.1f}", f"{times.p10:.1f} to {times.p90:.1f}"


def _speed_lines(speed: "TrainingSpeed", precision: str) -> str:
    loader, bits = speed.loader, f"precision {precision}"
    processes = f" in each of {speed.processes} processes" if speed.processes > 1 else ""
    return (
        f"{speed.scenes_per_second:.2f} scenes a second over {speed.steps} steps of {speed.batch}{processes}; {bits}; "
        f"{speed.device}, {speed.threads} threads, {origin().processor}\n"
        f"loader: {loader.median_ms:.0f} ms a scene ({loader.p10_ms:.0f} to {loader.p90_ms:.0f}) in a process of its "
        f"own; with {speed.workers} of them, {100 * speed.waiting_share:.0f} % of the time is waiting"
    )


def _flops_lines(flops: "Flops", step: "Times") -> str:
    return (
        f"{flops.total:.1f} GFLOP a scene, forward and backward ({flops.total_p10:.1f} to {flops.total_p90:.1f}; "
        f"{flops.scenes} scenes): {1e3 * flops.total / step.median:.0f} GFLOP/s\n"
        f"not counted: {'; '.join(flops.not_counted)}"
    )
