"""Several reports beside the published tables, as one page of Markdown; every row says how it was measured.

The cells of our rows come from the columns that each section lists: the labels say what was measured and are texts of
a report, the values are texts of all reports of a row. Published rows are cells already, in `published.yaml`.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path

from icgnet.benchmark.config import EVERY, IN_LABELS, OUR_NETWORK
from icgnet.benchmark.published import PUBLISHED
from icgnet.benchmark.reports import StoredReport
from icgnet.benchmark.statistics import cell
from icgnet.benchmark.tables import NOTHING, Table
from icgnet.errors import InputError
from icgnet.inference.grasp_search import BEST_FEW

Row = Sequence[StoredReport]  # reports of the same settings: one, or one of packed scenes and one of piles
Label = Callable[[StoredReport], str]
Value = Callable[[Row], str]

MANY_ROUNDS = 100  # as published; what was measured on fewer is marked
UNCOMMITTED, FEW, MIXED = "†", "‡", "§"
NOTES: Mapping[str, str] = {
    UNCOMMITTED: "made, at least in part, with source that no commit is known to hold: files had changed, or there was "
    "no repository.",
    FEW: f"fewer than {MANY_ROUNDS} rounds or scenes.",
    MIXED: "packed and pile, or the rounds of one of them, were measured with different source.",
}
"""What the marks of a row mean."""
SKIPPED = "nothing found"
SCENES = ("packed", "pile")
SCORES = {
    "mean IoU": "instance_miou",
    "AP50": "ap50",
    "panoptic quality, any class": "pq",
    "panoptic quality, right class": "class_pq",
    "class accuracy of matches": "class_accuracy",
}
OVERLAP = {
    "P": "precision",
    "R": "recall",
    "F": "f",
    "boundary F": "boundary_f",
    "objects with F >= 0.75": "good",
}
INTRODUCTION = """# Benchmark

Ours: mean ± population standard deviation [95 % interval]. Rates vary over runs, if there are several, with Wilson's
interval of all attempts (GSR) or all objects (DR); as those of one round are not independent, it is probably too
narrow, above all for DR. Shapes and instances vary over scenes, with a bootstrap over them. Published: as printed.
docs/benchmark.md explains cameras, noise and rules; where they differ, a comparison is not fair."""


def compare(reports: Sequence[StoredReport]) -> str:
    """One page of Markdown with a section for each kind of number that there is a report of.

    Raises:
        InputError: none of the reports has a place on the page.
        DataError: a report lacks something.
    """
    writers = {
        "clutter": (_clutter, _failures),
        "reconstruction": (_shapes,),
        "segmentation": (_instances,),
        "latency": (_times,),
        "captures": (_captures,),
    }
    of = {kind: [report for report in reports if report.kind == kind] for kind in writers}
    if not any(of.values()):
        kinds = ", ".join(sorted({report.kind for report in reports})) or "none"
        raise InputError(f"there must be a report of {', '.join(writers)}; found: {kinds}")
    sections = [write(of[kind]) for kind in writers if of[kind] for write in writers[kind]]
    notes = [f"- {mark} {text}" for mark, text in NOTES.items() if any(f" {mark}" in section for section in sections)]
    others = [f"{report.name} ({report.kind})" for report in reports if report.kind not in writers]
    notes += [f"- Not on this page: {', '.join(others)}."] if others else []
    return "\n\n".join([INTRODUCTION, *sections, "\n".join(notes)]).rstrip() + "\n"


def _clutter(reports: Sequence[StoredReport]) -> str:
    """A table for each view and noise: ours, then what was published for them, all with the protocol edge."""
    published = {(each["view"], each["noise"]): each["rows"] for each in PUBLISHED["rates"]}
    order = list(published)
    own: dict[tuple[str, str], list[StoredReport]] = {}
    for report in _in_order(reports, _rules, _method, _rounds):
        own.setdefault((report.text("settings", "view"), report.text("settings", "noise")), []).append(report)
    parts = ["## Clutter removal\n\nGSR: successes by attempts, DR: objects grasped away by objects placed, percent."]
    rates = {
        f"{scene} {name.upper()}": _in_scene(scene, _number(".1f", name)) for scene in SCENES for name in ("gsr", "dr")
    }
    for setting in sorted(own, key=lambda each: (order.index(each) if each in order else len(order), each)):
        edge = any(report.text("settings", "protocol") == "edge" for report in own[setting])
        rows = _pairs(own[setting], irrelevant=("opening",))
        table = _table(_ROUNDS, _SOURCE | rates, rows, published.get(setting, []) if edge else [])
        parts.append(f"### Camera {setting[0]}, noise {setting[1]}\n\n{table}")
    return "\n\n".join(parts)


def _failures(reports: Sequence[StoredReport]) -> str:
    """Causes that occur, the most frequent first."""
    totals = sum((_causes(report) for report in reports), Counter())
    causes = sorted((cause for cause in totals if cause != SKIPPED), key=lambda cause: (-totals[cause], cause))

    def failed(*some: str) -> Value:
        return lambda row: str(sum(_causes(row[0])[cause] for cause in some))

    values = {"attempts": _count("attempts"), "failed": failed(*causes)}
    values |= {cause: failed(cause) for cause in (*causes, SKIPPED)}
    values |= {name: _count(name) for name in ("touching", "lost")}
    meaning = (
        f"Failed attempts by cause. {SKIPPED}: pictures without a grasp; touching: attempts, failed or not, in which "
        "the open hand touched anything but its target; lost: objects pushed out of the workspace."
    )
    rows = [[report] for report in _in_order(reports, _rules, _method, _rounds)]
    return f"## Why attempts failed\n\n{meaning}\n\n{_table({**_ROUNDS, 'kind': _scene}, values, rows)}"


def _shapes(reports: Sequence[StoredReport]) -> str:
    columns = {
        "IoU, %": _number(".1f", "scene", "iou"),
        "C-L1, mm": _number(".2f", "scene", "chamfer_l1_mm"),
        "scenes without a shape": _count("without_shape"),
    }
    values = {f"{scene} {name}": _in_scene(scene, value) for scene in SCENES for name, value in columns.items()}
    meaning = (
        "Whole scenes: the union of all predicted shapes against all true ones. Where no shape was predicted, the IoU "
        "is 0; the mean C-L1 leaves these scenes out, and the last column of a kind counts them."
    )
    rows = _pairs(_in_order(reports, _camera_and_noise, _method, _pictures), irrelevant=("threads",))
    return f"## Shapes\n\n{meaning}\n\n{_table(_PICTURES, _SOURCE | values, rows, PUBLISHED['shapes'])}"


def _instances(reports: Sequence[StoredReport]) -> str:
    values = {f"{title}, %": _number(".1f", "scores", name) for title, name in SCORES.items()}
    rows = [[report] for report in _in_order(reports, _camera_and_noise, _method, _pictures)]
    meaning = "We know of no published values on these scenes."
    return f"## Instances\n\n{meaning}\n\n{_table({**_PICTURES, 'kind': _scene}, _SOURCE | values, rows)}"


def _times(reports: Sequence[StoredReport]) -> str:
    labels: dict[str, Label] = {
        "method": _method,
        "input": lambda report: f"input {report.text('settings', 'input')}",
        "scenes": lambda report: f"{_scene(report)}, {_camera_and_noise(report)}, {_pictures(report)}",
        "hardware": _hardware,
    }

    def time(*keys: str) -> Value:
        return lambda row: cell(row[0].quantiles(*keys), ".0f")

    stages = dict.fromkeys(stage for report in reports for stage in report.mapping("stages_ms"))
    values = {
        "parameters": lambda row: f"{row[0].count('model', 'parameters') / 1e6:.1f} M",
        "whole": time("whole_ms"),
        **{stage: time("stages_ms", stage) for stage in stages},
    }
    meaning = (
        "In ms. Ours: median (10th to 90th percentile); whole: to ranked grasps, without meshes. Published: as each "
        "source defines it."
    )
    rows = [[report] for report in _in_order(reports, _method, _pictures)]
    return f"## Time\n\n{meaning}\n\n{_table(labels, _SOURCE | values, rows, PUBLISHED['times'])}"


def _captures(reports: Sequence[StoredReport]) -> str:
    """Overlap with label images beside published values; a row for each subset of each report."""
    labels: dict[str, Label] = {
        "method": lambda report: f"icgnet {report.text('settings', 'weights')[:8]}",
        "frames": lambda report: report.name,
    }
    values = {title: _number(".1f", name) for title, name in OVERLAP.items()}
    rows = [
        [replace(report, name=f"{report.name}: {group}", values={**report.values, **report.mapping("groups", group)})]
        for report in sorted(reports, key=lambda each: each.name)
        for group in report.mapping("groups")
        if report.value("groups", group, "f") is not None
        and (group != EVERY or IN_LABELS not in report.mapping("groups"))  # else the same twice
    ]
    meaning = (
        "Overlap with label images, percent. Ours of OSD are of the version of Alexandrov, in which floor, walls and "
        "far things are cut away. Objects, classes, grasps, support and time: report.json of each."
    )
    return f"## Real frames\n\n{meaning}\n\n{_table(labels, _SOURCE | values, rows, PUBLISHED['captures'])}"


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
    counted = {"clutter": "rounds", "reconstruction": "scenes", "segmentation": "scenes"}
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
        pairs: dict[tuple[object, int], list[StoredReport]] = {}
        earlier: Counter[object] = Counter()
        for report in sorted(group, key=_scene):
            commits = report.commits if repeated else None
            alike = (commits, _scene(report))
            pairs.setdefault((commits, earlier[alike]), []).append(report)
            earlier[alike] += 1
        rows += pairs.values()
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
    hand = report.text("settings", "gripper", "name")
    if hand != "franka":
        unusual.append(f"hand {hand}")
    return f"{name} ({', '.join(unusual)})" if unusual else name


def _camera_and_noise(report: StoredReport) -> str:
    return f"camera {report.text('settings', 'view')}, noise {report.text('settings', 'noise')}"


def _rules(report: StoredReport) -> str:
    """What counted as a success in the clutter benchmark, and how it was seen."""
    opening = "full" if report.value("settings", "full_opening") else "as planned"
    return f"{report.text('settings', 'protocol')}, opening {opening}; {_camera_and_noise(report)}"


def _rounds(report: StoredReport) -> str:
    runs, count, seed = (report.count("settings", name) for name in ("runs", "rounds", "seed"))
    return f"{_objects(report)}, {runs} x {count} rounds, seed {seed}"


def _pictures(report: StoredReport) -> str:
    count, seed = (report.count("settings", name) for name in ("scenes", "seed"))
    return f"{_objects(report)}, {count} scenes, seed {seed}"


def _objects(report: StoredReport) -> str:
    objects = report.text("settings", "objects")
    return f"{report.text('settings', 'split')} objects of {Path(objects).name or objects}"


def _scene(report: StoredReport) -> str:
    return report.text("settings", "scene")


def _hardware(report: StoredReport) -> str:
    device, threads = report.text("device"), report.count("threads")
    return f"{report.text('origin', 'processor')}, {device}, {threads} {'thread' if threads == 1 else 'threads'}"


_ROUNDS: dict[str, Label] = {"method": _method, "protocol": _rules, "scenes": _rounds}
_PICTURES: dict[str, Label] = {"method": _method, "protocol": _camera_and_noise, "scenes": _pictures}

# Values: who measured, and the numbers.


def _source(row: Row) -> str:
    """This package, in which states."""
    states = dict.fromkeys(
        f"{each.text('origin', 'version')} ({commit or 'no commit'})" for each in row for commit in each.commits
    )
    return f"icgnet {', '.join(states)}"


_SOURCE: dict[str, Value] = {"measured by": _source}


def _in_scene(scene: str, value: Value) -> Value:
    """A column of one kind of scene, of which a row may lack a report."""

    def of_scene(row: Row) -> str:
        reports = [report for report in row if _scene(report) == scene]
        return value(reports) if reports else NOTHING

    return of_scene


def _number(form: str, *keys: str) -> Value:
    """A column of a measured number with its spread."""
    return lambda row: cell(row[0].spread(*keys), form)


def _count(*keys: str) -> Value:
    """A column of a whole number."""
    return lambda row: str(row[0].count(*keys))


def _causes(report: StoredReport) -> Counter[str]:
    return Counter({cause: report.count("failures", cause) for cause in report.mapping("failures")})
