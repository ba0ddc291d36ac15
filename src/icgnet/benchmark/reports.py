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
    "simulation",
    "loader",
    "label-ceiling",
    "hands",
    "training-speed",
)
"""What a report can be of."""
NumbersT = TypeVar("NumbersT", Spread, Quantiles)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and not abs(value) > sys.float_info.max


def _are_commits(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(each, str | None) for each in value)


_CHECKS: Mapping[str, Callable[[Any], bool]] = {
    "a text": lambda value: isinstance(value, str),
    "a number": lambda value: value is None or _is_number(value),
    "a whole number": lambda value: _is_number(value) and value % 1 == 0,  # nan neither
    "names with values": lambda value: isinstance(value, Mapping),
    "names of at least one commit": _are_commits,
}


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
        return self._checked("a text", *keys)

    def count(self, *keys: str) -> int:
        """A whole number."""
        return int(self._checked("a whole number", *keys))

    def mapping(self, *keys: str) -> Mapping[str, Any]:
        """Names and their values."""
        return self._checked("names with values", *keys)

    def spread(self, *keys: str) -> Spread | None:
        """A number and how it varies, over runs if there are several; None if it is not defined."""
        found = self._numbers(Spread, *keys)
        return replace(found, std=None) if found is not None and self.settings.get("runs") == 1 else found

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
        if "commits" in self.values:
            return tuple(self._checked("names of at least one commit", "commits"))
        return (self.value("origin", "commit"),)

    def _checked(self, wanted: str, *keys: str) -> Any:
        value = self.value(*keys)
        if not _CHECKS[wanted](value):
            raise DataError(f"{self.path}: {'.'.join(keys)} must be {wanted}, got {value!r}")
        return value

    def _numbers(self, kind: type[NumbersT], *keys: str) -> NumbersT | None:
        """A dataclass of numbers, nan for one that is not defined; None if none of them is."""
        if self.value(*keys) is None:
            return None
        found = {field.name: self._checked("a number", *keys, field.name) for field in fields(kind)}
        numbers = {name: math.nan if number is None else float(number) for name, number in found.items()}
        return None if all(map(math.isnan, numbers.values())) else kind(**numbers)


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
