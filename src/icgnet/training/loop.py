"""The training loop: one for a laptop, a GPU or several, through Lightning Fabric."""

import gc
import json
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import torch
from lightning_fabric import Fabric
from torch import Tensor
from torch.utils.data import DataLoader

from icgnet.datagen.recipe import Recipe
from icgnet.errors import DataError, TrainingDivergedError
from icgnet.files import finite, keep_lines
from icgnet.grasping.gripper import Gripper
from icgnet.network.batch_norm import synchronise_statistics
from icgnet.network.config import NETWORKS, NetworkConfig
from icgnet.network.icgnet import IcgNet
from icgnet.network.precision import use_bfloat16
from icgnet.network.weights import load_weights, save_weights
from icgnet.network.weights_header import read_header
from icgnet.parallel.lock import locked
from icgnet.training.checkpoint import (
    CHECKPOINT_FILE,
    Progress,
    WeightAverage,
    read_checkpoint,
    restore,
    save_checkpoint,
)
from icgnet.training.config import TrainingConfig, training_record, write_or_compare
from icgnet.training.dataset import RecipeDataset, VisitBatches, gather_recipes, network_for
from icgnet.training.interrupts import Interrupts, ignore_interrupts
from icgnet.training.log import Clock, TrainingLog
from icgnet.training.losses import TrainingLoss
from icgnet.training.metrics import evaluate, selection_score
from icgnet.training.muon import Muon
from icgnet.training.processes import Accelerator, agreed, check_same, join_processes
from icgnet.training.sample import Sample
from icgnet.training.schedule import learning_rate_factor
from icgnet.training.validation import load_object_sets, validation_samples

METRICS_FILE = "metrics.jsonl"
BEST_FILE = "weights.safetensors"
FINAL_FILE = "weights_final.safetensors"
MOST_SKIPPED = 20

Report = Callable[[str], None]


def train(
    config: TrainingConfig,
    data: Sequence[Path],
    out: Path,
    objects: Sequence[str | Path] = ("procedural",),
    report: Report = lambda line: None,
    leg_steps: int | None = None,
    start: Path | None = None,
    accelerator: Accelerator = "auto",
    gripper: Gripper | None = None,
) -> dict[str, float]:
    """Trains a network, or goes on with the run that `out` holds, and returns its last validation metrics.

    Writes to `out`: config.json, metrics.jsonl, checkpoint.pt, weights.safetensors (best on validation scenes, averaged
    weights) and, when the budget is used up, weights_final.safetensors.

    Processes that `torchrun` started train one network together, each on its own scenes (docs/guides/multi_gpu.md).
    Only the first of them reads and writes `out`, validates, reports, and returns metrics.

    Args:
        config: of the run.
        data: folders of recipes; those of split "train" are trained on, those of split "val" are validated on.
        out: folder of the run.
        objects: sources of the object sets that the recipes name, see `load_object_set`.
        report: gets a line of text now and then.
        leg_steps: stop after so many steps of this call, with a checkpoint; None goes on to the end of the budget.
        start: weights that the run begins with; random ones if None.
        accelerator: what to compute on; "auto" takes a GPU where there is one.
        gripper: the hand that the scenes must be labelled with; any, but the same for all, if None.

    Raises:
        InputError: fewer GPUs than processes.
        DataError: no training recipes, folders whose labels are of unlike hands or classes, a missing object set, a
            damaged checkpoint, weights that are damaged or of another network, hand or classes, a run with other
            settings, or other scenes or settings than the first process has.
        TrainingDivergedError: gradients stay infinite or NaN.
        KeyboardInterrupt: the process was interrupted (SIGINT, SIGTERM) while it trained; the checkpoint is written.
    """
    recipes, header = gather_recipes(data, NETWORKS[config.network].any_hand)
    if gripper is not None and (differences := gripper.differences(header.gripper)):
        raise DataError(f"the scenes are labelled with another hand than {gripper.name!r}: {', '.join(differences)}")
    network = network_for(config.network, header)
    by_split = {split: [recipe for recipe in recipes if recipe.split == split] for split in ("train", "val")}
    if not by_split["train"]:
        raise DataError(f"no recipes of split 'train' in {', '.join(map(str, data))}")
    fabric, out = join_processes(accelerator), Path(out)
    check_same(fabric, to_agree_on(config, recipes) | {"leg_steps": leg_steps, "labels": header.to_dict()})
    with ExitStack() as stack:
        if fabric.is_global_zero:
            counts = {"scenes": len(by_split["train"]), "validation_scenes": len(by_split["val"])}
            about = {"folders": sorted(map(str, data)), **counts, "start": _checksum(start, network)}
            out.mkdir(parents=True, exist_ok=True)
            stack.enter_context(locked(out))
            for change in write_or_compare(out, training_record(config, network, fabric.world_size, about)):
                report(f"going on with another setting: {change}")
        else:
            report = _silence
        torch.set_num_threads(config.threads)
        bits = "bfloat16" if use_bfloat16(config.precision, fabric.device) else "float32"
        report(f"computing on {fabric.device} in {bits} (precision {config.precision}), threads {config.threads}")
        report(f"loading the objects of {len(recipes)} scenes")
        object_sets = load_object_sets(objects)
        dataset = RecipeDataset(by_split["train"], object_sets, config.sampling, network, config.seed)
        to_validate = by_split["val"] if fabric.is_global_zero else []
        validation = validation_samples(
            network, config.sampling, config.validation_scenes, to_validate, object_sets, apart=config.workers > 0
        )
        # Millions of objects of the data stay to the end: the garbage collector need not walk them after every step.
        gc.freeze()
        stack.callback(gc.unfreeze)
        return Trainer(config, fabric, dataset, validation, out, report, start).run(leg_steps)


def _checksum(start: Path | None, network: NetworkConfig) -> str | None:
    """Of the weights that a run begins with, after making sure that they are of its network."""
    if start is None:
        return None
    header = read_header(start)
    header.check_config(network, start)
    return header.sha256


@dataclass(frozen=True, eq=False)
class Step:
    """What an optimiser step did.

    Attributes:
        scenes: loss and terms of each scene of this process.
        gradient_norm: before it was clipped.
        skipped: whether the gradient was not finite and the weights were left as they were.
    """

    scenes: list[dict[str, Tensor]]
    gradient_norm: float
    skipped: bool


class Trainer:
    """A run: its network, optimiser, average, and where it stands.

    With several processes each holds all of this, and they stay equal: gradients are averaged, batch normalisation
    takes its statistics over all of them (or, without `common_statistics`, starts each step from the running ones of
    the first), and what depends on the clock is decided by one common time.
    """

    def __init__(
        self,
        config: TrainingConfig,
        fabric: Fabric,
        dataset: RecipeDataset,
        validation: list[Sample],
        out: Path,
        report: Report,
        start: Path | None = None,
    ) -> None:
        """`validation` is empty in all processes but the first."""
        self.config, self.dataset, self.out, self.report, self.fabric = config, dataset, out, report, fabric
        torch.manual_seed(config.seed)
        self.network = IcgNet(dataset.network)
        if start is not None:
            self.network.load_state_dict(load_weights(start, dataset.network)[0].state_dict())
        # The optimiser puts its state where the weights are when a checkpoint is restored.
        self.network.to(fabric.device)
        if fabric.world_size > 1 and config.common_statistics:
            synchronise_statistics(self.network)
        self.average = WeightAverage(self.network, config.average_decay)
        optimizer = make_optimizer(self.network, config)
        self.progress = self._resume(optimizer)
        self._skipped_in_a_row = 0
        in_16_bits = use_bfloat16(config.precision, fabric.device)
        module = TrainingLoss(self.network, config.loss, config.matching, in_16_bits)
        self.loss, self.optimizer = fabric.setup(module, optimizer)
        self.validation = [sample.to(fabric.device) for sample in validation]

    @property
    def checkpoint_path(self) -> Path:
        """Where the run's checkpoint is."""
        return self.out / CHECKPOINT_FILE

    def run(self, leg_steps: int | None = None) -> dict[str, float]:
        """Trains until the budget is used up, or for `leg_steps` steps, and returns the last validation metrics."""
        if self.progress.finished:
            self.report(f"{self.out} is finished: {self.progress.step} steps, {self.progress.visits} scenes")
            return evaluate(self.average.network, self.validation, self.config.matching)
        if self.fabric.is_global_zero:
            self._tidy_log()
        last_step = self.progress.step + leg_steps if leg_steps is not None else None
        with Interrupts() as interrupts:
            self._train(last_step, interrupts)
            metrics = self._finish(stopped_early=interrupts.noted or self.progress.step == last_step)
        if interrupts.noted and not self.progress.finished:
            self.report(f"interrupted; the same command goes on from step {self.progress.step}")
            raise KeyboardInterrupt
        return metrics

    def _train(self, last_step: int | None, interrupts: Interrupts) -> None:
        """Steps until the budget is used up, after `last_step`, or when any process has been interrupted."""
        batches = self.batches()
        clock = Clock(self.progress.elapsed)
        log = TrainingLog()
        saved = logged = self.progress.elapsed
        while self.config.progress(self.progress.step, self.progress.elapsed) < 1.0 and self.progress.step != last_step:
            with log.waiting:
                samples = next(batches)
            step = self.step(samples)
            log.add(step.scenes, step.gradient_norm, step.skipped)
            self.progress.elapsed = now = agreed(self.fabric, clock.elapsed)
            if now - logged > self.config.log_seconds:
                means = log.summary(now - logged, self.fabric)
                self._write("train", means | {"learning_rate": self.learning_rate})
                log, logged = TrainingLog(), now
            interrupts.noted = agreed(self.fabric, float(interrupts.noted)) > 0
            if interrupts.noted:
                return
            if now - self.progress.validated > 60 * self.config.validation_minutes:
                self._validate()
                self.progress.validated = agreed(self.fabric, clock.elapsed)
                logged += self.progress.validated - now
            if now - saved > 60 * self.config.checkpoint_minutes:
                self._save()
                saved = now

    def _tidy_log(self) -> None:
        """Takes away what was logged after the checkpoint that the run goes on from, and will be logged again.

        The log of a run without a checkpoint is set aside.
        """
        path = self.out / METRICS_FILE
        if self.progress.step:
            self.report(f"going on from step {self.progress.step}")
            keep_lines(path, lambda line: json.loads(line)["step"] <= self.progress.step)
        elif path.is_file() and path.stat().st_size:
            aside = next(name for number in count(1) if not (name := path.with_stem(f"{path.stem}-{number}")).exists())
            path.rename(aside)
            self.report(f"{self.out} has a log but no {CHECKPOINT_FILE}: beginning anew; the log is now {aside.name}")

    def batches(self) -> Iterator[list[Sample]]:
        """The samples of the visits that come next in this process."""
        start = self.progress.visits
        visits = VisitBatches(start, self.config.batch, self.fabric.global_rank, self.fabric.world_size)
        loader = DataLoader(
            self.dataset,
            batch_sampler=visits,
            num_workers=self.config.workers,
            collate_fn=list,
            prefetch_factor=4 if self.config.workers else None,
            worker_init_fn=ignore_interrupts,
        )
        return iter(loader)

    def step(self, samples: list[Sample]) -> Step:
        """One optimiser step.

        Raises:
            TrainingDivergedError: the last `MOST_SKIPPED` gradients were not finite.
        """
        statistics = [each.clone() for each in self.network.buffers()]
        loss, scenes = self.forward(samples)
        self.backward(loss)
        norm = self.update()
        skipped = not math.isfinite(norm)
        if skipped:  # the forward pass has moved the running statistics
            for each, before in zip(self.network.buffers(), statistics, strict=True):
                each.copy_(before)
        self._skipped_in_a_row = self._skipped_in_a_row + 1 if skipped else 0
        if self._skipped_in_a_row == MOST_SKIPPED:
            raise TrainingDivergedError(
                f"the gradient was not finite in {MOST_SKIPPED} steps in a row, up to step {self.progress.step}: "
                f"training has diverged; lower the learning rate ({self.config.learning_rate:g})"
            )
        return Step(scenes, norm, skipped)

    def forward(self, samples: list[Sample]) -> tuple[Tensor, list[dict[str, Tensor]]]:
        """The loss of this process's scenes, with what it consists of."""
        # Draws depend on run, step and process alone, so a checkpoint need not hold the state of every device.
        draws = np.random.SeedSequence([self.config.seed, self.progress.step, self.fabric.global_rank])
        torch.manual_seed(int(draws.generate_state(1)[0]))
        self.loss.train()
        return self.loss([sample.to(self.fabric.device) for sample in samples])

    def backward(self, loss: Tensor) -> None:
        """Gradients of the mean loss of all processes."""
        self.optimizer.zero_grad(set_to_none=True)
        self.fabric.backward(loss)

    def update(self) -> float:
        """Changes the weights, unless the gradient is not finite; returns its norm."""
        for group in self.optimizer.param_groups:
            group["lr"] = self.learning_rate
        limit = self.config.gradient_clip or float("inf")
        norm = float(torch.nn.utils.clip_grad_norm_(self.network.parameters(), limit))
        if math.isfinite(norm):
            self.optimizer.step()
            self.average.update(self.network, self.progress.step)
        self.progress.step += 1
        self.progress.visits += self.config.batch * self.fabric.world_size
        return norm

    @property
    def learning_rate(self) -> float:
        """Of the next step."""
        used = self.config.progress(self.progress.step, self.progress.elapsed)
        factor = learning_rate_factor(
            self.progress.step, used, self.config.warmup_steps, self.config.final_learning_rate
        )
        return self.config.learning_rate * factor

    def _resume(self, optimizer: torch.optim.Optimizer) -> Progress:
        """Where the run stands, and everything as it was there; the first process reads the checkpoint for all."""
        content = None
        if self.fabric.is_global_zero and self.checkpoint_path.is_file():
            content = read_checkpoint(self.checkpoint_path)
        content = self.fabric.broadcast(content)
        progress = Progress() if content is None else restore(content, self.network, self.average, optimizer)
        best = self.out / BEST_FILE
        if content is not None and self.fabric.is_global_zero and best.is_file():
            # They may have been written after the checkpoint.
            progress.best = max(progress.best, selection_score(load_weights(best)[1]["metrics"]))
        return progress

    def _validate(self) -> dict[str, float]:
        """Metrics of the averaged weights; they become the run's weights when they are the best so far.

        Done by the first process while the others wait.
        """
        metrics: dict[str, float] = {}
        if self.validation:
            metrics = evaluate(self.average.network, self.validation, self.config.matching)
            self._write("val", metrics)
            if selection_score(metrics) > self.progress.best:
                self.progress.best = selection_score(metrics)
                self._save_weights(BEST_FILE, metrics)
        self.fabric.barrier()
        return metrics

    def _finish(self, stopped_early: bool) -> dict[str, float]:
        """Checkpoint, and at the end of the budget also the last validation and the final weights."""
        metrics: dict[str, float] = {}
        if not stopped_early or self.config.progress(self.progress.step, self.progress.elapsed) >= 1.0:
            metrics = self._validate()
            self._save_weights(FINAL_FILE, metrics)
            if not self.validation:
                self._save_weights(BEST_FILE, metrics)
            self.progress.finished = True
        self._save()
        self.fabric.barrier()
        return metrics

    def _save(self) -> None:
        if self.fabric.is_global_zero:
            save_checkpoint(self.checkpoint_path, self.progress, self.network, self.average, self.optimizer)

    def _save_weights(self, name: str, metrics: dict[str, float]) -> None:
        if self.fabric.is_global_zero:
            metadata = {"step": self.progress.step, "scenes": self.progress.visits, "metrics": metrics}
            save_weights(self.out / name, self.average.network, metadata)

    def _write(self, kind: str, values: dict[str, Any]) -> None:
        """Appends a line to the log and reports it."""
        if not self.fabric.is_global_zero:
            return
        where = {"kind": kind, "step": self.progress.step, "scenes": self.progress.visits}
        line = where | {"elapsed_s": round(self.progress.elapsed, 1)} | values
        with (self.out / METRICS_FILE).open("a") as file:
            file.write(json.dumps(finite({key: _rounded(value) for key, value in line.items()})) + "\n")
        self.report(" ".join(f"{key} {_rounded(value)}" for key, value in line.items()))


def make_optimizer(network: IcgNet, config: TrainingConfig) -> torch.optim.Optimizer:
    """The optimiser of a run over all parameters of a network.

    Muon takes matrices and kernels; vectors and the queries' learnt content, of which each row is its own, stay with
    Adam.
    """
    parameters = list(network.parameters())
    if config.optimizer == "adamw":
        return torch.optim.AdamW(parameters, lr=config.learning_rate, weight_decay=config.weight_decay, fused=True)
    content = network.refinement.content
    matrices = [each for each in parameters if each.ndim > 1 and each is not content]
    others = [each for each in parameters if each.ndim < 2 or each is content]
    return Muon(matrices, others, config.learning_rate, config.weight_decay)


def _silence(line: str) -> None:
    """Reports nothing."""


def to_agree_on(config: TrainingConfig, recipes: Sequence[Recipe]) -> dict[str, Any]:
    """What processes that train together must have in common, by name: the scenes and nearly all settings."""
    names = [(each.object_set, each.kind, each.split, each.seed, each.scene_id) for each in recipes]
    settings = {name: value for name, value in asdict(config).items() if name not in ("threads", "workers")}
    return {"scenes": f"{len(recipes)} scenes {zlib.crc32(repr(names).encode()):08x}", **settings}


def _rounded(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value
