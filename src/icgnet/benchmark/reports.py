"""The reports that earlier benchmarks wrote, read back."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from icgnet.benchmark.record import REPORT_FILE
from icgnet.benchmark.statistics import Spread
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
    "training-speed",
)
"""What a report can be of."""


@dataclass(frozen=True, eq=False)
class StoredReport:
    """What one benchmark wrote.

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
        """What lies under keys inside of keys.

        Raises:
            DataError: a key is missing.
        """
        found: Any = self.values
        for key in keys:
            if not isinstance(found, Mapping) or key not in found:
                raise DataError(f"{self.path}: this {self.kind} report has no {'.'.join(keys)}: run it again")
            found = found[key]
        return found

    def number(self, *keys: str) -> float:
        """A number under keys inside of keys; nan for one that is not defined.

        Raises:
            DataError: a key is missing, or something else lies there.
        """
        value = self.value(*keys)
        if isinstance(value, bool) or not isinstance(value, int | float | None):
            raise DataError(f"{self.path}: {'.'.join(keys)} must be a number, got {value!r}")
        return math.nan if value is None else float(value)

    def count(self, *keys: str) -> int:
        """A whole number under keys inside of keys.

        Raises:
            DataError: a key is missing, or something else lies there.
        """
        value = self.number(*keys)
        if value != value // 1:  # nan neither
            raise DataError(f"{self.path}: {'.'.join(keys)} must be a whole number, got {self.value(*keys)!r}")
        return int(value)

    def mapping(self, *keys: str) -> Mapping[str, Any]:
        """Names and their values under keys inside of keys.

        Raises:
            DataError: a key is missing, or something else lies there.
        """
        value = self.value(*keys)
        if not isinstance(value, Mapping):
            raise DataError(f"{self.path}: {'.'.join(keys)} must be names with values, got {value!r}")
        return value

    def spread(self, *keys: str) -> Spread | None:
        """A measured number with its spread; None for one that is not defined.

        Raises:
            DataError: a key is missing, or something else lies there.
        """
        if self.value(*keys) is None:
            return None
        spread = Spread(*(self.number(*keys, part) for part in ("mean", "std", "low", "high")))
        return None if math.isnan(spread.mean) else spread

    @property
    def settings(self) -> Mapping[str, Any]:
        """What the numbers depend on."""
        return self.mapping("settings")

    @property
    def commits(self) -> tuple[str | None, ...]:
        """The sources that the numbers were made with, at least one; None stands for one that is not known.

        Raises:
            DataError: something else lies there.
        """
        # A benchmark that cannot be interrupted and resumed has no list of them.
        commits = self.values["commits"] if "commits" in self.values else [self.value("origin", "commit")]
        if not isinstance(commits, list) or not commits or not all(isinstance(each, str | None) for each in commits):
            raise DataError(f"{self.path}: commits must be names of at least one commit, got {commits!r}")
        return tuple(commits)


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
    return [_read(file, _short(file, names)) for file in names]


def _short(file: Path, names: Mapping[Path, str]) -> str:
    """The name of a report's folder, in full where the short one means several."""
    return names[file] if list(names.values()).count(names[file]) == 1 else str(file.parent)


def _read(path: Path, name: str) -> StoredReport:
    """One report.

    Raises:
        DataError: it is broken or not of a benchmark.
    """
    try:
        values = json.loads(path.read_text())
    except (ValueError, OSError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error
    kind = values.get("benchmark") if isinstance(values, dict) else None
    if kind not in KINDS:
        said = "does not say what it is of" if kind is None else f"is of an unknown kind {kind!r}"
        raise DataError(f"{path}: {said}: its key 'benchmark' must be one of {', '.join(KINDS)}")
    return StoredReport(path, name, kind, values)
