"""The shapes of every measured number: a spread over scenes or runs, quantiles of many values, and what finds them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from scipy.stats import binomtest

from icgnet.benchmark.tables import NOTHING, Table

DRAWS = 1000
DataT = TypeVar("DataT")
SceneT = TypeVar("SceneT")


@dataclass(frozen=True)
class Spread:
    """A number, and how it varies; with a format for its digits it is a text as in our tables.

    Attributes:
        mean: the number, of all scenes or runs.
        std: population standard deviation over the scenes or runs; None where there is a single run.
        low: lower end of the 95 % interval.
        high: upper end.
    """

    mean: float
    std: float | None
    low: float
    high: float

    def __format__(self, form: str) -> str:
        deviation = "" if self.std is None else f" ± {self.std:{form}}"
        return f"{self.mean:{form}}{deviation} [{self.low:{form}}, {self.high:{form}}]"


def success_rate(successes: int, total: int) -> Spread | None:
    """Successes by tries in percent with Wilson's 95 % interval; None where nothing was tried."""
    if not total:
        return None
    interval = binomtest(successes, total).proportion_ci(0.95, method="wilson")
    return Spread(100.0 * successes / total, None, 100.0 * float(interval.low), 100.0 * float(interval.high))


@dataclass(frozen=True)
class Quantiles:
    """Of many values: their mean and median, and what one tenth of them is below and above; also a text.

    The mean of what version 0.1 measured is not known, which nan stands for.
    """

    mean: float
    median: float
    p10: float
    p90: float

    @classmethod
    def of(cls, values: Iterable[float]) -> "Quantiles":
        """The quantiles of at least one value."""
        found = np.array(list(values))
        low, median, high = np.quantile(found, [0.1, 0.5, 0.9]).tolist()
        return cls(float(found.mean()), median, low, high)

    def __format__(self, form: str) -> str:
        return f"{self.median:{form}} ({self.p10:{form}} to {self.p90:{form}})"


@dataclass(frozen=True)
class Metric(Generic[DataT]):
    """A number that a benchmark or a study measures.

    Attributes:
        label: in tables, with the unit.
        of: finds it in what was observed, for a spread in any collection of scenes; None where it is not defined.
        form: how it is written, as in `format`.
    """

    label: str
    of: Callable[[DataT], Any]
    form: str = ".2f"


def evaluate(metrics: Mapping[str, Metric[DataT]], data: DataT) -> dict[str, Any]:
    """Every number of what was observed, by its name."""
    return {name: metric.of(data) for name, metric in metrics.items()}


def spreads(metrics: Mapping[str, Metric[Sequence[SceneT]]], scenes: Sequence[SceneT]) -> dict[str, Spread | None]:
    """The spread of every number over some scenes, by its name."""
    return {name: spread(scenes, metric.of) for name, metric in metrics.items()}


def spread(scenes: Sequence[SceneT], number: Callable[[Sequence[SceneT]], float | None]) -> Spread | None:
    """A number of some scenes, and how it would vary with other ones; None if they do not define it.

    Args:
        scenes: what was measured on each; the interval is a percentile bootstrap over them.
        number: the number of any collection of scenes; None where it is not defined.
    """
    value = number(scenes)
    if value is None:
        return None
    rng = np.random.default_rng(0)
    draws = (number([scenes[i] for i in rng.integers(len(scenes), size=len(scenes))]) for _ in range(DRAWS))
    low, high = np.quantile([draw for draw in draws if draw is not None], [0.025, 0.975])
    singles = [single for scene in scenes if (single := number([scene])) is not None]
    return Spread(float(value), float(np.std(singles)), float(low), float(high))


def mean(values: Iterable[Any]) -> float | None:
    """The mean of the numbers or truths that are there; None if there are none."""
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None


def table(
    headers: Sequence[str],
    metrics: Mapping[str, Metric[Any]],
    *columns: Mapping[str, Any],
    title: str = "",
    notes: Sequence[str] = (),
) -> Table:
    """A row for each number; columns that do not have it say so."""
    rows = [
        (metric.label, *(cell(column.get(name), metric.form) for column in columns)) for name, metric in metrics.items()
    ]
    return Table(headers, rows, title, notes)


def cell(value: Any, form: str) -> str:
    """A number as it stands in a table."""
    return NOTHING if value is None else f"{value:{form}}"


def causes_told(failures: Mapping[str, int]) -> str:
    """Failures by cause in words, the most frequent first."""
    return ", ".join(f"{count} {cause}" for cause, count in sorted(failures.items(), key=lambda item: -item[1]))
