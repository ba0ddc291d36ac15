"""Several reports beside the published tables, as one page of Markdown; every row says how it was measured."""

import math
from collections import Counter
from collections.abc import Sequence

from icgnet.benchmark.config import EVERY, IN_LABELS
from icgnet.benchmark.published_results import CAPTURES, RATES, SHAPES, TIMES, PublishedTable
from icgnet.benchmark.report_rows import (
    NOTES,
    Pair,
    Row,
    camera_and_noise,
    in_order,
    method_name,
    pair_up,
    pictures,
    rounds,
    rules,
    source,
    table,
)
from icgnet.benchmark.reports import StoredReport
from icgnet.benchmark.tables import NOTHING
from icgnet.errors import InputError

SKIPPED = "nothing found"
SECTIONS = ("clutter", "reconstruction", "segmentation", "latency", "captures")
INTRODUCTION = """# Benchmark

Ours: mean ± population standard deviation [95 % interval]. Rates vary over runs, if there are several, with Wilson's
interval of all attempts (GSR) or all objects (DR); as those of one round are not independent, it is probably too
narrow, above all for DR. Shapes and instances vary over scenes, with a bootstrap over them. Published: as printed.
docs/benchmark.md explains cameras, noise and rules; where they differ, a comparison is not fair."""
SCORES = {
    "instance_miou": "mean IoU",
    "ap50": "AP50",
    "pq": "panoptic quality, any class",
    "class_pq": "panoptic quality, right class",
    "class_accuracy": "class accuracy of matches",
}


def compare(reports: Sequence[StoredReport]) -> str:
    """One page of Markdown with a section for each kind of number that there is a report of.

    Raises:
        InputError: none of the reports has a place on the page.
        DataError: a report lacks something.
    """
    of = {kind: [report for report in reports if report.kind == kind] for kind in SECTIONS}
    if not any(of.values()):
        kinds = ", ".join(sorted({report.kind for report in reports})) or "none"
        raise InputError(f"there must be a report of {', '.join(SECTIONS)}; found: {kinds}")
    clutter = in_order(of["clutter"], rules, method_name, rounds)
    sections = [
        *(_clutter(clutter) if clutter else []),
        *(_failures(clutter) if clutter else []),
        *(_shapes(of["reconstruction"]) if of["reconstruction"] else []),
        *(_instances(of["segmentation"]) if of["segmentation"] else []),
        *(_times(of["latency"]) if of["latency"] else []),
        *(_captures(of["captures"]) if of["captures"] else []),
    ]
    notes = [f"- {mark} {text}" for mark, text in NOTES.items() if any(f" {mark}" in section for section in sections)]
    others = [f"{report.name} ({report.kind})" for report in reports if report.kind not in SECTIONS]
    notes += [f"- Not on this page: {', '.join(others)}."] if others else []
    return "\n\n".join([INTRODUCTION, *sections, "\n".join(notes)]).rstrip() + "\n"


def _clutter(reports: Sequence[StoredReport]) -> list[str]:
    """A table for each view and noise: ours, then what was published for them."""
    headers = ("method", "protocol", "scenes", "measured by", "packed GSR", "packed DR", "pile GSR", "pile DR")
    sections = [
        "## Clutter removal\n\nGSR: successes by attempts, DR: objects grasped away by objects placed, percent."
    ]
    seen = dict.fromkeys((report.value("settings", "view"), report.value("settings", "noise")) for report in reports)
    for view, noise in sorted(seen, key=_published_first):
        own = [each for each in reports if (each.settings["view"], each.settings["noise"]) == (view, noise)]
        rows = [_rates(pair) for pair in pair_up(own, irrelevant=("opening",))]
        if any(report.value("settings", "protocol") == "edge" for report in own):  # none was published for others
            rows += [row for each in RATES if (each.view, each.noise) == (view, noise) for row in _published(each)]
        sections.append(f"### Camera {view}, noise {noise}\n\n{table(headers, rows)}")
    return sections


def _published_first(setting: tuple[str, str]) -> tuple[int, tuple[str, str]]:
    order = list(dict.fromkeys((each.view, each.noise) for each in RATES))
    return (order.index(setting) if setting in order else len(order), setting)


def _rates(pair: Pair) -> Row:
    cells = [_spread(each, 1, name) for each in (pair.packed, pair.pile) for name in ("gsr", "dr")]
    labels = (method_name(pair.first), rules(pair.first), rounds(pair.first))
    return Row(labels, (source(pair.reports), *cells), pair.reports)


def _published(printed: PublishedTable) -> list[Row]:
    return [
        Row(
            (row.method, row.protocol or printed.protocol, printed.scenes),
            (f"{row.measured_by} ({printed.source})", row.packed_gsr, row.packed_dr, row.pile_gsr, row.pile_dr),
        )
        for row in printed.rows
    ]


def _failures(reports: Sequence[StoredReport]) -> list[str]:
    """Causes that occur, the most frequent first."""
    counts = {report: _causes(report) for report in reports}
    totals = sum(counts.values(), Counter())
    causes = sorted((cause for cause in totals if cause != SKIPPED), key=lambda cause: (-totals[cause], cause))
    rows = [
        Row(
            (method_name(report), rules(report), rounds(report), str(report.value("settings", "scene"))),
            (
                str(report.count("attempts")),
                str(sum(counts[report].values()) - counts[report][SKIPPED]),
                *(str(counts[report][cause]) for cause in (*causes, SKIPPED)),
                *(str(report.count(name)) for name in ("touching", "lost")),
            ),
            (report,),
        )
        for report in reports
    ]
    headers = ("method", "protocol", "scenes", "kind", "attempts", "failed", *causes, SKIPPED, "touching", "lost")
    meaning = (
        f"Failed attempts by cause. {SKIPPED}: pictures without a grasp; touching: attempts, failed or not, in which "
        "the open hand touched anything but its target; lost: objects pushed out of the workspace."
    )
    return [f"## Why attempts failed\n\n{meaning}\n\n{table(headers, rows)}"]


def _causes(report: StoredReport) -> Counter[str]:
    return Counter({cause: report.count("failures", cause) for cause in report.mapping("failures")})


def _shapes(reports: Sequence[StoredReport]) -> list[str]:
    headers = ("method", "protocol", "scenes", "measured by", *(f"{k} {n}" for k in ("packed", "pile") for n in _SHAPE))
    rows = []
    for pair in pair_up(in_order(reports, camera_and_noise, method_name, pictures), irrelevant=("threads",)):
        values = [value for each in (pair.packed, pair.pile) for value in _shape_values(each)]
        labels = (method_name(pair.first), camera_and_noise(pair.first), pictures(pair.first))
        rows.append(Row(labels, (source(pair.reports), *values), pair.reports))
    for *labels, packed_iou, packed_chamfer, pile_iou, pile_chamfer, who in SHAPES:
        values = (packed_iou, packed_chamfer, NOTHING, pile_iou, pile_chamfer, NOTHING)
        rows.append(Row(tuple(labels), (who, *values)))
    meaning = (
        "Whole scenes: the union of all predicted shapes against all true ones. Where no shape was predicted, the IoU "
        "is 0; the mean C-L1 leaves these scenes out, and the last column of a kind counts them."
    )
    return [f"## Shapes\n\n{meaning}\n\n{table(headers, rows)}"]


_SHAPE = ("IoU, %", "C-L1, mm", "scenes without a shape")


def _shape_values(report: StoredReport | None) -> tuple[str, ...]:
    if report is None:
        return (NOTHING,) * len(_SHAPE)
    rates = (_spread(report, digits, "scene", name) for name, digits in (("iou", 1), ("chamfer_l1_mm", 2)))
    return (*rates, str(report.count("without_shape")))


def _instances(reports: Sequence[StoredReport]) -> list[str]:
    headers = ("method", "protocol", "scenes", "kind", "measured by", *(f"{name}, %" for name in SCORES.values()))
    rows = [
        Row(
            (method_name(report), camera_and_noise(report), pictures(report), str(report.value("settings", "scene"))),
            (source([report]), *(_spread(report, 1, name) for name in SCORES)),
            (report,),
        )
        for report in in_order(reports, camera_and_noise, method_name, pictures)
    ]
    return [f"## Instances\n\nWe know of no published values on these scenes.\n\n{table(headers, rows)}"]


def _times(reports: Sequence[StoredReport]) -> list[str]:
    stages = list(dict.fromkeys(stage for report in reports for stage in report.mapping("stages_ms")))
    rows = [
        Row(
            (method_name(report), f"input {report.value('settings', 'input')}", _crowd(report), _hardware(report)),
            (source([report]), _parameters(report), _time(report), *(_stage(report, stage) for stage in stages)),
            (report,),
        )
        for report in in_order(reports, method_name, pictures)
    ]
    rows += [
        Row((method, NOTHING, NOTHING, hardware), (who, parameters, milliseconds, *[NOTHING] * len(stages)))
        for method, milliseconds, hardware, who, parameters in TIMES
    ]
    meaning = (
        "In ms. Ours: median (10th to 90th percentile); whole: to ranked grasps, without meshes. Published: as each "
        "source defines it."
    )
    headers = ("method", "input", "scenes", "hardware", "measured by", "parameters", "whole", *stages)
    return [f"## Time\n\n{meaning}\n\n{table(headers, rows)}"]


def _captures(reports: Sequence[StoredReport]) -> list[str]:
    """Overlap with label images beside published values; a row for each subset of each report."""
    names = ("precision", "recall", "f", "boundary_f", "good")
    rows = [
        Row(
            (f"icgnet {str(report.value('settings', 'weights'))[:8]}", f"{report.name}: {group}"),
            (source([report]), *(_spread(report, 1, "groups", group, name) for name in names)),
            (report,),
        )
        for report in sorted(reports, key=lambda each: each.name)
        for group in report.mapping("groups")
        if report.value("groups", group, "f") is not None
        and (group != EVERY or IN_LABELS not in report.mapping("groups"))  # else the same twice
    ]
    rows += [Row((method, "OSD as recorded"), (who, *values)) for method, *values, who in CAPTURES]
    meaning = (
        "Overlap with label images, percent. Ours of OSD are of the version of Alexandrov, in which floor, walls and "
        "far things are cut away. Objects, classes, grasps, support and time: report.json of each."
    )
    headers = ("method", "frames", "measured by", "P", "R", "F", "boundary F", "objects with F >= 0.75")
    return [f"## Real frames\n\n{meaning}\n\n{table(headers, rows)}"]


def _parameters(report: StoredReport) -> str:
    return f"{report.mapping('model')['parameters'] / 1e6:.1f} M"


def _crowd(report: StoredReport) -> str:
    return f"{report.value('settings', 'scene')}, {camera_and_noise(report)}, {pictures(report)}"


def _hardware(report: StoredReport) -> str:
    device, threads = report.value("device"), report.number("threads")
    return f"{report.value('origin', 'processor')}, {device}, {threads:g} {'thread' if threads == 1 else 'threads'}"


def _time(report: StoredReport) -> str:
    low, middle, high = (report.number(name) for name in ("p10_ms", "median_ms", "p90_ms"))
    return f"{middle:.0f} ({low:.0f} to {high:.0f})"


def _stage(report: StoredReport, stage: str) -> str:
    if stage not in report.mapping("stages_ms"):
        return NOTHING
    low, middle, high = (report.number(name, stage) for name in ("stages_p10_ms", "stages_ms", "stages_p90_ms"))
    return NOTHING if math.isnan(middle) else f"{middle:.0f} ({low:.0f} to {high:.0f})"


def _spread(report: StoredReport | None, digits: int, *keys: str) -> str:
    """A measured number of a report, if there is one and it is defined."""
    value = None if report is None else report.spread(*keys)
    if report is None or value is None:
        return NOTHING
    mean, std, low, high = (f"{each:.{digits}f}" for each in (value.mean, value.std, value.low, value.high))
    deviation = "" if report.settings.get("runs") == 1 else f" ± {std}"  # of one run there is none
    return f"{mean}{deviation} [{low}, {high}]"
