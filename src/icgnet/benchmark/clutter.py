"""Clutter removal: the rounds of all runs on any number of processes, resumable, and their statistics.

Paper: "Experiments", grasp success rate (GSR) and declutter rate (DR).
"""

import json
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import binomtest

from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.planner import Planner
from icgnet.benchmark.planners.registry import load_planner
from icgnet.benchmark.record import REPORT_FILE, settings, source_commit, write_report
from icgnet.benchmark.rounds import NOTHING_FOUND, Attempt, Round, Shot, play_round
from icgnet.benchmark.statistics import Spread
from icgnet.benchmark.tables import Table
from icgnet.errors import DataError
from icgnet.files import cut_unfinished_line, new_file, write_json
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.parallel.lock import locked
from icgnet.parallel.pool import local_pool

CONFIG_FILE, ROUNDS_FILE, ATTEMPTS_FILE = "config.json", "rounds.jsonl", "attempts.jsonl"


@dataclass(frozen=True)
class ClutterNumbers:
    """The result of a benchmark.

    Rates are in percent: mean and population standard deviation over the runs, as published, and Wilson's 95 % interval
    of the pooled rate, as if all attempts were independent.

    Attributes:
        gsr: successes by attempts.
        dr: objects grasped away by objects placed; what was pushed out of the workspace counts as not removed.
        attempts: grasps that were executed.
        runs: in which scenes were played.
        rounds: scenes that were played.
        objects: that were placed.
        failures: number of failed attempts by cause, and pictures in which "nothing found".
        touching: attempts, failed or not, in which the open hand touched anything but the target on its way.
        lost: objects that were pushed out of the workspace.
        plan_seconds: median time of the planner for one picture [s].
    """

    gsr: Spread
    dr: Spread
    attempts: int
    runs: int
    rounds: int
    objects: int
    failures: dict[str, int]
    touching: int
    lost: int
    plan_seconds: float


@dataclass(frozen=True)
class ClutterJob:
    """Everything that a worker must know to play any round; the planner is made in the worker."""

    config: ClutterConfig
    object_set: ObjectSet
    gripper: Gripper

    def make(self, number: int) -> Round:
        """The round of this number; those of all runs are counted through."""
        run, index = divmod(number, self.config.rounds)
        return play_round(self.config, run, index, _planner(self.config), self.object_set, self.gripper)

    def name(self, number: int) -> str:
        """How messages call a round."""
        run, index = divmod(number, self.config.rounds)
        return f"round {index} of run {run} (seed {self.config.seed})"


# A process keeps its planner, so that weights are read once and not for every round.
_planners: dict[ClutterConfig, Planner] = {}


def _planner(config: ClutterConfig) -> Planner:
    if config not in _planners:
        _planners[config] = load_planner(config)
    return _planners[config]


def summarise(rounds: Sequence[Round]) -> ClutterNumbers:
    """The statistics of rounds; at least one."""
    runs = sorted({each.run for each in rounds})
    attempts = [attempt for each in rounds for attempt in each.attempts]
    failures = Counter(attempt.cause for attempt in attempts if not attempt.success)
    failures[NOTHING_FOUND] = sum(each.skips for each in rounds)
    by_run = [[each for each in rounds if each.run == run] for run in runs]
    tries = [sum(len(each.attempts) for each in own) for own in by_run]
    placed = [sum(each.placed for each in own) for own in by_run]
    successes = [sum(each.successes for each in own) for own in by_run]
    return ClutterNumbers(
        gsr=_rate(successes, tries),
        dr=_rate(successes, placed),
        attempts=sum(tries),
        runs=len(runs),
        rounds=len(rounds),
        objects=sum(placed),
        failures=dict(failures),
        touching=sum(bool(attempt.touched) for attempt in attempts),
        lost=sum(each.lost for each in rounds),
        plan_seconds=float(np.median([attempt.plan_seconds for attempt in attempts])) if attempts else float("nan"),
    )


def _rate(successes: Sequence[int], totals: Sequence[int]) -> Spread:
    """Mean and spread over runs, and Wilson's interval of all runs together; nan where nothing was tried."""
    rates = [100.0 * s / t for s, t in zip(successes, totals, strict=True) if t]
    if not rates:
        return Spread(*[float("nan")] * 4)
    interval = binomtest(sum(successes), sum(totals)).proportion_ci(0.95, method="wilson")
    return Spread(
        float(np.mean(rates)), float(np.std(rates)), 100.0 * float(interval.low), 100.0 * float(interval.high)
    )


def tables(numbers: ClutterNumbers) -> list[Table]:
    """What is printed."""
    causes = sorted(numbers.failures.items(), key=lambda item: -item[1])
    rows = [
        ("grasp success rate, %", _rate_cell(numbers.gsr, numbers.runs)),
        ("declutter rate, %", _rate_cell(numbers.dr, numbers.runs)),
        ("rounds, objects, attempts", f"{numbers.rounds}, {numbers.objects}, {numbers.attempts}"),
        *((cause if cause == NOTHING_FOUND else f"failed: {cause}", str(count)) for cause, count in causes),
        ("attempts that touched something else on their way", str(numbers.touching)),
        ("objects pushed out of the workspace", str(numbers.lost)),
        ("planning, median", f"{numbers.plan_seconds:.2f} s"),
    ]
    return [Table(("what", "value"), rows)]


def _rate_cell(rate: Spread, runs: int) -> str:
    spread = f" ± {rate.std:.1f}" if runs > 1 else ""
    return f"{rate.mean:.1f}{spread} (95 %: {rate.low:.1f} to {rate.high:.1f})"


def run_clutter(
    config: ClutterConfig,
    out: Path,
    workers: int = 1,
    on_round: Callable[[Sequence[Round]], None] = lambda rounds: None,
) -> ClutterNumbers:
    """Plays all rounds that a folder lacks, and writes what came of them.

    Writes config.json, rounds.jsonl (a line for each finished round, so that a killed benchmark goes on where it was),
    attempts.jsonl and report.json, which names every commit that rounds were played with.

    Args:
        config: of the benchmark.
        out: folder, made if it is missing.
        workers: processes. Every round draws the same whatever their number is; only the times differ, and what a
            planner computes otherwise with another number of threads, since each of several workers has one.
        on_round: called with all finished rounds, at the start and after each one.

    Raises:
        InputError: unknown planner or objects.
        DataError: a folder with another benchmark, one that another process is writing into, or a round there that
            cannot be read.
    """
    job = ClutterJob(config, load_object_set(config.objects), load_gripper(config.gripper))
    # What is wrong with the planner shows here, and not in a worker. A single process goes on with this one.
    _planners[config] = load_planner(config)
    out.mkdir(parents=True, exist_ok=True)
    with locked(out):
        _check_config(out / CONFIG_FILE, config)
        cut_unfinished_line(out / ROUNDS_FILE)
        rounds = read_rounds(out / ROUNDS_FILE)
        on_round(rounds)
        done = {each.run * config.rounds + each.round for each in rounds}
        missing = [number for number in range(config.runs * config.rounds) if number not in done]
        commits = _commits(out, config, played=bool(rounds), goes_on=bool(missing))
        with (out / ROUNDS_FILE).open("a") as file, closing(local_pool(job, workers)) as pool:
            for finished in pool.make(missing):
                file.write(json.dumps(asdict(finished)) + "\n")
                file.flush()
                rounds.append(finished)
                on_round(rounds)
        rounds.sort(key=lambda each: (each.run, each.round))
        numbers = summarise(rounds)
        if missing or not (out / REPORT_FILE).is_file():
            _write_attempts(out / ATTEMPTS_FILE, rounds)
            write_report(out, "clutter", config, numbers, protocol=config.protocol, commits=commits)
    return numbers


def _check_config(path: Path, config: ClutterConfig) -> None:
    """Makes sure that the configuration of a folder, if there is one, is this one.

    Raises:
        DataError: another benchmark is in the folder.
    """
    now, there = settings(config), _read_object(path)
    changes = [f"{key} is {there.get(key)!r} there, {now[key]!r} now" for key in now if there.get(key) != now[key]]
    if there and changes:
        raise DataError(f"{path.parent}: holds another benchmark: {'; '.join(changes)}")


def _commits(out: Path, config: ClutterConfig, *, played: bool, goes_on: bool) -> list[str | None]:
    """The commits that the rounds of a folder were played with; None stands for one that is not known.

    Args:
        out: the folder; its configuration is written if it lacks one, or if rounds are going to be played.
        config: of the benchmark.
        played: whether it holds rounds.
        goes_on: whether rounds are going to be played, with the source that runs now.
    """
    there = _read_object(out / CONFIG_FILE)
    commits = there.get("commits")
    if commits is None:  # no rounds yet, or rounds of a version that named one commit, in the report
        origin = _read_object(out / REPORT_FILE).get("origin")
        commits = [origin.get("commit") if isinstance(origin, dict) else None] if played else []
    if goes_on:
        commits = list(dict.fromkeys([*commits, source_commit()]))
    if goes_on or not there:
        write_json(out / CONFIG_FILE, {**settings(config), "commits": commits})
    return commits


def _read_object(path: Path) -> dict[str, Any]:
    """The names and values in a file; none if it is missing.

    Raises:
        DataError: something else is in it.
    """
    if not path.is_file():
        return {}
    try:
        values = json.loads(path.read_text())
    except (ValueError, OSError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    if not isinstance(values, dict):
        raise DataError(f"{path}: must hold names with values, got {values!r}")
    return values


def read_rounds(path: Path) -> list[Round]:
    """The finished rounds of a file; a last line that was cut off by a kill is none.

    Raises:
        DataError: a line that is no round.
    """
    if not path.is_file():
        return []
    lines = [line for line in path.read_text().splitlines(keepends=True) if line.endswith("\n")]
    return [_round(line, f"{path}, line {number}") for number, line in enumerate(lines, start=1)]


def _round(line: str, place: str) -> Round:
    """The round that a line holds.

    Raises:
        DataError: it holds none.
    """
    try:
        row = json.loads(line)
        attempts, skipped = [Attempt(**each) for each in row["attempts"]], [Shot(**each) for each in row["skipped"]]
        return Round(**{**row, "attempts": attempts, "skipped": skipped})
    except KeyError as error:
        raise DataError(f"{place}: this round has no {error.args[0]!r}; delete the line to play it again") from error
    except (ValueError, TypeError) as error:
        raise DataError(f"{place}: not a round: {error}; delete the line to play it again") from error


def _write_attempts(path: Path, rounds: Sequence[Round]) -> None:
    lines = [json.dumps(asdict(attempt)) + "\n" for each in rounds for attempt in each.attempts]
    with new_file(path) as file:
        file.write("".join(lines).encode())
