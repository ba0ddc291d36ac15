"""Where a number comes from: code, hardware and settings, written beside it."""

import os
import platform
import subprocess
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from icgnet.datagen.files import write_json

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
    return Origin(package, _commit(), _processor(), os.cpu_count() or 1, platform.python_version())


def write_report(out: Path | None, report: Mapping[str, object]) -> None:
    """Writes a report and what it was made with into a folder, if one is given.

    Raises:
        DataError: the system cannot write.
    """
    if out is not None:
        write_json(out / REPORT_FILE, {**report, "origin": asdict(origin())})


def _commit() -> str | None:
    command = ["git", "-C", str(Path(__file__).parent), "describe", "--always", "--dirty", "--abbrev=12", "--exclude=*"]
    try:
        result = subprocess.run(command, capture_output=True, text=True, timeout=10, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return result.stdout.strip() or None


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.machine()
