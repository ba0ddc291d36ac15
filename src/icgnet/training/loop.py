"""The training loop: one for a laptop, a GPU or several, through Lightning Fabric."""

import json
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import torch
from lightning_fabric import Fabric
from torch.utils.data import DataLoader

from icgnet.datagen.recipe import read_recipes
from icgnet.errors import DataError
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import load_weights, save_weights, stored_checksum
from icgnet.training.checkpoint import CHECKPOINT_FILE, Progress, WeightAverage, load_checkpoint, save_checkpoint
from icgnet.training.config import TrainingConfig, training_record, write_or_compare
from icgnet.training.dataset import RecipeDataset, VisitBatches
from icgnet.training.losses import TrainingLoss
from icgnet.training.metrics import evaluate, selection_score
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
) -> dict[str, float]:
    """Trains a network, or goes on with the run that `out` holds, and returns its last validation metrics.

    Writes to `out`: config.json, metrics.jsonl, checkpoint.pt, weights.safetensors (best on validation scenes, averaged
    weights) and, when the budget is used up, weights_final.safetensors.

    Args:
        config: of the run.
        data: folders of recipes; those of split "train" are trained on, those of split "val" are validated on.
        out: folder of the run.
        objects: sources of the object sets that the recipes name, see `load_object_set`.
        report: gets a line of text now and then.
        leg_steps: stop after so many steps of this call, with a checkpoint; None goes on to the end of the budget.
        start: weights that the run begins with; random ones if None.

    Raises:
        DataError: no training recipes, a missing object set, a damaged checkpoint, weights that are damaged or of
            another network, or a run with other settings.
    """
    recipes = [recipe for folder in data for recipe in read_recipes(Path(folder))]
    by_split = {split: [recipe for recipe in recipes if recipe.split == split] for split in ("train", "val")}
    if not by_split["train"]:
        raise DataError(f"no recipes of split 'train' in {', '.join(map(str, data))}")
    counts = {"scenes": len(by_split["train"]), "validation_scenes": len(by_split["val"])}
    out = Path(out)
    begins_with = None if start is None else stored_checksum(start)
    record = training_record(
        config, {"folders": sorted(str(folder) for folder in data), **counts, "start": begins_with}
    )
    for change in write_or_compare(out, record):
        report(f"going on with another setting: {change}")
    torch.set_num_threads(config.threads)
    report(f"loading the objects of {len(recipes)} scenes")
    object_sets = load_object_sets(objects)
    dataset = RecipeDataset(by_split["train"], object_sets, config.sampling, NETWORKS[config.network], config.seed)
    validation = validation_samples(
        config.network, config.sampling, config.validation_scenes, by_split["val"], object_sets
    )
    return Trainer(config, dataset, validation, out, report, start).run(leg_steps)


class Trainer:
    """A run: its network, optimiser, average, and where it stands."""

    def __init__(
        self,
        config: TrainingConfig,
        dataset: RecipeDataset,
        validation: list[Sample],
        out: Path,
        report: Report,
        start: Path | None = None,
    ) -> None:
        self.config, self.dataset, self.validation, self.out, self.report = config, dataset, validation, out, report
        self.fabric = Fabric(devices="auto", accelerator="auto")
        self.fabric.launch()
        torch.manual_seed(config.seed)
        self.network = IcgNet(NETWORKS[config.network])
        if start is not None:
            self.network.load_state_dict(load_weights(start, NETWORKS[config.network])[0].state_dict())
        self.average = WeightAverage(self.network, config.average_decay)
        optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=config.learning_rate, weight_decay=config.weight_decay, fused=True
        )
        self.progress = Progress()
        if self.checkpoint_path.is_file():
            self.progress = load_checkpoint(self.checkpoint_path, self.network, self.average, optimizer)
        loss = TrainingLoss(self.network, config.loss, config.matching, config.bfloat16)
        self.loss, self.optimizer = self.fabric.setup(loss, optimizer)
        self.average.network.to(self.fabric.device)
        self.validation = [sample.to(self.fabric.device) for sample in validation]

    @property
    def checkpoint_path(self) -> Path:
        """Where the run's checkpoint is."""
        return self.out / CHECKPOINT_FILE

    def run(self, leg_steps: int | None = None) -> dict[str, float]:
        """Trains until the budget is used up, or for `leg_steps` steps, and returns the last validation metrics."""
        if self.progress.finished:
            self.report(f"{self.out} is finished: {self.progress.step} steps, {self.progress.visits} scenes")
            return evaluate(self.average.network, self.validation, self.config.matching)
        if self.progress.step:
            self.report(f"going on from step {self.progress.step}")
        batches = self._batches()
        clock = _Clock(self.progress.elapsed)
        log = _Log()
        saved = validated = logged = clock.elapsed
        last_step = self.progress.step + leg_steps if leg_steps is not None else None
        while self.config.progress(self.progress.step, self.progress.elapsed) < 1.0 and self.progress.step != last_step:
            with log.waiting:
                samples = next(batches)
            log.add(self._step(samples), len(samples))
            self.progress.elapsed = now = clock.elapsed
            if now - logged > self.config.log_seconds:
                self._write("train", log.summary(now - logged) | {"learning_rate": self._learning_rate()})
                log, logged = _Log(), now
            if now - validated > 60 * self.config.validation_minutes:
                self._validate()
                validated = logged = clock.elapsed
            if now - saved > 60 * self.config.checkpoint_minutes:
                self._save()
                saved = clock.elapsed
        return self._finish(stopped_early=self.progress.step == last_step)

    def _batches(self) -> Iterator[list[Sample]]:
        """The samples of the visits that come next."""
        start = self.progress.visits
        visits = VisitBatches(start, self.config.batch, self.fabric.global_rank, self.fabric.world_size)
        loader = DataLoader(
            self.dataset,
            batch_sampler=visits,
            num_workers=self.config.workers,
            collate_fn=list,
            prefetch_factor=4 if self.config.workers else None,
            # Its own generator, because the loader draws from it when it starts, at every leg of a run.
            generator=torch.Generator(),
        )
        return iter(loader)

    def _step(self, samples: list[Sample]) -> dict[str, torch.Tensor]:
        """One optimiser step; returns the loss terms, the gradient's norm and whether the step had to be skipped."""
        rate = self._learning_rate()
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.loss.train()
        total, terms = self.loss([sample.to(self.fabric.device) for sample in samples])
        self.optimizer.zero_grad(set_to_none=True)
        self.fabric.backward(total)
        limit = self.config.gradient_clip or float("inf")
        norm = torch.nn.utils.clip_grad_norm_(self.network.parameters(), limit)
        usable = bool(torch.isfinite(norm))
        if usable:
            self.optimizer.step()
            self.average.update(self.network, self.progress.step)
        self.progress.step += 1
        self.progress.visits += len(samples) * self.fabric.world_size
        return terms | {"loss": total.detach(), "gradient_norm": norm, "skipped": torch.tensor(float(not usable))}

    def _learning_rate(self) -> float:
        used = self.config.progress(self.progress.step, self.progress.elapsed)
        factor = learning_rate_factor(
            self.progress.step, used, self.config.warmup_steps, self.config.final_learning_rate
        )
        return self.config.learning_rate * factor

    def _validate(self) -> dict[str, float]:
        """Metrics of the averaged weights; they become the run's weights when they are the best so far."""
        if not self.validation or not self.fabric.is_global_zero:
            return {}
        metrics = evaluate(self.average.network, self.validation, self.config.matching)
        self._write("val", metrics)
        if selection_score(metrics) > self.progress.best:
            self.progress.best = selection_score(metrics)
            self._save_weights(BEST_FILE, metrics)
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
            file.write(json.dumps({key: _rounded(value) for key, value in line.items()}) + "\n")
        self.report(" ".join(f"{key} {_rounded(value)}" for key, value in line.items()))


class _Clock:
    """Training time including that of earlier legs [s]."""

    def __init__(self, before: float) -> None:
        self._start = time.perf_counter() - before

    @property
    def elapsed(self) -> float:
        return time.perf_counter() - self._start


class _Log:
    """Means of what the steps since the last line reported."""

    def __init__(self) -> None:
        self.steps: list[dict[str, torch.Tensor]] = []
        self.scenes = 0
        self.waiting = _Stopwatch()

    def add(self, values: dict[str, torch.Tensor], scenes: int) -> None:
        self.steps.append(values)
        self.scenes += scenes
        skipped = [float(step["skipped"]) for step in self.steps[-MOST_SKIPPED:]]
        if len(skipped) == MOST_SKIPPED and all(skipped):
            raise RuntimeError(f"the gradient was not finite in {MOST_SKIPPED} steps in a row: training has diverged")

    def summary(self, seconds: float) -> dict[str, float]:
        """Means over the steps, scenes per second and the share of time spent waiting for samples."""
        names = sorted({name for step in self.steps for name in step})
        means = {name: _mean([float(step[name]) for step in self.steps if name in step]) for name in names}
        return means | {"scenes_per_s": self.scenes / seconds, "waiting_share": self.waiting.seconds / seconds}


class _Stopwatch:
    """Adds up the time spent inside `with`."""

    def __init__(self) -> None:
        self.seconds = 0.0

    def __enter__(self) -> None:
        self._start = time.perf_counter()

    def __exit__(self, *exception: object) -> None:
        self.seconds += time.perf_counter() - self._start


def _mean(values: list[float]) -> float:
    return sum(values) / len(values)


def _rounded(value: Any) -> Any:
    return float(f"{value:.4g}") if isinstance(value, float) else value
