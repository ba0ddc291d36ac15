"""The reports that earlier benchmarks wrote, read back."""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from icgnet.benchmark.record import REPORT_FILE, read_json
from icgnet.benchmark.statistics import Quantiles, Spread
from icgnet.errors import DataError, InputError

KINDS = (
    "clutter",
    "reconstruction",
    "segmentation",
    "latency",
    "captures",
    "target",
    "workcell",
    "simulation",
    "loader",
    "label-ceiling",
    "hands",
    "sensor-noise",
    "training-speed",
)
"""What a report can be of."""
NumbersT = TypeVar("NumbersT", Spread, Quantiles)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and not abs(value) > sys.float_info.max


@dataclass(frozen=True, eq=False)
class StoredReport:
    """What one benchmark wrote; its readers take keys inside of keys.

    All of them raise a `DataError` that names the file and the key if something is missing or of another type.

    Attributes:
        path: of the file.
        name: short name of its folder.
        kind: one of `KINDS`.
        values: everything in the file.
    """

    path: Path
    name: str
    kind: str
    values: Mapping[str, Any]

    def value(self, *keys: str) -> Any:
        """Whatever lies there."""
        found: Any = self.values
        for key in keys:
            if not isinstance(found, Mapping) or key not in found:
                raise DataError(f"{self.path}: this {self.kind} report has no {'.'.join(keys)}: run it again")
            found = found[key]
        return found

    def text(self, *keys: str) -> str:
        """A text."""
        return self._checked(keys, "a text", lambda value: isinstance(value, str))

    def count(self, *keys: str) -> int:
        """A whole number."""
        # nan is none
        return int(self._checked(keys, "a whole number", lambda value: _is_number(value) and value % 1 == 0))

    def mapping(self, *keys: str) -> Mapping[str, Any]:
        """Names and their values."""
        return self._checked(keys, "names with values", lambda value: isinstance(value, Mapping))

    def spread(self, *keys: str) -> Spread | None:
        """A number and how it varies, over runs if there are several; None if it is not defined."""
        found = self._numbers(Spread, *keys)
        if found is None or not (math.isnan(found.std or 0.0) or self.settings.get("runs") == 1):
            return found
        return replace(found, std=None)

    def quantiles(self, *keys: str) -> Quantiles | None:
        """The quantiles of many values; None if they are not defined."""
        return self._numbers(Quantiles, *keys)

    @property
    def settings(self) -> Mapping[str, Any]:
        """What the numbers depend on."""
        return self.mapping("settings")

    @property
    def commits(self) -> tuple[str | None, ...]:
        """The sources that the numbers were made with, at least one; None stands for one that is not known."""
        # A benchmark that cannot be interrupted and resumed has no list of them.
        commits = self.values["commits"] if "commits" in self.values else [self.value("origin", "commit")]
        if not isinstance(commits, list) or not commits or not all(isinstance(each, str | None) for each in commits):
            raise DataError(f"{self.path}: commits must be names of at least one commit, got {commits!r}")
        return tuple(commits)

    def _checked(self, keys: Sequence[str], wanted: str, is_valid: Callable[[Any], bool]) -> Any:
        value = self.value(*keys)
        if not is_valid(value):
            raise DataError(f"{self.path}: {'.'.join(keys)} must be {wanted}, got {value!r}")
        return value

    def _numbers(self, kind: type[NumbersT], *keys: str) -> NumbersT | None:
        """A dataclass of numbers, nan for one that is not defined; None if none of them is."""
        if self.value(*keys) is None:
            return None
        found = {field.name: self.number(*keys, field.name) for field in fields(kind)}
        return None if all(map(math.isnan, found.values())) else kind(**found)

    def number(self, *keys: str) -> float:
        """A number, nan for one that is not defined."""
        value = self._checked(keys, "a number", lambda value: value is None or _is_number(value))
        return math.nan if value is None else float(value)


def find_reports(folders: Sequence[Path]) -> list[StoredReport]:
    """All reports in some folders and in the folders inside of them, each once.

    Raises:
        InputError: no folder given, or one that is missing or holds no report.
        DataError: a report that is broken or not of a benchmark.
    """
    if not folders:
        raise InputError("give at least one folder with reports")
    names: dict[Path, str] = {}
    for folder in folders:
        root = folder.resolve()
        if not root.is_dir():
            raise InputError(f"no such folder: {folder}")
        files = sorted(root.rglob(REPORT_FILE))
        if not files:
            raise InputError(f"{folder}: holds no {REPORT_FILE}, nor do the folders inside of it")
        for file in files:
            names.setdefault(file, str(file.parent.relative_to(root.parent)))
    called = list(names.values())
    return [_read(file, name if called.count(name) == 1 else str(file.parent)) for file, name in names.items()]


def _read(path: Path, name: str) -> StoredReport:
    values = read_json(path)
    kind = values.get("benchmark") if isinstance(values, dict) else None
    if kind not in KINDS:
        said = "does not say what it is of" if kind is None else f"is of an unknown kind {kind!r}"
        raise DataError(f"{path}: {said}: its key 'benchmark' must be one of {', '.join(KINDS)}")
    return StoredReport(path, name, kind, values)
