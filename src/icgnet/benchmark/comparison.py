"""Several reports beside the published tables, as one page of Markdown; every row says how it was measured.

The columns of a table are labels, texts of a report that say what was measured, and values, texts of all reports of a
row. Published rows are cells already, in `published.yaml`; what is said about the tables is in `page.yaml`.
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import yaml

from icgnet.benchmark.config import EVERY, IN_LABELS, NOTHING_FOUND, OCCLUSION_GROUPS, OUR_NETWORK
from icgnet.benchmark.published import PUBLISHED
from icgnet.benchmark.reports import StoredReport
from icgnet.benchmark.statistics import causes_told, cell
from icgnet.benchmark.tables import NOTHING, Table
from icgnet.errors import InputError
from icgnet.inference.grasp_search import BEST_FEW
from icgnet.objects.kinds import CUBE_KINDS, WIDE_KINDS

PAGE: Mapping[str, Any] = yaml.safe_load((Path(__file__).parent / "page.yaml").read_text(encoding="utf-8"))
"""Introduction, what stands below the headings, and what the marks of a row mean."""
UNCOMMITTED, FEW, MIXED = PAGE["marks"]
MANY_ROUNDS = 100  # as published; what was measured on fewer is marked

Row = Sequence[StoredReport]  # reports of the same settings: one, or one of packed scenes and one of piles
Label = Callable[[StoredReport], str]
Value = Callable[[Row], str]


def compare(reports: Sequence[StoredReport]) -> str:
    """One page of Markdown with a section for each kind of number that there is a report of.

    Raises:
        InputError: none of the reports has a place on the page.
        DataError: a report lacks something.
    """
    writers = {
        "clutter": (_clutter, _failures),
        "target": (_targets,),
        "reconstruction": (_shapes,),
        "segmentation": (_instances,),
        "latency": (_times,),
        "captures": (_captures,),
        "workcell": (_arms,),
    }
    of = {kind: [report for report in reports if report.kind == kind] for kind in writers}
    if not any(of.values()):
        kinds = ", ".join(sorted({report.kind for report in reports})) or "none"
        raise InputError(f"there must be a report of {', '.join(writers)}; found: {kinds}")
    sections = [write(of[kind]) for kind in writers if of[kind] for write in writers[kind]]
    marks = {mark: text for mark, text in PAGE["marks"].items() if any(f" {mark}" in section for section in sections)}
    notes = [f"- {mark} {text}" for mark, text in marks.items()]
    others = [f"{report.name} ({report.kind})" for report in reports if report.kind not in writers]
    notes += [f"- Not on this page: {', '.join(others)}."] if others else []
    return "\n\n".join([PAGE["introduction"], *sections, "\n".join(notes)]).rstrip() + "\n"


def _section(heading: str, *parts: str) -> str:
    return "\n\n".join([f"## {heading}", PAGE["sections"][heading], *parts])


def _clutter(reports: Sequence[StoredReport]) -> str:
    """A table for each view and noise, those of tables and bins last; published rows have the protocol edge."""
    published = {(each["view"], each["noise"]): each["rows"] for each in PUBLISHED["rates"]}
    order = list(published)
    own: dict[tuple[bool, str, str], list[StoredReport]] = {}
    for report in _in_order(reports, _rules, _method, _rounds):
        view, noise = report.text("settings", "view"), report.text("settings", "noise")
        own.setdefault((_scene(report) in WIDE_KINDS, view, noise), []).append(report)

    def place(key: tuple[bool, str, str]) -> tuple[bool, int, tuple[str, ...]]:
        return key[0], order.index(key[1:]) if key[1:] in order else len(order), key[1:]

    parts = []
    for is_wide, view, noise in sorted(own, key=place):
        group = own[is_wide, view, noise]
        edge = not is_wide and any(report.text("settings", "protocol") == "edge" for report in group)
        rows, rates = _pairs(group, irrelevant=("opening",)), WIDE_RATES if is_wide else RATES
        table = _table(_ROUNDS, _SOURCE | rates, rows, published.get((view, noise), []) if edge else [])
        parts.append(f"### {'Tables and bins, camera' if is_wide else 'Camera'} {view}, noise {noise}\n\n{table}")
    return _section("Clutter removal", *parts)


def _failures(reports: Sequence[StoredReport]) -> str:
    """Causes that occur, the most frequent first."""
    totals = sum((_causes(report) for report in reports), Counter())
    causes = sorted((cause for cause in totals if cause != NOTHING_FOUND), key=lambda cause: (-totals[cause], cause))

    def failed(*some: str) -> Value:
        return lambda row: str(sum(_causes(row[0])[cause] for cause in some))

    values = {"attempts": _count("attempts"), "failed": failed(*causes)}
    values |= {cause: failed(cause) for cause in (*causes, NOTHING_FOUND)}
    values |= {name: _count(name) for name in ("touching", "lost")}
    rows = [[report] for report in _in_order(reports, _rules, _method, _rounds)]
    return _section("Why attempts failed", _table({**_ROUNDS, "kind": _scene}, values, rows))


def _targets(reports: Sequence[StoredReport]) -> str:
    rows = [[report] for report in _in_order(reports, _rules, _method, _pictures, _scene)]
    rates = {name: _number(".1f", "groups", name, "rate") for name in OCCLUSION_GROUPS}
    values = {"targets": _count("groups", "all", "targets"), **rates, "failures": _told_failures}
    return _section(
        "One object among others", _table({**_SCENES, "protocol": _rules}, _SOURCE | values, rows, PUBLISHED["targets"])
    )


def _shapes(reports: Sequence[StoredReport]) -> str:
    rows = _pairs(_in_order(reports, _camera_and_noise, _method, _pictures), irrelevant=("threads",))
    return _section("Shapes", _table(_PICTURES, _SOURCE | SHAPES, rows, PUBLISHED["shapes"]))


def _instances(reports: Sequence[StoredReport]) -> str:
    rows = [[report] for report in _in_order(reports, _camera_and_noise, _method, _pictures)]
    return _section("Instances", _table(_SCENES, _SOURCE | SCORES, rows))


def _times(reports: Sequence[StoredReport]) -> str:
    stages = dict.fromkeys(stage for report in reports for stage in report.mapping("stages_ms"))
    values = {
        "parameters": lambda row: f"{row[0].count('model', 'parameters') / 1e6:.1f} M",
        "whole": _quantiles("whole_ms"),
        **{stage: _quantiles("stages_ms", stage) for stage in stages},
    }
    rows = [[report] for report in _in_order(reports, _method, _pictures)]
    return _section("Time", _table(_TIMED, _SOURCE | values, rows, PUBLISHED["times"]))


def _captures(reports: Sequence[StoredReport]) -> str:
    """A row for each subset of each report, whose numbers take the place of the report's."""
    labels: dict[str, Label] = {"method": _method, "frames": lambda report: report.name}
    rows = [
        [replace(report, name=f"{report.name}: {group}", values={**report.values, **report.mapping("groups", group)})]
        for report in sorted(reports, key=lambda each: each.name)
        for group in report.mapping("groups")
        if report.value("groups", group, "f") is not None
        and (group != EVERY or IN_LABELS not in report.mapping("groups"))  # else the same twice
    ]
    return _section("Real frames", _table(labels, _SOURCE | OVERLAP, rows, PUBLISHED["captures"]))


def _arms(reports: Sequence[StoredReport]) -> str:
    rows = [[report] for report in _in_order(reports, _arm_rules, _method, _arm_rounds, _scene)]
    values = {"picks": _count("attempts"), **PICKS, "failures": lambda row: causes_told(_causes(row[0])) or NOTHING}
    labels = {"method": _method, "protocol": _arm_rules, "scenes": _arm_rounds, "kind": _scene}
    return _section("A whole arm", _table(labels, _SOURCE | values, rows, PUBLISHED["arms"]))


def _table(
    labels: Mapping[str, Label],
    values: Mapping[str, Value],
    rows: Sequence[Row],
    published: Sequence[Sequence[str]] = (),
) -> str:
    """Ours, then the published rows; rows that would be called the same are told apart by their folders."""
    headers = [*labels, *values]
    called = [[label(row[0]) for label in labels.values()] for row in rows]
    lines = []
    for row, (method, *others) in zip(rows, called, strict=True):
        folders = f", in {' and '.join(each.name for each in row)}" if called.count([method, *others]) > 1 else ""
        name = " ".join([method + folders, *_marks(row)])
        lines.append([name, *others, *(value(row) for value in values.values())])
    lines += [[*cells, *[NOTHING] * (len(headers) - len(cells))] for cells in published]
    return Table(headers, lines).markdown()


def _marks(row: Row) -> list[str]:
    commits = {commit for report in row for commit in report.commits}
    counted = {
        "clutter": "rounds",
        "workcell": "rounds",
        **dict.fromkeys(("target", "reconstruction", "segmentation"), "scenes"),
    }
    found = {
        UNCOMMITTED: any(commit is None or commit.endswith("-dirty") for commit in commits),
        FEW: any(each.kind in counted and each.count(counted[each.kind]) < MANY_ROUNDS for each in row),
        MIXED: len(commits) > 1,
    }
    return [mark for mark, is_found in found.items() if is_found]


def _in_order(reports: Sequence[StoredReport], *labels: Label) -> list[StoredReport]:
    """Reports by what they are called; our network's first."""
    return sorted(reports, key=lambda each: (_planner(each) != OUR_NETWORK, *(label(each) for label in labels)))


def _pairs(reports: Sequence[StoredReport], irrelevant: Sequence[str]) -> list[list[StoredReport]]:
    """Reports on packed scenes and on piles side by side, if their settings are the same but for irrelevant ones."""
    groups: dict[str, list[StoredReport]] = {}
    for report in reports:
        kept = {name: value for name, value in report.settings.items() if name not in ("scene", *irrelevant)}
        groups.setdefault(json.dumps(kept, sort_keys=True), []).append(report)
    rows: list[list[StoredReport]] = []
    for group in groups.values():
        # One of each may come from different commits; with more of them, those of the same commit belong together.
        repeated = len({_scene(report) for report in group}) < len(group)
        own: list[list[StoredReport]] = []
        for report in sorted(group, key=_scene):
            alike = [row for row in own if not repeated or row[0].commits == report.commits]
            row = next((row for row in alike if _scene(report) not in map(_scene, row)), None)
            if row is None:
                own.append([report])
            else:
                row.append(report)
        rows += own
    return rows


# Labels: what was measured.


def _planner(report: StoredReport) -> str:
    return str(report.settings.get("planner", OUR_NETWORK))


def _method(report: StoredReport) -> str:
    """Planner or network, its weights, and what is unusual about its search."""
    settings, name = report.settings, _planner(report)
    if settings.get("weights"):
        name += f" {str(settings['weights'])[:8]}"
    usual = asdict(BEST_FEW)
    search = report.mapping("settings", "search") if settings.get("search") else {}
    unusual = [f"{key}={value}" for key, value in search.items() if usual.get(key, value) != value]
    if settings.get("level_table") is False:
        unusual.append("depth as measured")
    if "gripper" in settings and (hand := report.text("settings", "gripper", "name")) != "franka":
        unusual.append(f"hand {hand}")
    return f"{name} ({', '.join(unusual)})" if unusual else name


def _camera_and_noise(report: StoredReport) -> str:
    return f"camera {report.text('settings', 'view')}, noise {report.text('settings', 'noise')}"


def _rules(report: StoredReport) -> str:
    """What counted as a success in clutter or of a target, which has one protocol only, and how it was seen."""
    opening = "full" if report.value("settings", "full_opening") else "as planned"
    protocol = "strict" if report.kind == "target" else report.text("settings", "protocol")
    return f"{protocol}, opening {opening}; {_camera_and_noise(report)}"


def _rounds(report: StoredReport) -> str:
    runs, count, seed = (report.count("settings", name) for name in ("runs", "rounds", "seed"))
    return f"{_objects(report)}, {runs} x {count} rounds, seed {seed}"


def _pictures(report: StoredReport) -> str:
    count, seed = (report.count("settings", name) for name in ("scenes", "seed"))
    return f"{_objects(report)}, {count} scenes, seed {seed}"


def _objects(report: StoredReport) -> str:
    objects = report.text("settings", "objects")
    return f"{report.text('settings', 'split')} objects of {Path(objects).name or objects}"


def _arm_rules(report: StoredReport) -> str:
    """What the arm did, and what it and its camera were told and not told."""
    settings = report.settings
    told = [
        f"{'fetching one object' if settings.get('fetch') else 'clearing'} with {report.text('settings', 'arm')}",
        f"noise {report.text('settings', 'noise')}",
        f"hand-eye error {'on' if report.value('settings', 'hand_eye_error') else 'off'}",
        f"obstacles {report.text('settings', 'obstacles')}",
        f"carried shape {'checked' if report.value('settings', 'attached_check') else 'not checked'}",
    ]
    return ", ".join(told)


def _arm_rounds(report: StoredReport) -> str:
    pool, count, seed = (report.count("settings", name) for name in ("pool", "rounds", "seed"))
    return f"{pool} {_objects(report)}, {count} rounds, seed {seed}"


def _scene(report: StoredReport) -> str:
    return report.text("settings", "scene")


def _hardware(report: StoredReport) -> str:
    device, threads = report.text("device"), report.count("threads")
    return f"{report.text('origin', 'processor')}, {device}, {threads} {'thread' if threads == 1 else 'threads'}"


_ROUNDS: dict[str, Label] = {"method": _method, "protocol": _rules, "scenes": _rounds}
_PICTURES: dict[str, Label] = {"method": _method, "protocol": _camera_and_noise, "scenes": _pictures}
_SCENES: dict[str, Label] = {**_PICTURES, "kind": _scene}
_TIMED: dict[str, Label] = {
    "method": _method,
    "input": lambda report: f"input {report.text('settings', 'input')}",
    "scenes": lambda report: f"{_scene(report)}, {_camera_and_noise(report)}, {_pictures(report)}",
    "hardware": _hardware,
}

# Values: who measured, and the numbers.


def _source(row: Row) -> str:
    """This package, in which states."""
    states = dict.fromkeys(
        f"{each.text('origin', 'version')} ({commit or 'no commit'})" for each in row for commit in each.commits
    )
    return f"icgnet {', '.join(states)}"


def _number(form: str, *keys: str) -> Value:
    """A column of a measured number with its spread."""
    return lambda row: cell(row[0].spread(*keys), form)


def _quantiles(*keys: str) -> Value:
    """A column of times [ms]."""
    return lambda row: cell(row[0].quantiles(*keys), ".0f")


def _count(*keys: str) -> Value:
    """A column of a whole number."""
    return lambda row: str(row[0].count(*keys))


def _seconds(*keys: str) -> Value:
    """A column of times [s]."""

    def told(row: Row) -> str:
        value = row[0].number(*keys)
        return NOTHING if math.isnan(value) else f"{value:.2f}"

    return told


def _beside(columns: Mapping[str, Value], scenes: Sequence[str] = CUBE_KINDS) -> dict[str, Value]:
    """The columns of packed scenes, then those of piles, or of others; a row may lack a report of one of them."""

    def of_scene(scene: str, value: Value) -> Value:
        return lambda row: next((value([report]) for report in row if _scene(report) == scene), NOTHING)

    return {f"{scene} {name}": of_scene(scene, value) for scene in scenes for name, value in columns.items()}


def _causes(report: StoredReport, *keys: str) -> Counter[str]:
    causes = report.mapping(*keys, "failures")
    return Counter({cause: report.count(*keys, "failures", cause) for cause in causes})


def _told_failures(row: Row) -> str:
    return causes_told(_causes(row[0], "groups", "all")) or NOTHING


_SOURCE: dict[str, Value] = {"measured by": _source}
RATES = _beside({"GSR": _number(".1f", "gsr"), "DR": _number(".1f", "dr")})
WIDE_RATES = _beside(
    {"GSR": _number(".1f", "gsr"), "DR": _number(".1f", "dr"), "DR of holdable": _number(".1f", "dr_holdable")},
    WIDE_KINDS,
)
SHAPES = _beside(
    {
        "IoU, %": _number(".1f", "scene", "iou"),
        "C-L1, mm": _number(".2f", "scene", "chamfer_l1_mm"),
        "scenes without a shape": _count("without_shape"),
    }
)
SCORES = {
    "mean IoU, %": _number(".1f", "scores", "instance_miou"),
    "AP50, %": _number(".1f", "scores", "ap50"),
    "panoptic quality, any class, %": _number(".1f", "scores", "pq"),
    "panoptic quality, right class, %": _number(".1f", "scores", "class_pq"),
    "class accuracy of matches, %": _number(".1f", "scores", "class_accuracy"),
}
PICKS = {
    "GSR": _number(".1f", "gsr"),
    "DR": _number(".1f", "dr"),
    "carried objects that hit something, %": _number(".1f", "hits"),
    "plan, median, s": _seconds("plan_median"),
    "plan, 95 %, s": _seconds("plan_p95"),
    "motion of a pick, s": _seconds("cycle"),
}
OVERLAP = {
    "P": _number(".1f", "precision"),
    "R": _number(".1f", "recall"),
    "F": _number(".1f", "f"),
    "boundary F": _number(".1f", "boundary_f"),
    "objects with F >= 0.75": _number(".1f", "good"),
}
