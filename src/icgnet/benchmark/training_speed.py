"""Where the time of a training step goes, how many scenes a second are trained, and how many FLOPs a scene takes."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from math import prod
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils.flop_counter import FlopCounterMode, sdpa_backward_flop_count, sdpa_flop_count

from icgnet.benchmark.loader import LoaderNumbers, load_dataset, time_visits
from icgnet.errors import InputError
from icgnet.network.embedding import SceneEmbedding
from icgnet.network.icgnet import IcgNet
from icgnet.training.config import LossWeights, MatchingCosts, TrainingConfig
from icgnet.training.loop import Trainer, to_agree_on
from icgnet.training.losses import TrainingLoss
from icgnet.training.processes import Accelerator, check_same, join_processes, total
from icgnet.training.sample import Sample

WAITING, SURFACE, DENSE, QUERIES = "waiting for the loader", "surface U-Net", "dense U-Net", "tokens and refinement"
SEGMENTATION, OCCUPANCY, GRASPS, REST = "segmentation loss", "occupancy loss", "grasp loss", "rest of the forward"
BACKWARD, OPTIMISER = "backward", "optimiser"
PARTS = (WAITING, SURFACE, DENSE, QUERIES, SEGMENTATION, OCCUPANCY, GRASPS, REST, BACKWARD, OPTIMISER)
"""Of a step, in the order in which they run; together they are the whole step."""

NOT_COUNTED = (
    "element-wise operations, normalisation and softmax",
    "gathering of neighbours (the products with absent neighbours, which are zeros, are counted)",
    "neighbour searches, distances, farthest points and the assignment of queries",
    "the optimiser",
)
Shape = Sequence[int]
COUNTED_STEPS = 16
"""At most so many untimed steps come first; their FLOPs are counted."""


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
        forward: mean of each part that has any.
        backward: mean.
        total: mean of forward and backward together.
        total_p10: one tenth of the steps is below.
        total_p90: one tenth of the steps is above.
        scenes: that were counted.
        not_counted: what the numbers leave out.
    """

    forward: dict[str, float]
    backward: float
    total: float
    total_p10: float
    total_p90: float
    scenes: int
    not_counted: tuple[str, ...] = NOT_COUNTED


@dataclass(frozen=True)
class TrainingSpeed:
    """What training costs on this machine.

    Attributes:
        parts_ms: of each of `PARTS`, per scene.
        step_ms: of whole steps, waiting included, per scene.
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


class Meter:
    """Shares a reading that only grows, of a clock or a counter, among the parts of a step.

    A part that begins inside of another one interrupts it, so that the parts add up to the whole.
    """

    def __init__(self, read: Callable[[], float]) -> None:
        self.read = read
        self.parts: dict[str, float] = defaultdict(float)
        self._running: list[str] = []
        self._last = 0.0

    def begin(self, part: str) -> None:
        """Counts for a part from now on."""
        self._settle()
        self._running.append(part)

    def end(self) -> None:
        """Counts for the part again that was interrupted by the last one."""
        self._settle()
        self._running.pop()

    @contextmanager
    def part(self, name: str) -> Iterator[None]:
        """Counts for a part inside `with`."""
        self.begin(name)
        yield
        self.end()

    def _settle(self) -> None:
        now = self.read()
        if self._running:
            self.parts[self._running[-1]] += now - self._last
        self._last = now


class MeteredLoss(TrainingLoss):
    """The loss of training, with a meter on its parts."""

    def __init__(
        self, meter: Meter, network: IcgNet, weights: LossWeights, costs: MatchingCosts, bfloat16: bool
    ) -> None:
        super().__init__(network, weights, costs, bfloat16)
        self.meter = meter
        for part, module in ((SURFACE, network.sparse), (DENSE, network.dense)):
            module.register_forward_pre_hook(lambda *_, part=part: meter.begin(part))
            module.register_forward_hook(lambda *_: meter.end())

    def encode(self, samples: list[Sample]) -> list[SceneEmbedding]:
        """As in training."""
        with self.meter.part(QUERIES):
            return super().encode(samples)

    def scene_terms(self, embedding: SceneEmbedding, sample: Sample) -> dict[str, Tensor]:
        """As in training."""
        with self.meter.part(SEGMENTATION):
            return super().scene_terms(embedding, sample)

    def occupancy_terms(
        self, embedding: SceneEmbedding, sample: Sample, queries: Tensor, stage: int
    ) -> dict[str, Tensor]:
        """As in training."""
        with self.meter.part(OCCUPANCY):
            return super().occupancy_terms(embedding, sample, queries, stage)

    def grasp_terms(self, embedding: SceneEmbedding, sample: Sample, queries: Tensor, stage: int) -> dict[str, Tensor]:
        """As in training."""
        with self.meter.part(GRASPS):
            return super().grasp_terms(embedding, sample, queries, stage)


def measure_training(
    data: Sequence[Path],
    objects: Sequence[str | Path],
    config: TrainingConfig,
    steps: int,
    accelerator: Accelerator = "auto",
) -> TrainingSpeed | None:
    """Trains for some steps from the beginning, as `icgnet train` does, and keeps nothing of it.

    Processes that `torchrun` started train together; what parts and loader take is measured in the first of them.

    Args:
        data: folders of recipes.
        objects: sources of the object sets that the recipes name.
        config: of the run; samples are prepared by at least one process of their own.
        steps: that are timed, after some that are not.
        accelerator: what to compute on; "auto" takes a GPU where there is one.

    Returns:
        The numbers; None in all processes but the first.

    Raises:
        InputError: no steps asked for.
        DataError: no usable recipes, a missing object set, or other scenes or settings than the first process has.
    """
    if steps < 1:
        raise InputError(f"steps must be at least 1, got {steps}")
    config = replace(config, workers=max(1, config.workers))
    dataset = load_dataset(data, objects, config)
    fabric = join_processes(accelerator)
    check_same(fabric, to_agree_on(config, dataset.recipes) | {"timed_steps": steps})
    loader = None
    if fabric.is_global_zero:
        torch.set_num_threads(1)
        loader = time_visits(dataset, steps * config.batch)
    fabric.barrier()
    torch.set_num_threads(config.threads)
    meter = Meter(_clock(fabric.device))
    with TemporaryDirectory() as folder:
        make_loss = partial(MeteredLoss, meter)
        trainer = Trainer(config, fabric, dataset, [], Path(folder), lambda line: None, make_loss=make_loss)
    batches = trainer.batches()
    flops = _count_flops(trainer, batches, meter, min(steps, COUNTED_STEPS))
    meter.read = _clock(fabric.device)
    timed = [_metered_step(trainer, batches, meter) for _ in range(steps)]
    seconds = sum(sum(parts.values()) for parts in timed)
    per_scene = 1e3 / config.batch
    scenes_per_second = float(total(fabric, torch.tensor(steps * config.batch / seconds, dtype=torch.float64)))
    if loader is None:
        return None
    return TrainingSpeed(
        parts_ms={part: Times.of([per_scene * parts.get(part, 0.0) for parts in timed]) for part in PARTS},
        step_ms=Times.of([per_scene * sum(parts.values()) for parts in timed]),
        loader=loader,
        scenes_per_second=scenes_per_second,
        waiting_share=sum(parts[WAITING] for parts in timed) / seconds,
        flops=flops,
        steps=steps,
        batch=config.batch,
        threads=torch.get_num_threads(),
        workers=config.workers,
        processes=fabric.world_size,
        device=str(fabric.device),
    )


def _metered_step(trainer: Trainer, batches: Iterator[list[Sample]], meter: Meter) -> dict[str, float]:
    """What each part of one step took, in the unit of the meter."""
    meter.parts = defaultdict(float)
    with meter.part(WAITING):
        samples = next(batches)
    with meter.part(REST):
        loss, _ = trainer.forward(samples)
    with meter.part(BACKWARD):
        trainer.backward(loss)
    with meter.part(OPTIMISER):
        trainer.update()
    return dict(meter.parts)


def _count_flops(trainer: Trainer, batches: Iterator[list[Sample]], meter: Meter, steps: int) -> Flops:
    """FLOPs per scene of some steps."""
    aten = torch.ops.aten
    # What the counter does not know: attention on the CPU, and the reads of the dense maps.
    by_hand = {
        aten._scaled_dot_product_flash_attention_for_cpu: _attention_flop,
        aten._scaled_dot_product_flash_attention_for_cpu_backward: _attention_backward_flop,
        aten._embedding_bag: _weighted_rows_flop,
    }
    with FlopCounterMode(display=False, custom_mapping=by_hand) as counter:
        meter.read = counter.get_total_flops
        counted = [_metered_step(trainer, batches, meter) for _ in range(steps)]
    for parts in counted:
        parts.pop(OPTIMISER, None)  # its products depend on the weights alone, not on the scenes
    per_scene = 1e-9 / trainer.config.batch
    means = {part: per_scene * sum(parts.get(part, 0.0) for parts in counted) / steps for part in PARTS}
    totals = [per_scene * sum(parts.values()) for parts in counted]
    low, high = np.quantile(totals, [0.1, 0.9]).tolist()
    return Flops(
        forward={part: value for part, value in means.items() if value and part != BACKWARD},
        backward=means[BACKWARD],
        total=sum(totals) / steps,
        total_p10=low,
        total_p90=high,
        scenes=steps * trainer.config.batch,
    )


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
