"""Fixtures that more than one folder of tests needs, and how the tests run and end."""

import os
from collections import Counter
from pathlib import Path

# Before anything loads a library that reads it: the workers fill the cores, their threads would wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import pytest
from hypothesis import settings

try:
    # Types are checked in tests, and beartype takes a class whose name is written in its own way for no class.
    from cyclonedds.idl import IdlStruct

    type(IdlStruct).__repr__ = type.__repr__
except ModuleNotFoundError:  # icgnet[ros2] is not installed
    pass

# Times vary with what else the machine does, so no example fails for being slow; and every run tries the same ones.
settings.register_profile("icgnet", deadline=None, max_examples=40, derandomize=True)
settings.load_profile("icgnet")

MOST_WORKERS = 8


def pytest_xdist_auto_num_workers() -> int:
    """A worker for every core that this process may use (`-n auto`)."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return min(cores, MOST_WORKERS)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Says what was not tested, and why."""
    reasons = Counter(str(report.longrepr[2]) for report in terminalreporter.stats.get("skipped", []))
    if reasons:
        terminalreporter.section("skipped")
    for reason, count in sorted(reasons.items()):
        terminalreporter.line(f"{count:4d}  {reason.removeprefix('Skipped: ')}")


@pytest.fixture(scope="session")
def vgn_objects() -> Path:
    """Folder of the VGN object set; tests that need it are skipped where it is absent."""
    folder = os.environ.get("ICGNET_OBJECTS")
    if not folder or not (Path(folder) / "packed" / "train").is_dir():
        pytest.skip("needs the VGN object set: set ICGNET_OBJECTS to the folder with packed/ and pile/")
    return Path(folder)
