"""How sure a number is that was measured on a few scenes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from icgnet.benchmark.tables import NOTHING

DRAWS = 1000
SceneT = TypeVar("SceneT")


@dataclass(frozen=True)
class Spread:
    """A number measured on scenes.

    Attributes:
        mean: the number, of all scenes.
        std: population standard deviation over the scenes.
        low: lower end of the 95 % interval (percentile bootstrap over the scenes).
        high: upper end.
    """

    mean: float
    std: float
    low: float
    high: float


@dataclass(frozen=True)
class Metric(Generic[SceneT]):
    """A number that a benchmark measures.

    Attributes:
        label: in tables, with the unit.
        number: of any collection of scenes; None where it is not defined.
        digits: behind the point, in tables.
    """

    label: str
    number: Callable[[Sequence[SceneT]], float | None]
    digits: int = 1


def spreads(metrics: Mapping[str, Metric[SceneT]], scenes: Sequence[SceneT]) -> dict[str, Spread | None]:
    """The spread of every metric over some scenes, by its name."""
    return {name: spread(scenes, metric.number) for name, metric in metrics.items()}


def spread(scenes: Sequence[SceneT], number: Callable[[Sequence[SceneT]], float | None]) -> Spread | None:
    """A number of some scenes, and how it would vary with other ones; None if they do not define it.

    Args:
        scenes: what was measured on each.
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


def cells(value: Spread | None, digits: int = 1) -> tuple[str, str]:
    """A number with its standard deviation over the scenes, and its 95 % interval, for a table."""
    if value is None:
        return NOTHING, NOTHING
    return f"{value.mean:.{digits}f} ± {value.std:.{digits}f}", f"{value.low:.{digits}f}-{value.high:.{digits}f}"


def mean_or_none(values: Sequence[float | None]) -> float | None:
    """The mean of the values that are there; None if there are none."""
    there = [value for value in values if value is not None]
    return float(np.mean(there)) if there else None
