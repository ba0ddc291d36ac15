"""Where the time of a training step goes, how many scenes a second are trained, and how many FLOPs a scene takes.

The parts of a step are named for `torch.profiler`, and FLOPs are counted by `torch.utils.flop_counter`.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch.profiler import ProfilerActivity, profile, record_function
from torch.utils.flop_counter import FlopCounterMode, sdpa_backward_flop_count, sdpa_flop_count

from icgnet.benchmark.tables import NOTHING, Table
from icgnet.studies.config import TrainingSpeedConfig
from icgnet.studies.loader import LoaderNumbers, load_dataset, percentiles, time_visits
from icgnet.training.config import TRAININGS, TrainingConfig
from icgnet.training.loop import Trainer, to_agree_on
from icgnet.training.processes import check_same, join_processes, total
from icgnet.training.sample import Sample

WAITING, FORWARD, BACKWARD, OPTIMISER = "waiting for the loader", "forward and losses", "backward", "optimiser"
PARTS = (WAITING, FORWARD, BACKWARD, OPTIMISER)
"""Of a step, in the order in which they run; together they are the whole step."""
COUNTED_STEPS, PROFILED_STEPS = 16, 4  # at most
NOT_COUNTED = (
    "element-wise operations, normalisation and softmax",
    "gathering of neighbours (the products with absent neighbours, which are zeros, are counted)",
    "neighbour searches, distances, farthest points and the assignment of queries",
    "the optimiser",
)
Shape = Sequence[int]


@dataclass(frozen=True)
class Times:
    """Time per scene over the steps [ms]: median, and what one tenth of the steps is below and above."""

    median: float
    p10: float
    p90: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Times":
        """The quantiles of some times [ms]."""
        low, median, high = np.quantile(values, [0.1, 0.5, 0.9]).tolist()
        return cls(median, low, high)


@dataclass(frozen=True)
class Flops:
    """Floating-point operations of one forward and backward pass, per scene [1e9]; a multiply-add is two.

    Attributes:
        modules: of the forward pass, mean of each module of the network that has any, with those that it calls.
        forward: mean, losses included.
        backward: mean.
        total: mean of forward and backward together.
        total_p10: one tenth of the steps is below.
        total_p90: one tenth of the steps is above.
        scenes: that were counted.
        not_counted: what the numbers leave out.
    """

    modules: dict[str, float]
    forward: float
    backward: float
    total: float
    total_p10: float
    total_p90: float
    scenes: int
    not_counted: tuple[str, ...] = NOT_COUNTED


@dataclass(frozen=True)
class TrainingSpeedNumbers:
    """What training costs on this machine.

    Attributes:
        parts_ms: of each of `PARTS`, per scene.
        step_ms: of whole steps, waiting included, per scene.
        modules_ms: mean time of the forward pass in each module of the network, per scene, under the profiler.
        loader: of making samples in one process that does nothing else, while nothing trains.
        scenes_per_second: trained by all processes together, with the loaders in processes of their own.
        waiting_share: of the time that was spent waiting for it. The first steps find samples prepared, so few steps
            flatter a loader that is too slow.
        flops: counted, not timed.
        steps: that were timed.
        batch: scenes per step, in each process that trains.
        threads: CPU threads of the computation, in each process that trains.
        workers: loader processes, of each process that trains.
        processes: that train together.
        device: of the network.
    """

    parts_ms: dict[str, Times]
    step_ms: Times
    modules_ms: dict[str, float]
    loader: LoaderNumbers
    scenes_per_second: float
    waiting_share: float
    flops: Flops
    steps: int
    batch: int
    threads: int
    workers: int
    processes: int
    device: str


def training_config(config: TrainingSpeedConfig) -> TrainingConfig:
    """The training that is timed; samples are prepared by at least one process of their own."""
    preset = TRAININGS[config.preset]
    given = {name: getattr(config, name) for name in ("network", "batch", "common_statistics", "threads")}
    changes = {name: value for name, value in given.items() if value is not None}
    return replace(preset, seed=config.seed, workers=max(1, preset.workers), **changes)


def measure(config: TrainingSpeedConfig) -> TrainingSpeedNumbers | None:
    """Trains for some steps from the beginning, as `icgnet train` does, and keeps nothing of it.

    Processes that `torchrun` started train together; what parts and loader take is measured in the first of them.

    Returns:
        The numbers; None in all processes but the first.

    Raises:
        DataError: no usable recipes, a missing object set, or other scenes or settings than the first process has.
    """
    training, steps = training_config(config), config.steps
    dataset = load_dataset(config.data, config.objects, training)
    fabric = join_processes(config.accelerator)
    check_same(fabric, to_agree_on(training, dataset.recipes) | {"timed_steps": steps})
    loader = None
    if fabric.is_global_zero:
        torch.set_num_threads(1)
        loader = time_visits(dataset, steps * training.batch)
    fabric.barrier()
    torch.set_num_threads(training.threads)
    with TemporaryDirectory() as folder:
        trainer = Trainer(training, fabric, dataset, [], Path(folder), lambda line: None)
    batches = trainer.batches()
    flops = _count_flops(trainer, batches, min(steps, COUNTED_STEPS))
    clock = _clock(fabric.device)
    timed = np.array([_timed_step(trainer, batches, clock) for _ in range(steps)])
    modules = _profile(trainer, batches, min(steps, PROFILED_STEPS))
    seconds, per_scene = float(timed.sum()), 1e3 / training.batch
    scenes_per_second = float(total(fabric, torch.tensor(steps * training.batch / seconds, dtype=torch.float64)))
    if loader is None:
        return None
    return TrainingSpeedNumbers(
        parts_ms={part: Times.of((per_scene * column).tolist()) for part, column in zip(PARTS, timed.T, strict=True)},
        step_ms=Times.of((per_scene * timed.sum(axis=1)).tolist()),
        modules_ms=modules,
        loader=loader,
        scenes_per_second=scenes_per_second,
        waiting_share=float(timed[:, 0].sum()) / seconds,
        flops=flops,
        steps=steps,
        batch=training.batch,
        threads=torch.get_num_threads(),
        workers=training.workers,
        processes=fabric.world_size,
        device=str(fabric.device),
    )


def tables(numbers: TrainingSpeedNumbers) -> list[Table]:
    """What is printed."""
    flops, step, loader = numbers.flops, numbers.step_ms, numbers.loader
    whole = sum(times.median for times in numbers.parts_ms.values())
    work = {FORWARD: flops.forward, BACKWARD: flops.backward}
    rows = [
        (*_cells(part, times), f"{100 * times.median / whole:.0f} %", f"{work[part]:.2f}" if part in work else NOTHING)
        for part, times in numbers.parts_ms.items()
    ]
    rows.append((*_cells("whole step", step), "100 %", f"{flops.total:.2f}"))
    processes = f" in each of {numbers.processes} processes" if numbers.processes > 1 else ""
    notes = (
        f"{numbers.scenes_per_second:.2f} scenes a second over {numbers.steps} steps of {numbers.batch}{processes}; "
        f"{numbers.device}, {numbers.threads} threads",
        f"loader: {loader.median_ms:.0f} ms a scene ({percentiles(loader)}) in a process of its own; with "
        f"{numbers.workers} of them, {100 * numbers.waiting_share:.0f} % of the time is waiting",
        f"{flops.total:.1f} GFLOP a scene, forward and backward ({flops.total_p10:.1f} to {flops.total_p90:.1f}; "
        f"{flops.scenes} scenes): {1e3 * flops.total / step.median:.0f} GFLOP/s",
        f"not counted: {'; '.join(flops.not_counted)}",
    )
    modules = [
        (name, f"{milliseconds:.1f}", f"{flops.modules[name]:.2f}" if name in flops.modules else NOTHING)
        for name, milliseconds in numbers.modules_ms.items()
    ]
    return [
        Table(("forward, per scene", "ms, mean, profiled", "GFLOP"), modules, title="modules of the network"),
        Table(("per scene", "ms, median", "10th to 90th percentile", "share", "GFLOP"), rows, "training step", notes),
    ]


def _cells(name: str, times: Times) -> tuple[str, str, str]:
    return name, f"{times.median:.1f}", f"{times.p10:.1f} to {times.p90:.1f}"


def _timed_step(trainer: Trainer, batches: Iterator[list[Sample]], clock: Callable[[], float]) -> list[float]:
    """What each of `PARTS` took in one step [s]."""
    times = [clock()]
    samples = next(batches)
    times.append(clock())
    loss, _ = trainer.forward(samples)
    times.append(clock())
    trainer.backward(loss)
    times.append(clock())
    trainer.update()
    times.append(clock())
    return np.diff(times).tolist()


def _profile(trainer: Trainer, batches: Iterator[list[Sample]], steps: int) -> dict[str, float]:
    """Mean time of the forward pass in each module of the network, per scene [ms]."""
    is_cuda = trainer.fabric.device.type == "cuda"
    running: list[record_function] = []

    def begin(name: str) -> None:
        running.append(record_function(name))
        running[-1].__enter__()

    hooks = []
    for name, module in trainer.network.named_children():
        hooks.append(module.register_forward_pre_hook(lambda *_, name=name: begin(name)))
        hooks.append(module.register_forward_hook(lambda *_: running.pop().__exit__(None, None, None)))
    activities = [ProfilerActivity.CPU, *[ProfilerActivity.CUDA] * is_cuda]
    with profile(activities=activities) as profiler:
        for _ in range(steps):
            trainer.forward(next(batches))
    for hook in hooks:
        hook.remove()
    events = {event.key: event for event in profiler.key_averages()}
    per_scene = 1e-3 / (steps * trainer.config.batch)
    return {
        name: per_scene * (events[name].device_time_total if is_cuda else events[name].cpu_time_total)
        for name, _ in trainer.network.named_children()
        if name in events
    }


def _count_flops(trainer: Trainer, batches: Iterator[list[Sample]], steps: int) -> Flops:
    """FLOPs per scene of some steps; what the optimiser does depends on the weights alone and is not counted."""
    aten = torch.ops.aten
    # What the counter does not know: attention on the CPU, and the reads of the dense maps.
    by_hand = {
        aten._scaled_dot_product_flash_attention_for_cpu: _attention_flop,
        aten._scaled_dot_product_flash_attention_for_cpu_backward: _attention_backward_flop,
        aten._embedding_bag: _weighted_rows_flop,
    }
    names = [name for name, _ in trainer.network.named_children()]
    forward, backward, modules = [], [], []
    for _ in range(steps):
        with FlopCounterMode(display=False, custom_mapping=by_hand) as counter:
            loss, _ = trainer.forward(next(batches))
        found = counter.get_flop_counts()
        modules.append([_flops_of(found, name) for name in names])
        forward.append(counter.get_total_flops())
        with FlopCounterMode(display=False, custom_mapping=by_hand) as counter:
            trainer.backward(loss)
        backward.append(counter.get_total_flops())
        trainer.update()
    per_scene = 1e-9 / trainer.config.batch
    totals = per_scene * (np.array(forward) + np.array(backward))
    low, high = np.quantile(totals, [0.1, 0.9]).tolist()
    means = dict(zip(names, (per_scene * np.mean(modules, axis=0)).tolist(), strict=True))
    return Flops(
        modules={name: value for name, value in means.items() if value},
        forward=per_scene * float(np.mean(forward)),
        backward=per_scene * float(np.mean(backward)),
        total=float(totals.mean()),
        total_p10=low,
        total_p90=high,
        scenes=steps * trainer.config.batch,
    )


def _flops_of(counts: dict[str, dict[Any, int]], module: str) -> int:
    """FLOPs of a module of the network, whatever it is wrapped in."""
    return sum(sum(ops.values()) for name, ops in counts.items() if name.endswith(f".network.{module}"))


def _attention_flop(queries: Shape, keys: Shape, values: Shape, *_: Any, **__: Any) -> int:
    return sdpa_flop_count(queries, keys, values)


def _attention_backward_flop(gradient: Shape, queries: Shape, keys: Shape, values: Shape, *_: Any, **__: Any) -> int:
    return sdpa_backward_flop_count(gradient, queries, keys, values)


def _weighted_rows_flop(table: Shape, rows: Shape, *_: Any, **__: Any) -> int:
    """A product and a sum for each row and channel; twice, because no counter sees the scatter that goes back."""
    return 2 * 2 * prod(rows) * table[1]


def _clock(device: torch.device) -> Callable[[], float]:
    """Seconds, at a moment when the device has done all that it was told."""
    if device.type != "cuda":
        return time.perf_counter

    def read() -> float:
        torch.cuda.synchronize(device)
        return time.perf_counter()

    return read
