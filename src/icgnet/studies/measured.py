"""The two shapes of what studies measure: named numbers of one thing, and the quantiles of many values."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from icgnet.benchmark.tables import NOTHING, Table

DataT = TypeVar("DataT")


@dataclass(frozen=True)
class Number(Generic[DataT]):
    """A number of a study.

    Attributes:
        label: in tables, with the unit.
        of: finds it in what was observed; None where it is not defined.
        form: how it is written, as in `format`.
    """

    label: str
    of: Callable[[DataT], Any]
    form: str = ".2f"


def evaluate(numbers: Mapping[str, Number[DataT]], data: DataT) -> dict[str, Any]:
    """Every number of what was observed, by its name."""
    return {name: number.of(data) for name, number in numbers.items()}


def table(
    headers: Sequence[str],
    numbers: Mapping[str, Number[Any]],
    *columns: Mapping[str, Any],
    title: str = "",
    notes: Sequence[str] = (),
) -> Table:
    """A row for each number; columns that do not have it say so."""
    rows = [
        (
            number.label,
            *(NOTHING if (value := column.get(name)) is None else f"{value:{number.form}}" for column in columns),
        )
        for name, number in numbers.items()
    ]
    return Table(headers, rows, title, notes)


def mean(values: Iterable[Any]) -> float | None:
    """The mean of numbers or truths; None of nothing."""
    found = np.array(list(values))
    return float(found.mean()) if len(found) else None


@dataclass(frozen=True)
class Quantiles:
    """Of many values: their mean and median, and what one tenth of them is below and above."""

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

    def range(self, digits: int = 0) -> str:
        """10th to 90th percentile, for a table."""
        return f"{self.p10:.{digits}f} to {self.p90:.{digits}f}"
