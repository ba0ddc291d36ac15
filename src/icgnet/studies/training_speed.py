"""Where the time of a training step goes, how many scenes a second are trained, and how many FLOPs a scene takes."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch.utils.flop_counter import FlopCounterMode, sdpa_backward_flop_count, sdpa_flop_count

from icgnet.benchmark.statistics import Quantiles
from icgnet.benchmark.tables import NOTHING, Table
from icgnet.studies.config import TrainingSpeedConfig
from icgnet.studies.loader import LoaderNumbers, load_dataset, time_visits
from icgnet.training.config import TRAININGS, TrainingConfig
from icgnet.training.loop import Trainer, to_agree_on
from icgnet.training.processes import check_same, join_processes, total
from icgnet.training.sample import Sample

WAITING, FORWARD, BACKWARD, OPTIMISER = "waiting for the loader", "forward and losses", "backward", "optimiser"
PARTS = (WAITING, FORWARD, BACKWARD, OPTIMISER)
"""Of a step, in the order in which they run; together they are the whole step."""
STEP = "whole step"
COUNTED_STEPS, MODULE_STEPS = 16, 4  # at most
NOT_COUNTED = (
    "element-wise operations, normalisation and softmax",
    "gathering of neighbours (the products with absent neighbours, which are zeros, are counted)",
    "neighbour searches, distances, farthest points and the assignment of queries",
    "the optimiser",
)

_ATEN = torch.ops.aten
BY_HAND: dict[Any, Callable[..., int]] = {
    _ATEN._scaled_dot_product_flash_attention_for_cpu: lambda q, k, v, *_, **__: sdpa_flop_count(q, k, v),
    _ATEN._scaled_dot_product_flash_attention_for_cpu_backward: (
        lambda gradient, q, k, v, *_, **__: sdpa_backward_flop_count(gradient, q, k, v)
    ),
    # A product and a sum for each row and channel; twice, because no counter sees the scatter that goes back.
    _ATEN._embedding_bag: lambda table, rows, *_, **__: 2 * 2 * prod(rows) * table[1],
}
"""FLOPs, from the shapes, of what torch's counter does not know: attention on the CPU, and reads of the dense maps."""


@dataclass(frozen=True)
class TrainingSpeedNumbers:
    """What training costs on this machine; times and FLOPs are per scene.

    Attributes:
        step_ms: time of each of `PARTS` and of the whole step, waiting included.
        module_ms: time of the forward pass in each module of the network, with those that it calls.
        step_gflop: floating-point operations of forward pass (losses included), backward pass and both together [1e9];
            a multiply-add is two.
        module_gflop: the same of the forward pass of each module of the network that has any.
        not_counted: what FLOPs leave out.
        counted_scenes: whose FLOPs were counted.
        loader: of making samples in one process that does nothing else, while nothing trains.
        scenes_per_second: trained by all processes together, with the loaders in processes of their own.
        waiting_share: of the time that was spent waiting for it. The first steps find samples prepared, so few steps
            flatter a loader that is too slow.
        steps: that were timed.
        batch: scenes per step, in each process that trains.
        threads: CPU threads of the computation, in each process that trains.
        workers: loader processes, of each process that trains.
        processes: that train together.
        device: of the network.
    """

    step_ms: dict[str, Quantiles]
    module_ms: dict[str, Quantiles]
    step_gflop: dict[str, Quantiles]
    module_gflop: dict[str, Quantiles]
    not_counted: tuple[str, ...]
    counted_scenes: int
    loader: LoaderNumbers
    scenes_per_second: float
    waiting_share: float
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
    torch.set_num_threads(training.threads)
    with TemporaryDirectory() as folder:
        trainer = Trainer(training, fabric, dataset, [], Path(folder), lambda line: None)
    batches, clock = trainer.batches(), _clock(fabric.device)
    counted = [_count_flops(trainer, next(batches)) for _ in range(min(steps, COUNTED_STEPS))]
    timed = [_time_step(trainer, batches, clock) for _ in range(steps)]
    modules = [_time_modules(trainer, next(batches), clock) for _ in range(min(steps, MODULE_STEPS))]
    seconds = sum(step[STEP] for step in timed)
    scenes_per_second = float(total(fabric, torch.tensor(steps * training.batch / seconds, dtype=torch.float64)))
    del batches  # ends the loader's processes
    fabric.barrier()
    if not fabric.is_global_zero:
        return None
    # Rays are traced on threads, which a loader's process that is forked later would wait for in vain: so this is last.
    torch.set_num_threads(1)
    loader = time_visits(dataset, steps * training.batch)
    return TrainingSpeedNumbers(
        step_ms=_quantiles(timed, 1e3 / training.batch),
        module_ms=_quantiles(modules, 1e3 / training.batch),
        step_gflop=_quantiles([step for step, _ in counted], 1e-9 / training.batch),
        module_gflop=_quantiles([module for _, module in counted], 1e-9 / training.batch),
        not_counted=NOT_COUNTED,
        counted_scenes=len(counted) * training.batch,
        loader=loader,
        scenes_per_second=scenes_per_second,
        waiting_share=sum(step[WAITING] for step in timed) / seconds,
        steps=steps,
        batch=training.batch,
        threads=training.threads,
        workers=training.workers,
        processes=fabric.world_size,
        device=str(fabric.device),
    )


def tables(numbers: TrainingSpeedNumbers) -> list[Table]:
    """What is printed."""
    step, flops, loader = numbers.step_ms[STEP], numbers.step_gflop[STEP], numbers.loader
    whole = sum(numbers.step_ms[part].median for part in PARTS)
    shares = {part: numbers.step_ms[part].median / whole for part in PARTS} | {STEP: 1.0}
    rows = [
        (name, f"{ms:.1f}", f"{100 * shares[name]:.0f} %", _mean(numbers.step_gflop, name))
        for name, ms in numbers.step_ms.items()
    ]
    processes = f" in each of {numbers.processes} processes" if numbers.processes > 1 else ""
    notes = (
        f"{numbers.scenes_per_second:.2f} scenes a second over {numbers.steps} steps of {numbers.batch}{processes}; "
        f"{numbers.device}, {numbers.threads} threads",
        f"loader: {loader.visit_ms:.0f} ms a scene in a process of its own; with "
        f"{numbers.workers} of them, {100 * numbers.waiting_share:.0f} % of the time is waiting",
        f"{flops.mean:.1f} GFLOP a scene, forward and backward ({flops.p10:.1f} to {flops.p90:.1f}; "
        f"{numbers.counted_scenes} scenes): {1e3 * flops.mean / step.median:.0f} GFLOP/s",
        f"not counted: {'; '.join(numbers.not_counted)}",
    )
    modules = [(name, f"{ms.mean:.1f}", _mean(numbers.module_gflop, name)) for name, ms in numbers.module_ms.items()]
    return [
        Table(("forward, per scene", "ms, mean", "GFLOP"), modules, title="modules of the network"),
        Table(("per scene", "ms, median (10th to 90th percentile)", "share", "GFLOP"), rows, "training step", notes),
    ]


def _mean(gflop: dict[str, Quantiles], name: str) -> str:
    return f"{gflop[name].mean:.2f}" if name in gflop else NOTHING


def _quantiles(steps: list[dict[str, float]], factor: float) -> dict[str, Quantiles]:
    """Of every name over the steps; where a step lacks it, it is 0 there."""
    names = dict.fromkeys(name for step in steps for name in step)
    return {name: Quantiles.of([factor * step.get(name, 0.0) for step in steps]) for name in names}


def _time_step(trainer: Trainer, batches: Iterator[list[Sample]], clock: Callable[[], float]) -> dict[str, float]:
    """What each of `PARTS` and the whole took in one step [s]."""
    times = [clock()]
    samples = next(batches)
    times.append(clock())
    loss, _ = trainer.forward(samples)
    times.append(clock())
    trainer.backward(loss)
    times.append(clock())
    trainer.update()
    times.append(clock())
    return {**dict(zip(PARTS, np.diff(times).tolist(), strict=True)), STEP: times[-1] - times[0]}


def _time_modules(trainer: Trainer, samples: list[Sample], clock: Callable[[], float]) -> dict[str, float]:
    """What a forward pass took in each module of the network that it calls [s]."""
    spent: dict[str, float] = defaultdict(float)

    def begin(name: str, *_: Any) -> None:
        spent[name] -= clock()

    def end(name: str, *_: Any) -> None:
        spent[name] += clock()

    modules = dict(trainer.network.named_children())
    hooks = [module.register_forward_pre_hook(partial(begin, name)) for name, module in modules.items()]
    hooks += [module.register_forward_hook(partial(end, name)) for name, module in modules.items()]
    trainer.forward(samples)
    for hook in hooks:
        hook.remove()
    return dict(spent)


def _count_flops(trainer: Trainer, samples: list[Sample]) -> tuple[dict[str, float], dict[str, float]]:
    """FLOPs of a step's passes and, forward, of each module; what the optimiser does depends on the weights alone."""
    with FlopCounterMode(display=False, custom_mapping=BY_HAND) as forward:
        loss, _ = trainer.forward(samples)
    with FlopCounterMode(display=False, custom_mapping=BY_HAND) as backward:
        trainer.backward(loss)
    trainer.update()
    passes = {FORWARD: float(forward.get_total_flops()), BACKWARD: float(backward.get_total_flops())}
    modules = {
        name.rpartition(".")[2]: float(sum(ops.values()))
        for name, ops in forward.get_flop_counts().items()
        if name.rpartition(".")[0].endswith(".network")
    }
    return {**passes, STEP: sum(passes.values())}, modules


def _clock(device: torch.device) -> Callable[[], float]:
    """Seconds, at a moment when the device has done all that it was told."""
    if device.type != "cuda":
        return time.perf_counter

    def read() -> float:
        torch.cuda.synchronize(device)
        return time.perf_counter()

    return read
