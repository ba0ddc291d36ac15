"""Rows of the comparison: which reports belong side by side, what a row is called, and what the reader must know."""

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any

from icgnet.benchmark.reports import StoredReport
from icgnet.benchmark.tables import Table
from icgnet.inference.grasp_search import BEST_FEW

MANY_ROUNDS = 100  # as published; what was measured on fewer is marked
UNCOMMITTED, FEW, MIXED = "†", "‡", "§"
NOTES: Mapping[str, str] = {
    UNCOMMITTED: "made, at least in part, with source that no commit is known to hold: files had changed, or there was "
    "no repository.",
    FEW: f"fewer than {MANY_ROUNDS} rounds or scenes.",
    MIXED: "packed and pile, or the rounds of one of them, were measured with different source.",
}
"""What the marks of a row mean."""


@dataclass(frozen=True)
class Pair:
    """Reports on packed scenes and on piles that were made with the same settings."""

    packed: StoredReport | None
    pile: StoredReport | None

    @property
    def reports(self) -> tuple[StoredReport, ...]:
        """Those that are there."""
        return tuple(each for each in (self.packed, self.pile) if each is not None)

    @property
    def first(self) -> StoredReport:
        """The one whose settings name the row."""
        return self.reports[0]


@dataclass(frozen=True)
class Row:
    """A row of a table.

    Attributes:
        labels: the first cells, what was measured.
        cells: the other cells.
        reports: where it comes from; none for published rows.
    """

    labels: tuple[str, ...]
    cells: tuple[str, ...]
    reports: tuple[StoredReport, ...] = ()


def table(headers: Sequence[str], rows: Sequence[Row]) -> str:
    """A table in Markdown; rows that would be called the same are told apart by their folders."""
    called = [row.labels for row in rows]
    lines = []
    for row in rows:
        name, *others = row.labels
        if row.reports and called.count(row.labels) > 1:
            name += f", in {' and '.join(each.name for each in row.reports)}"
        name += "".join(f" {mark}" for mark in _marks(row.reports))
        lines.append([name, *others, *row.cells])
    return Table(headers, lines).markdown()


def pair_up(reports: Iterable[StoredReport], irrelevant: Iterable[str]) -> list[Pair]:
    """Reports with the same settings, side by side.

    Args:
        reports: of one kind of benchmark.
        irrelevant: settings that decide nothing.
    """
    ignored = {"scene", *irrelevant}
    groups: dict[str, list[StoredReport]] = {}
    for report in reports:
        groups.setdefault(_key(report.settings, ignored), []).append(report)
    pairs: list[Pair] = []
    for group in groups.values():
        # One of each may come from different commits; with more of them, those of the same commit belong together.
        scenes = [report.value("settings", "scene") for report in group]
        if len(set(scenes)) == len(scenes):
            pairs += _pairs(group)
        else:
            for commits in dict.fromkeys(report.commits for report in group):
                pairs += _pairs([report for report in group if report.commits == commits])
    return pairs


def _pairs(group: Sequence[StoredReport]) -> list[Pair]:
    packed, pile = (
        [report for report in group if report.value("settings", "scene") == scene] for scene in ("packed", "pile")
    )
    return [Pair(*both) for both in zip_longest(packed, pile)]


def _key(settings: Mapping[str, Any], ignored: set[str]) -> str:
    kept = {name: value for name, value in settings.items() if name not in ignored}
    return json.dumps(kept, sort_keys=True)


def _marks(reports: Sequence[StoredReport]) -> list[str]:
    found = []
    commits = {commit for report in reports for commit in report.commits}
    if any(commit is None or commit.endswith("-dirty") for commit in commits):
        found.append(UNCOMMITTED)
    if any(_is_small(report) for report in reports):
        found.append(FEW)
    if len(commits) > 1:
        found.append(MIXED)
    return found


def _is_small(report: StoredReport) -> bool:
    counted = {"clutter": "rounds", "reconstruction": "scenes", "segmentation": "scenes"}
    return report.kind in counted and report.count(counted[report.kind]) < MANY_ROUNDS


def method_name(report: StoredReport) -> str:
    """Planner or network, its weights, and what is unusual about its search."""
    settings = report.settings
    name = str(settings.get("planner", "icgnet"))
    if settings.get("weights"):
        name += f" {str(settings['weights'])[:8]}"
    elif settings.get("preset"):
        name += f", untrained preset {settings['preset']}"
    usual = asdict(BEST_FEW)
    search = report.mapping("settings", "search") if settings.get("search") else {}
    unusual = [f"{key}={value}" for key, value in search.items() if usual.get(key, value) != value]
    if settings.get("level_table") is False:
        unusual.append("depth as measured")
    hand = report.value("settings", "gripper", "name")
    if hand != "franka":
        unusual.append(f"hand {hand}")
    return f"{name} ({', '.join(unusual)})" if unusual else name


def camera_and_noise(report: StoredReport) -> str:
    """Where the camera stood, and what the sensor did."""
    return f"camera {report.value('settings', 'view')}, noise {report.value('settings', 'noise')}"


def rules(report: StoredReport) -> str:
    """What counted as a success in the clutter benchmark, and how it was seen."""
    opening = "full" if report.value("settings", "full_opening") else "as planned"
    return f"{report.value('settings', 'protocol')}, opening {opening}; {camera_and_noise(report)}"


def rounds(report: StoredReport) -> str:
    """The scenes of a clutter report."""
    runs, count, seed = (report.value("settings", name) for name in ("runs", "rounds", "seed"))
    return f"{_objects(report)}, {runs} x {count} rounds, seed {seed}"


def pictures(report: StoredReport) -> str:
    """The scenes of a report on single pictures."""
    count, seed = (report.value("settings", name) for name in ("scenes", "seed"))
    return f"{_objects(report)}, {count} scenes, seed {seed}"


def source(reports: Sequence[StoredReport]) -> str:
    """Who measured: this package, in which states."""
    states = dict.fromkeys(
        f"{each.value('origin', 'version')} ({commit or 'no commit'})" for each in reports for commit in each.commits
    )
    return f"icgnet {', '.join(states)}"


def _objects(report: StoredReport) -> str:
    objects = str(report.value("settings", "objects"))
    return f"{report.value('settings', 'split')} objects of {Path(objects).name or objects}"


def in_order(reports: Iterable[StoredReport], *names: Callable[[StoredReport], str]) -> list[StoredReport]:
    """Reports by what they are called; our network's first."""
    return sorted(
        reports,
        key=lambda each: (each.settings.get("planner", "icgnet") != "icgnet", *(name(each) for name in names)),
    )
