"""All rounds of the workcell, on any number of processes and resumable, and their statistics."""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from icgnet.benchmark.clutter import CONFIG_FILE, ROUNDS_FILE, check_config
from icgnet.benchmark.config import WorkcellConfig
from icgnet.benchmark.record import REPORT_FILE, source_commit, write_report
from icgnet.benchmark.statistics import Spread, causes_told, cell, success_rate
from icgnet.benchmark.tables import Table
from icgnet.benchmark.workcell.rounds import (
    PickAttempt,
    Sight,
    WorkcellJob,
    WorkcellRound,
    draw_pool,
    nothing_found,
    tools_of,
)
from icgnet.errors import DataError
from icgnet.files import cut_unfinished_line
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.object_set import load_object_set
from icgnet.parallel.lock import locked
from icgnet.parallel.pool import local_pool

HOUR = 3600.0


@dataclass(frozen=True)
class FetchNumbers:
    """What fetching by one strategy gave.

    Attributes:
        fetched: rounds in which the object came into the box, in percent with Wilson's 95 % interval.
        rounds: that were played.
        picks: mean number of picks of the rounds in which it did; nan if there are none.
        blocked: rounds in which the first plan took something else away before; None of the strategy highest.
        blockers: objects in the way in these rounds, on the average, as the first plan says; None as above.
        reasons: what those objects were in the way of, and how often.
    """

    fetched: Spread | None
    rounds: int
    picks: float
    blocked: int | None
    blockers: float | None
    reasons: dict[str, int]


@dataclass(frozen=True)
class WorkcellNumbers:
    """The result of a benchmark. Rates are in percent, with Wilson's 95 % interval as if all were independent.

    Attributes:
        gsr: picks that brought their object into the box, by picks.
        dr: objects that came into the box, by objects placed.
        attempts: picks.
        rounds: that were played.
        objects: that were placed.
        failures: failed picks by phase and cause.
        empty: pictures that led to no pick, by why.
        refused: grasps that could not be carried out, by reason.
        touching: picks in which arm or hand touched anything but the target before they let go.
        displacing: picks after which another object had moved by more than 1 cm.
        lost: objects that left the workspace and are not in the box.
        carries: picks in which the target was lifted.
        hits: of these, the share in which it met something on its way.
        hit_by: what it met, and how often.
        kept: picks whose plan kept limits and depth when it was played back.
        deepest: how deep anything was in something else then, at most [m].
        tracking: largest error of a joint [rad].
        plan_median: time of planning all phases of a pick for the arm [s].
        plan_p95: what one in twenty is above [s].
        see_median: time from the picture to objects, shapes and grasps [s].
        cycle: mean time of the motion of a pick, simulated [s].
        picks_per_hour: successful picks in an hour of motion, seeing and planning.
        fetch: the same rounds as fetches, by strategy; empty if all was cleared.
        commits: every source that rounds were played with; None for one that no commit is known to hold.
    """

    gsr: Spread | None
    dr: Spread | None
    attempts: int
    rounds: int
    objects: int
    failures: dict[str, int]
    empty: dict[str, int]
    refused: dict[str, int]
    touching: int
    displacing: int
    lost: int
    carries: int
    hits: Spread | None
    hit_by: dict[str, int]
    kept: int
    deepest: float
    tracking: float
    plan_median: float
    plan_p95: float
    see_median: float
    cycle: float
    picks_per_hour: float
    fetch: dict[str, FetchNumbers]
    commits: tuple[str | None, ...]


def summarise(rounds: Sequence[WorkcellRound]) -> WorkcellNumbers:
    """The statistics of rounds; at least one."""
    attempts = [attempt for each in rounds for attempt in each.attempts]
    empty = [sight for each in rounds for sight in each.empty]
    sights: list[Sight] = [*attempts, *empty]
    carried = [attempt for attempt in attempts if attempt.carried]
    successes, placed = sum(attempt.success for attempt in attempts), sum(each.placed for each in rounds)
    refused: Counter[str] = Counter()
    for sight in sights:
        refused.update(sight.refused)
    seconds = sum(each.move_seconds for each in rounds) + sum(attempt.cycle_seconds for attempt in attempts)
    seconds += sum(sight.see_seconds + sight.plan_seconds for sight in sights)
    return WorkcellNumbers(
        gsr=success_rate(successes, len(attempts)),
        dr=success_rate(sum(len(attempt.removed) for attempt in attempts), placed),
        attempts=len(attempts),
        rounds=len(rounds),
        objects=placed,
        failures=dict(Counter(told_failure(attempt) for attempt in attempts if not attempt.success)),
        empty=dict(Counter(map(nothing_found, empty))),
        refused=dict(refused.most_common()),
        touching=sum(bool(attempt.touched) for attempt in attempts),
        displacing=sum(bool(attempt.displaced) for attempt in attempts),
        lost=sum(len(attempt.lost) for attempt in attempts),
        carries=len(carried),
        hits=success_rate(sum(bool(attempt.hit) for attempt in carried), len(carried)),
        hit_by=_met(carried),
        kept=sum(attempt.kept for attempt in attempts),
        deepest=max((attempt.replay_depth for attempt in attempts), default=0.0),
        tracking=max((attempt.tracking for attempt in attempts), default=0.0),
        plan_median=_quantile((attempt.plan_seconds for attempt in attempts), 0.5),
        plan_p95=_quantile((attempt.plan_seconds for attempt in attempts), 0.95),
        see_median=_quantile((sight.see_seconds for sight in sights), 0.5),
        cycle=float(np.mean([attempt.cycle_seconds for attempt in attempts])) if attempts else float("nan"),
        picks_per_hour=HOUR * successes / seconds if seconds else 0.0,
        fetch=_fetches(rounds),
        commits=tuple(dict.fromkeys(each.commit for each in rounds)),
    )


def told_failure(attempt: PickAttempt) -> str:
    """Phase and cause of a failed pick."""
    return f"{attempt.phase}: {attempt.cause}" if attempt.phase else attempt.cause


def _met(carried: Iterable[PickAttempt]) -> dict[str, int]:
    """What carried objects met: an object, the table, a structure."""
    kinds = ("table", "structure")
    return dict(Counter(each if each in kinds else "object" for attempt in carried for each in attempt.hit))


def _quantile(values: Iterable[float], share: float) -> float:
    found = list(values)
    return float(np.quantile(found, share)) if found else float("nan")


def _fetches(rounds: Sequence[WorkcellRound]) -> dict[str, FetchNumbers]:
    strategies = dict.fromkeys(each.strategy for each in rounds if each.target is not None)
    return {name: _fetch([each for each in rounds if each.strategy == name], name) for name in strategies}


def _fetch(rounds: Sequence[WorkcellRound], strategy: str) -> FetchNumbers:
    picks = [len(each.attempts) for each in rounds if each.fetched]
    blocked = [each.blocked for each in rounds if each.blocked]
    reasons = Counter(_kind_of(reason) for each in rounds for reason in each.reasons or ())
    plans = strategy == "order"
    return FetchNumbers(
        fetched=success_rate(len(picks), len(rounds)),
        rounds=len(rounds),
        picks=float(np.mean(picks)) if picks else float("nan"),
        blocked=len(blocked) if plans else None,
        blockers=float(np.mean(blocked)) if plans and blocked else None,
        reasons=dict(reasons),
    )


def _kind_of(reason: str) -> str:
    """A reason without the numbers of the two objects."""
    return reason.partition(": ")[2].rpartition(" object")[0]


def tables(numbers: WorkcellNumbers) -> list[Table]:
    """What is printed."""
    attempts, carries = numbers.attempts, numbers.carries
    rows = [
        ("grasp success rate, % [95 %]", cell(numbers.gsr, ".1f")),
        ("declutter rate, % [95 %]", cell(numbers.dr, ".1f")),
        ("rounds, objects, picks", f"{numbers.rounds}, {numbers.objects}, {attempts}"),
        *((f"failed in {told}", str(count)) for told, count in _sorted(numbers.failures)),
        *((told, str(count)) for told, count in _sorted(numbers.empty)),
        ("picks that touched something else", f"{numbers.touching} of {attempts}"),
        ("picks that moved something else by more than 1 cm", f"{numbers.displacing} of {attempts}"),
        ("objects lost", str(numbers.lost)),
        (f"carried objects that hit something, % of {carries} [95 %]", cell(numbers.hits, ".1f")),
        ("what they hit", causes_told(numbers.hit_by) or "nothing"),
        ("plans kept when played back at 1 ms", f"{numbers.kept} of {attempts}"),
        ("deepest in anything then", f"{1e3 * numbers.deepest:.2f} mm"),
        ("largest error of a joint", f"{1e3 * numbers.tracking:.1f} mrad"),
        ("planning a pick, median and 95 %", f"{numbers.plan_median:.2f} s, {numbers.plan_p95:.2f} s"),
        ("seeing, median", f"{numbers.see_median:.2f} s"),
        ("motion of a pick, mean", f"{numbers.cycle:.1f} s"),
        ("successful picks an hour", f"{numbers.picks_per_hour:.0f}"),
    ]
    found = [Table(("what", "value"), rows)]
    if numbers.fetch:
        found.append(_fetch_table(numbers.fetch))
    return found


def _fetch_table(fetch: dict[str, FetchNumbers]) -> Table:
    names = {"order": "what is in the way, fewest picks", "highest": "the highest first"}
    rows = [
        (
            names[strategy],
            str(each.rounds),
            cell(each.fetched, ".1f"),
            f"{each.picks:.2f}",
            "" if each.blocked is None else str(each.blocked),
            causes_told(each.reasons),
        )
        for strategy, each in fetch.items()
    ]
    headers = ("taken away", "rounds", "fetched, % [95 %]", "picks", "blocked", "what is in the way")
    return Table(headers, rows, title="fetching one object")


def _sorted(counts: dict[str, int]) -> list[tuple[str, int]]:
    return sorted(counts.items(), key=lambda item: -item[1])


def run_workcell(
    config: WorkcellConfig,
    out: Path,
    workers: int = 1,
    on_round: Callable[[Sequence[WorkcellRound]], None] = lambda rounds: None,
) -> WorkcellNumbers:
    """Plays all rounds that a folder lacks, and writes what came of them.

    Writes config.json, rounds.jsonl (a line for each finished scene, with both rounds of a fetch) and report.json.

    Args:
        config: of the benchmark.
        out: folder, made if it is missing.
        workers: processes. Every round draws the same whatever their number is.
        on_round: called with all finished rounds, at the start and after each one.

    Raises:
        InputError: unknown objects, hand or arm.
        DataError: unusable weights; a folder with another benchmark, one that another process is writing into, or a
            round there that cannot be read.
        MissingExtraError: the packages of icgnet[arm] are not installed.
    """
    gripper = load_gripper(config.gripper)
    job = WorkcellJob(config, draw_pool(config, load_object_set(config.objects)), gripper, source_commit())
    tools_of(config, gripper)  # what is wrong with them shows here, and not in a worker
    out.mkdir(parents=True, exist_ok=True)
    with locked(out):
        check_config(out / CONFIG_FILE, config)
        cut_unfinished_line(out / ROUNDS_FILE)
        rounds = read_workcell_rounds(out / ROUNDS_FILE)
        on_round(rounds)
        done = {each.round for each in rounds}
        missing = [number for number in range(config.rounds) if number not in done]
        with (out / ROUNDS_FILE).open("a") as file, closing(local_pool(job, workers)) as pool:
            for finished in pool.make(missing):
                file.write(json.dumps([asdict(each) for each in finished]) + "\n")
                file.flush()
                rounds += finished
                on_round(rounds)
        numbers = summarise(rounds)
        if missing or not (out / REPORT_FILE).is_file():
            write_report(out, "workcell", config, numbers)
    return numbers


def read_workcell_rounds(path: Path) -> list[WorkcellRound]:
    """The finished rounds of a file; a last line that was cut off by a kill is none.

    Raises:
        DataError: a line that is no round.
    """
    if not path.is_file():
        return []
    found = []
    for number, line in enumerate(path.read_text().splitlines(keepends=True), start=1):
        if not line.endswith("\n"):
            break
        try:
            for row in json.loads(line):
                attempts = [PickAttempt(**each) for each in row["attempts"]]
                empty = [Sight(**each) for each in row["empty"]]
                found.append(WorkcellRound(**{**row, "attempts": attempts, "empty": empty}))
        except (KeyError, ValueError, TypeError) as error:
            reason = f"has no {error.args[0]!r}" if isinstance(error, KeyError) else str(error)
            raise DataError(
                f"{path}, line {number}: not a round of the workcell: {reason}; delete the line to play it again"
            ) from error
    return found
