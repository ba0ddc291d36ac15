"""Clutter removal: the rounds of all runs on any number of processes, resumable, and their statistics.

Paper: "Experiments", grasp success rate (GSR) and declutter rate (DR).
"""

import json
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from icgnet.benchmark.config import NOTHING_FOUND, ClutterConfig, WorkcellConfig
from icgnet.benchmark.record import REPORT_FILE, read_json, settings, source_commit, write_report
from icgnet.benchmark.rounds import Attempt, ClutterJob, Round, Shot, planner_of
from icgnet.benchmark.statistics import Spread, cell, success_rate
from icgnet.benchmark.tables import Table
from icgnet.errors import DataError
from icgnet.files import cut_unfinished_line, write_json
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.object_set import load_object_set
from icgnet.parallel.lock import locked
from icgnet.parallel.pool import local_pool

CONFIG_FILE, ROUNDS_FILE = "config.json", "rounds.jsonl"


@dataclass(frozen=True)
class ClutterNumbers:
    """The result of a benchmark.

    Rates are in percent, None where nothing was tried: mean and population standard deviation over the runs, as
    published, and Wilson's 95 % interval of the pooled rate, as if all attempts were independent.

    Attributes:
        gsr: successes by attempts.
        dr: objects grasped away by objects placed; what was pushed out of the workspace counts as not removed.
        dr_holdable: the same of the objects that the hand could hold if each stood alone where it is at the start of
            its round; None where this was not asked, as in packed and pile.
        attempts: grasps that were executed.
        runs: in which scenes were played.
        rounds: scenes that were played.
        objects: that were placed.
        holdable: of these, those that `dr_holdable` is about.
        failures: number of failed attempts by cause, and pictures in which "nothing found".
        touching: attempts, failed or not, in which the open hand touched anything but the target on its way.
        lost: objects that were pushed out of the workspace.
        plan_seconds: median time of the planner for one picture [s].
        commits: every source that rounds were played with; None for one that no commit is known to hold.
    """

    gsr: Spread | None
    dr: Spread | None
    dr_holdable: Spread | None
    attempts: int
    runs: int
    rounds: int
    objects: int
    holdable: int
    failures: dict[str, int]
    touching: int
    lost: int
    plan_seconds: float
    commits: tuple[str | None, ...]


def summarise(rounds: Sequence[Round]) -> ClutterNumbers:
    """The statistics of rounds; at least one."""
    runs = sorted({each.run for each in rounds})
    by_run = [[each for each in rounds if each.run == run] for run in runs]
    tries = [sum(len(each.attempts) for each in own) for own in by_run]
    placed = [sum(each.placed for each in own) for own in by_run]
    successes = [sum(each.successes for each in own) for own in by_run]
    holdable = [sum(each.holdable or 0 for each in own) for own in by_run]
    grasped = [sum(each.holdable_grasped or 0 for each in own) for own in by_run]
    attempts = [attempt for each in rounds for attempt in each.attempts]
    failures = Counter(attempt.cause for attempt in attempts if not attempt.success)
    failures[NOTHING_FOUND] = sum(len(each.skipped) for each in rounds)
    return ClutterNumbers(
        gsr=_rate(successes, tries),
        dr=_rate(successes, placed),
        dr_holdable=_rate(grasped, holdable),
        attempts=sum(tries),
        runs=len(runs),
        rounds=len(rounds),
        objects=sum(placed),
        holdable=sum(holdable),
        failures=dict(failures),
        touching=sum(bool(attempt.touched) for attempt in attempts),
        lost=sum(len(attempt.lost) for attempt in attempts),
        plan_seconds=float(np.median([attempt.plan_seconds for attempt in attempts])) if attempts else float("nan"),
        commits=tuple(dict.fromkeys(each.commit for each in rounds)),
    )


def _rate(successes: Sequence[int], totals: Sequence[int]) -> Spread | None:
    """Mean and spread over runs, and Wilson's interval of all runs together; None where nothing was tried."""
    rates = [100.0 * s / t for s, t in zip(successes, totals, strict=True) if t]
    pooled = success_rate(sum(successes), sum(totals))
    if pooled is None:
        return None
    return replace(pooled, mean=float(np.mean(rates)), std=float(np.std(rates)) if len(totals) > 1 else None)


def tables(numbers: ClutterNumbers) -> list[Table]:
    """What is printed."""
    causes, is_wide = sorted(numbers.failures.items(), key=lambda item: -item[1]), numbers.dr_holdable is not None
    rows = [
        ("grasp success rate, % [95 %]", cell(numbers.gsr, ".1f")),
        ("declutter rate, % [95 %]", cell(numbers.dr, ".1f")),
        *(
            [(f"of the {numbers.holdable} objects that the hand could hold", cell(numbers.dr_holdable, ".1f"))]
            * is_wide
        ),
        ("rounds, objects, attempts", f"{numbers.rounds}, {numbers.objects}, {numbers.attempts}"),
        *((cause if cause == NOTHING_FOUND else f"failed: {cause}", str(count)) for cause, count in causes),
        ("attempts that touched something else on their way", str(numbers.touching)),
        ("objects pushed out of the workspace", str(numbers.lost)),
        ("planning, median", f"{numbers.plan_seconds:.2f} s"),
    ]
    return [Table(("what", "value"), rows)]


def run_clutter(
    config: ClutterConfig,
    out: Path,
    workers: int = 1,
    on_round: Callable[[Sequence[Round]], None] = lambda rounds: None,
) -> ClutterNumbers:
    """Plays all rounds that a folder lacks, and writes what came of them.

    Writes config.json, rounds.jsonl (a line for each finished round, so that a killed benchmark goes on where it was)
    and report.json, which names every commit that rounds were played with.

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
    job = ClutterJob(config, load_object_set(config.objects), load_gripper(config.gripper), source_commit())
    # What is wrong with the planner shows here, and not in a worker. A single process goes on with this one.
    planner_of(config, anew=True)
    out.mkdir(parents=True, exist_ok=True)
    with locked(out):
        check_config(out / CONFIG_FILE, config)
        cut_unfinished_line(out / ROUNDS_FILE)
        rounds = read_rounds(out / ROUNDS_FILE)
        on_round(rounds)
        done = {each.run * config.rounds + each.round for each in rounds}
        missing = [number for number in range(config.runs * config.rounds) if number not in done]
        with (out / ROUNDS_FILE).open("a") as file, closing(local_pool(job, workers)) as pool:
            for finished in pool.make(missing):
                file.write(json.dumps(asdict(finished)) + "\n")
                file.flush()
                rounds.append(finished)
                on_round(rounds)
        numbers = summarise(rounds)
        if missing or not (out / REPORT_FILE).is_file():
            write_report(out, "clutter", config, numbers)
    return numbers


def check_config(path: Path, config: ClutterConfig | WorkcellConfig) -> None:
    """Makes sure that the configuration of a folder is this one, and writes it if there is none.

    Raises:
        DataError: another benchmark is in the folder, or what is there cannot be read.
    """
    now = settings(config)
    if not path.is_file():
        write_json(path, now)
    there = read_json(path)
    if not isinstance(there, dict):
        raise DataError(f"{path}: must hold names with values, got {there!r}")
    changes = [f"{key} is {there.get(key)!r} there, {now[key]!r} now" for key in now if there.get(key) != now[key]]
    if changes:
        raise DataError(f"{path.parent}: holds another benchmark: {'; '.join(changes)}")


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
