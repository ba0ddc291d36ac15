"""Where a number comes from: code, hardware and settings, written beside it."""

import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from icgnet.files import write_json

REPORT_FILE = "report.json"


@dataclass(frozen=True)
class Origin:
    """What a measurement was made with.

    Attributes:
        version: of this package.
        commit: of its source, if it runs from a repository; "-dirty" is added when files had changed.
        processor: model of the CPU.
        cores: logical cores of the machine.
        python: version.
    """

    version: str
    commit: str | None
    processor: str
    cores: int
    python: str


def origin() -> Origin:
    """The code and the machine that run now."""
    try:
        package = version("icgnet")
    except PackageNotFoundError:
        package = "unknown"
    return Origin(package, source_commit(), _processor(), os.cpu_count() or 1, platform.python_version())


def write_report(out: Path | None, report: Mapping[str, object]) -> None:
    """Writes a report and what it was made with into a folder, if one is given.

    Raises:
        DataError: the system cannot write.
    """
    if out is not None:
        write_json(out / REPORT_FILE, {**report, "origin": asdict(origin())})


def source_commit(file: Path = Path(__file__)) -> str | None:
    """The commit that holds a file of this package, with "-dirty" if files had changed; None if there is none."""
    try:
        # The environment that the package is installed in may lie in a repository of the user's.
        _git(file.parent, "ls-files", "--error-unmatch", file.name)
        return _git(file.parent, "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*") or None
    except (OSError, subprocess.SubprocessError):
        return None


def _git(folder: Path, *command: str) -> str:
    """What git says in a folder."""
    return subprocess.run(
        ["git", "-C", str(folder), *command], capture_output=True, text=True, timeout=10, check=True
    ).stdout.strip()


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()
