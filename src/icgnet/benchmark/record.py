"""Where a number comes from: code, hardware and settings, written beside it."""

import json
import os
import platform
import subprocess
from dataclasses import asdict
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from icgnet.errors import DataError
from icgnet.files import write_json
from icgnet.grasping.gripper import load_gripper
from icgnet.machine import processor
from icgnet.network.weights_header import DEFAULT_WEIGHTS, stored_checksum

REPORT_FILE = "report.json"


def origin() -> dict[str, Any]:
    """The version of this package, the commit of its source, and the machine that runs it."""
    try:
        package = version("icgnet")
    except PackageNotFoundError:
        package = "unknown"
    machine = {"processor": processor(), "cores": os.cpu_count() or 1, "python": platform.python_version()}
    return {"version": package, "commit": source_commit(), **machine}


def write_report(out: Path | None, kind: str, config: Any, numbers: Any) -> None:
    """Writes numbers, what decided them and what they were made with into a folder, if one is given.

    Args:
        out: the folder.
        kind: what was measured.
        config: the dataclass that decided the numbers.
        numbers: a dataclass; with a method `report`, what that gives.

    Raises:
        DataError: the system cannot write, or weights or gripper cannot be read.
    """
    if out is not None:
        values = numbers.report() if hasattr(numbers, "report") else asdict(numbers)
        report = {"benchmark": kind, **values, "settings": settings(config)}
        write_json(out / REPORT_FILE, {**report, "origin": origin()})


def read_json(path: Path) -> Any:
    """What a file of a benchmark holds.

    Raises:
        DataError: it cannot be read.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (ValueError, OSError, RecursionError) as error:
        raise DataError(f"{path}: cannot be read: {error}") from error


def settings(config: Any) -> dict[str, Any]:
    """What decides numbers, as plain values: the hand with its measures, weights by their checksum.

    Args:
        config: a dataclass; one in which not everything decides has a method `decisive`.

    Raises:
        DataError: the weights or the gripper cannot be read.
    """
    values = _plain(config.decisive() if hasattr(config, "decisive") else asdict(config))
    if "gripper" in values:
        values["gripper"] = load_gripper(config.gripper).to_dict()
    if "weights" in values:
        values["weights"] = stored_checksum(config.weights or DEFAULT_WEIGHTS)
    return values


def _plain(value: Any) -> Any:
    """The same with texts in place of paths, and lists in place of tuples."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(each) for each in value]
    return str(value) if isinstance(value, Path) else value


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
