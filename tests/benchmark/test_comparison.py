"""Reports of our benchmarks beside the published tables."""

import json
import math
import re
from pathlib import Path
from typing import get_args

import pytest

from icgnet.benchmark.comparison import FEW, MIXED, PUBLISHED, UNCOMMITTED, compare
from icgnet.benchmark.observation import NoiseName, ViewName
from icgnet.benchmark.reports import find_reports
from icgnet.errors import DataError, InputError

WEIGHTS = "0123456789abcdef" * 4
DOCS = Path(__file__).parents[2] / "docs"
HAND = {"gripper": {"name": "franka"}}
SEARCH = {"most": 5, "resample": True}


def measured(mean: float, std: float = 1.0) -> dict[str, float]:
    return {"mean": mean, "std": std, "low": mean - 2, "high": mean + 2}


def origin(commit: str | None = "aaa") -> dict[str, object]:
    return {"version": "0.1.0", "commit": commit, "processor": "Slow CPU", "cores": 2, "python": "3.11"}


def clutter(gsr: float = 90.0, commit: str | None = "aaa", played: int = 400, **settings: object) -> dict[str, object]:
    return {
        "benchmark": "clutter",
        "gsr": measured(gsr),
        "dr": measured(gsr - 10),
        "attempts": 500,
        "rounds": played,
        "failures": {"missed": 30, "too wide": 20, "nothing found": 7},
        "touching": 11,
        "lost": 4,
        "settings": {
            **{
                "planner": "icgnet",
                "weights": WEIGHTS,
                "search": SEARCH,
                "scene": "packed",
                "objects": "data/vgn",
                **HAND,
            },
            **{"split": "test", "view": "random", "noise": "gaussian", "protocol": "edge", "full_opening": True},
            **{"runs": 4, "rounds": 100, "seed": 1, **settings},
        },
        "origin": origin(commit),
    }


def on_pictures(benchmark: str, values: dict[str, object], **settings: object) -> dict[str, object]:
    common = {
        "objects": "procedural",
        "scene": "packed",
        **HAND,
        "split": "test",
        "view": "random",
        "noise": "gaussian",
    }
    return {
        "benchmark": benchmark,
        **values,
        "settings": {**common, "scenes": 100, "seed": 1, "weights": WEIGHTS, "threads": 1, **settings},
        "origin": origin(),
    }


def shapes(iou: float | None, chamfer: float | None, **settings: object) -> dict[str, object]:
    numbers = {"iou": iou, "chamfer_l1_mm": chamfer}
    scene = {name: None if value is None else measured(value) for name, value in numbers.items()}
    counts = {"scenes": 100, "without_shape": 0 if chamfer is not None else 100}
    return on_pictures("reconstruction", {"scene": scene, **counts}, **settings)


def latency(**values: object) -> dict[str, object]:
    whole = {"mean": None, "median": 300.0, "p10": 250.0, "p90": 400.0}
    stages = {name: dict.fromkeys(whole, time) for name, time in {"encode": 200.0, "collision": 90.0}.items()}
    times = {"whole_ms": whole, "stages_ms": stages, "device": "cpu", "threads": 1, "model": {"parameters": 3335958}}
    return on_pictures("latency", times | values, input="cloud")


def wide(scene: str, holdable: float, **settings: object) -> dict[str, object]:
    """Clutter removal on a table or in a bin."""
    return clutter(scene=scene, noise="stereo", protocol="strict", **settings) | {"dr_holdable": measured(holdable)}


def target(scene: str = "bin", scenes: int = 100) -> dict[str, object]:
    groups = {
        name: {"targets": count, "rate": None if rate is None else measured(rate) | {"std": None}, "failures": causes}
        for name, count, rate, causes in (
            ("0 to 0.5", 80, 60.0, {"missed": 32}),
            ("0.5 to 0.9", 0, None, {}),
            ("all", 80, 60.0, {"nothing found": 2, "missed": 30}),
        )
    }
    settings = {"scene": scene, "scenes": scenes, "planner": "icgnet", "full_opening": False}
    return on_pictures("target", {"groups": groups, "scenes": scenes}, **settings)


@pytest.fixture
def page(tmp_path):
    """Writes reports into folders named a, b, ... and gives the page that comes of them."""

    def make(*reports: dict[str, object]) -> str:
        for name, report in zip("abcdefgh", reports, strict=False):
            (tmp_path / name).mkdir()
            (tmp_path / name / "report.json").write_text(json.dumps(report))
        return compare(find_reports([tmp_path]))

    return make


def rows(text: str, start: str) -> list[list[str]]:
    """The cells of all rows that begin so."""
    lines = [line for line in text.splitlines() if line.startswith(f"| {start}")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def section(text: str, title: str) -> str:
    """The part of a page under a heading, to the next one."""
    return text.split(f"# {title}\n")[1].split("\n#")[0]


def test_packed_and_pile_of_the_same_settings_share_a_row(page):
    text = page(clutter(90.0), clutter(80.0, scene="pile"))
    (row,) = rows(section(text, "Camera random, noise gaussian"), "icgnet")
    assert row[0] == "icgnet 01234567"
    assert row[1] == "edge, opening full; camera random, noise gaussian"
    assert row[2] == "test objects of vgn, 4 x 100 rounds, seed 1"
    assert row[3] == "icgnet 0.1.0 (aaa)"
    assert row[4:] == [
        *("90.0 ± 1.0 [88.0, 92.0]", "80.0 ± 1.0 [78.0, 82.0]", "80.0 ± 1.0 [78.0, 82.0]", "70.0 ± 1.0 [68.0, 72.0]")
    ]


@pytest.mark.parametrize(
    "change",
    [
        {"protocol": "strict"},
        {"full_opening": False},
        {"objects": "procedural"},
        {"split": "val"},
        {"seed": 2},
        {"runs": 1},
        {"rounds": 50},
        {"weights": "f" * 64},
        {"search": {**SEARCH, "resample": False}},
        {"planner": "oracle"},
        {"gripper": {"name": "wide"}},
    ],
    ids=lambda change: next(iter(change)),
)
def test_reports_that_cannot_be_compared_get_rows_of_their_own(page, change):
    text = section(page(clutter(90.0), clutter(80.0, scene="pile", **change)), "Camera random, noise gaussian")
    packed, pile = sorted(rows(text, "icgnet") + rows(text, "oracle"), key=lambda row: row[4] == "-")
    assert packed[:3] != pile[:3]
    assert packed[6:] == ["-", "-"]
    assert pile[4:6] == ["-", "-"]


def test_whether_the_usual_opening_was_given_decides_nothing(page):
    text = page(clutter(opening=None), clutter(scene="pile", opening="full"))
    assert len(rows(section(text, "Camera random, noise gaussian"), "icgnet")) == 1


def test_two_measurements_of_the_same_are_told_apart_by_their_folders(page):
    text = page(clutter(90.0), clutter(70.0, commit="bbb"), clutter(80.0, commit="bbb", scene="pile"))
    first, second = rows(section(text, "Camera random, noise gaussian"), "icgnet")
    assert [len(row[0].split(", in ")) for row in (first, second)] == [2, 2]
    assert first[0].endswith("/a")
    assert first[6] == "-"
    assert second[4].startswith("70.0")  # with the pile of the same commit
    assert second[6].startswith("80.0")


def test_a_pile_stands_beside_packed_scenes_of_another_commit_if_there_is_one_of_each(page):
    text = page(clutter(80.0, scene="pile", commit="bbb"), clutter(90.0), clutter(70.0, scene="pile", seed=2))
    first, second = rows(section(text, "Camera random, noise gaussian"), "icgnet")
    assert first[3] == "icgnet 0.1.0 (aaa), 0.1.0 (bbb)"  # packed first
    assert [cell[:4] for cell in (first[4], first[6], second[6])] == ["90.0", "80.0", "70.0"]


def test_published_rows_stand_in_the_table_of_their_view_and_noise_only(page):
    text = page(clutter(), clutter(view="side", noise="dex"), clutter(view="top"), clutter(noise="none"))
    (usual,) = rows(section(text, "Camera random, noise gaussian"), "ICG-Net ")
    assert usual[3].startswith("its authors")
    assert usual[4:] == ["97.7 ± 0.9", "97.5 ± 0.3", "92.0 ± 2.6", "94.1 ± 1.4"]
    (noisy,) = rows(section(text, "Camera side, noise dex"), "ICG-Net ")
    assert noisy[4] == "60.3 ± 4.1"
    assert rows(section(text, "Camera top, noise gaussian"), "ICG-Net, seen points only")[0][5] == "85"
    assert [row[0] for row in rows(section(text, "Camera random, noise none"), "")][2:] == ["icgnet 01234567"]
    assert section(text, "Camera random, noise gaussian").splitlines()[3].startswith("| icgnet")  # ours first


def test_published_rates_are_of_views_and_noises_that_we_have_once():
    settings = [(table["view"], table["noise"]) for table in PUBLISHED["rates"]]
    assert len(set(settings)) == len(settings)
    assert {view for view, _ in settings} <= set(get_args(ViewName))
    assert {noise for _, noise in settings} <= set(get_args(NoiseName))


@pytest.mark.parametrize(
    ("lines", "width", "measured_by"),
    [
        ([row for table in PUBLISHED["rates"] for row in table["rows"]], 8, 3),
        (PUBLISHED["targets"], 10, 4),
        (PUBLISHED["shapes"], 10, 3),
        (PUBLISHED["times"], 7, 4),
        (PUBLISHED["arms"], 8, 4),
    ],
    ids=["rates", "targets", "shapes", "times", "arms"],
)
def test_published_rows_have_the_cells_of_our_columns_and_say_who_measured_and_where(lines, width, measured_by):
    assert all(len(row) == width for row in lines)
    assert all(isinstance(cell, str) and cell for row in lines for cell in row)
    assert all(
        re.fullmatch(r"[^()]+ \((ICG-Net|OrbitGrasp|EVG|NeuGraspNet|TARGO), .+\)", row[measured_by]) for row in lines
    )


def test_the_page_in_the_documents_is_made_of_the_reports_beside_it():
    title, made, *others = (DOCS / "results.md").read_text(encoding="utf-8").split("\n\n")
    assert made.startswith("Made by `icgnet benchmark report docs/results")
    assert compare(find_reports([DOCS / "results"])) == "\n\n".join([title, *others])


def test_nothing_was_published_for_the_strict_protocol(page):
    assert rows(page(clutter(protocol="strict")), "OrbitGrasp") == []


def test_tables_and_bins_have_a_table_of_their_own_with_what_the_hand_could_hold(page):
    text = page(clutter(), clutter(noise="stereo"), wide("table", 70.0), wide("bin", 60.0), wide("bin", 50.0, seed=2))
    titles = [line for line in text.splitlines() if line.startswith("### ")]
    assert titles == [
        *("### Camera random, noise gaussian", "### Camera random, noise stereo"),
        "### Tables and bins, camera random, noise stereo",
    ]
    part = section(text, "Tables and bins, camera random, noise stereo")
    assert rows(part, "method")[0][4:] == [
        f"{kind} {rate}" for kind in ("table", "bin") for rate in ("GSR", "DR", "DR of holdable")
    ]
    first, second = (row[4:] for row in rows(part, "icgnet"))
    assert [cell[:4] for cell in first] == ["90.0", "80.0", "70.0", "90.0", "80.0", "60.0"]
    assert [cell[:4] for cell in second] == ["-", "-", "-", "90.0", "80.0", "50.0"]
    assert {row[3] for row in rows(section(text, "Why attempts failed"), "icgnet")} == {"packed", "table", "bin"}


def test_nothing_is_published_of_tables_and_bins_even_with_the_camera_and_noise_that_others_used(page):
    report = wide("table", 70.0, seed=2)
    report["settings"] |= {"noise": "gaussian", "protocol": "edge"}
    part = section(page(clutter(), report), "Tables and bins, camera random, noise gaussian")
    assert [row[0] for row in rows(part, "")][2:] == ["icgnet 01234567"]


def workcell(scene: str = "packed", played: int = 100, **settings: object) -> dict[str, object]:
    told = {"arm": "fr3", "hand_eye_error": True, "obstacles": "shapes", "attached_check": True, "pool": 17}
    times = {"plan_median": 0.21, "plan_p95": 0.5, "cycle": 7.5}
    values = {"gsr": measured(97.0) | {"std": None}, "dr": measured(96.0) | {"std": None}, "hits": None, **times}
    values |= {"attempts": 420, "rounds": played, "failures": {"close: missed": 3}}
    settings = {"planner": "icgnet", "noise": "stereo", "rounds": 100, "fetch": False, **told, **settings}
    return on_pictures("workcell", values, scene=scene, **settings)


def test_a_whole_arm_stands_beside_the_real_one(page):
    text = section(page(workcell(), workcell("pile", 4, attached_check=False, fetch=True)), "A whole arm")
    checked, unchecked = rows(text, "icgnet")
    assert checked[:4] == [
        "icgnet 01234567",
        "clearing with fr3, noise stereo, hand-eye error on, obstacles shapes, carried shape checked",
        "17 test objects of procedural, 100 rounds, seed 1",
        "packed",
    ]
    assert checked[5:] == [
        *("420", "97.0 [95.0, 99.0]", "96.0 [94.0, 98.0]", "-", "0.21", "0.50", "7.50", "3 close: missed"),
    ]
    assert unchecked[0].endswith(FEW)
    assert unchecked[1].startswith("fetching one object with fr3")
    assert "carried shape not checked" in unchecked[1]
    assert [row[3:] for row in rows(text, "ICG-Net")] == [
        [kind, "its authors (ICG-Net, Real World Experiments)", "-", "90", dr, *"-----"]
        for kind, dr in (("packed", "88"), ("pile", "83"))
    ]


def test_targets_stand_by_occlusion_beside_the_published_one(page):
    text = section(page(target(), target("table", scenes=30)), "One object among others")
    assert rows(text, "method")[0][3:] == [
        *("kind", "measured by", "targets", "0 to 0.5", "0.5 to 0.9", "all", "failures")
    ]
    many, few = rows(text, "icgnet")
    assert (few[0], few[3]) == (f"icgnet 01234567 {FEW}", "table")
    assert many[1] == "strict, opening as planned; camera random, noise gaussian"
    assert many[3:] == [
        *("bin", "icgnet 0.1.0 (aaa)", "80", "60.0 [58.0, 62.0]", "-", "60.0 [58.0, 62.0]"),
        "30 missed, 2 nothing found",
    ]
    (published,) = rows(text, "TARGO-Net")
    assert published[5:] == ["-", "-", "78.9", "-", "-"]


def test_failures_are_counted_by_cause(page):
    text = section(page(clutter()), "Why attempts failed")
    header, row = rows(text, "method")[0], rows(text, "icgnet")[0]
    assert dict(zip(header[3:], row[3:], strict=True)) == {
        **{"kind": "packed", "attempts": "500", "failed": "50", "missed": "30", "too wide": "20"},
        **{"nothing found": "7", "touching": "11", "lost": "4"},
    }


@pytest.mark.parametrize(
    ("reports", "marks"),
    [
        ([clutter()], ""),
        ([clutter(commit="aaa-dirty")], UNCOMMITTED),
        ([clutter(commit=None)], UNCOMMITTED),
        ([clutter(played=99)], FEW),
        ([clutter(), clutter(commit="bbb", scene="pile")], MIXED),
        ([clutter() | {"commits": ["aaa", "bbb"]}], MIXED),
        ([clutter() | {"commits": ["aaa-dirty", "bbb"]}], UNCOMMITTED + MIXED),
        ([clutter() | {"commits": [None, "bbb"]}], UNCOMMITTED + MIXED),
        ([clutter(commit="ccc-dirty") | {"commits": ["aaa"]}], ""),
        ([shapes(50.0, 3.0) | {"scenes": 20}], FEW),
    ],
    ids=[
        *(
            "none",
            "changed files",
            "no repository",
            "few rounds",
            "two commits",
            "resumed",
            "resumed from changed files",
        ),
        *("resumed from what is not known", "counted with another commit", "few scenes"),
    ],
)
def test_rows_that_are_not_to_be_trusted_are_marked_and_the_marks_explained(page, reports, marks):
    text = page(*reports)
    assert rows(text, "icgnet")[0][0] == f"icgnet 01234567 {' '.join(marks)}".strip()
    explained = [mark for mark in (UNCOMMITTED, FEW, MIXED) if f"\n- {mark} " in text]
    assert explained == list(marks)


def test_a_row_names_every_commit_that_its_rounds_were_played_with(page):
    text = page(clutter() | {"commits": ["aaa", "bbb"]}, clutter(scene="pile") | {"commits": [None, "bbb"]})
    (row,) = rows(section(text, "Camera random, noise gaussian"), "icgnet")
    assert row[3] == "icgnet 0.1.0 (aaa), 0.1.0 (bbb), 0.1.0 (no commit)"


def test_the_page_says_that_its_intervals_are_probably_too_narrow(page):
    assert "not independent, it is probably too narrow" in " ".join(page(clutter()).split())


def test_published_rows_of_one_source_may_have_protocols_of_their_own(page):
    text = section(page(clutter()), "Camera random, noise gaussian")
    noise = {start: rows(text, start)[0][1].rpartition("; ")[2] for start in ("ICG-Net", "GIGA-HR", "GIGA ", "VGN")}
    assert noise == {
        **{"ICG-Net": "0.8 mm on the points", "GIGA-HR": "0.8 mm on the depth of each pixel"},
        **{"GIGA ": "0.8 mm on the depth of each pixel", "VGN": "noise not checked"},
    }


def test_the_deviation_over_runs_is_left_out_where_there_is_only_one(page):
    (row,) = rows(section(page(clutter(90.0, runs=1)), "Camera random, noise gaussian"), "icgnet")
    assert row[4] == "90.0 [88.0, 92.0]"


def test_a_rate_without_any_attempt_is_a_dash(page):
    empty = clutter() | {"gsr": dict.fromkeys(("mean", "std", "low", "high"), math.nan)}
    assert rows(section(page(empty), "Camera random, noise gaussian"), "icgnet")[0][4] == "-"


def test_an_unusual_search_is_named(page):
    (row,) = rows(section(page(clutter(search={**SEARCH, "resample": False})), "Camera random, noise gaussian"), "icg")
    assert row[0] == "icgnet 01234567 (resample=False)"


def test_shapes_stand_beside_the_papers(page):
    text = section(page(shapes(84.1, 2.344), shapes(70.0, None, scene="pile", threads=2)), "Shapes")
    (own,) = rows(text, "icgnet")
    assert own[4:7] == ["84.1 ± 1.0 [82.1, 86.1]", "2.34 ± 1.00 [0.34, 4.34]", "0"]
    assert own[7:] == ["70.0 ± 1.0 [68.0, 72.0]", "-", "100"]
    assert rows(text, "method")[0][6] == "packed scenes without a shape"
    assert rows(text, "ICG-Net")[0][4:] == ["84 ± 6.1", "2.3 ± 1.1", "-", "77 ± 9.9", "2.9 ± 1.9", "-"]
    assert {row[0] for row in rows(text, "")} > {"GIGA", "NeuGraspNet"}


def test_instances_and_times_have_sections(page):
    names = ("instance_miou", "ap50", "pq", "class_pq", "class_accuracy")
    scores = {name: measured(60.0 + index) for index, name in enumerate(names)}
    text = page(
        on_pictures("segmentation", {"scores": scores, "scenes": 100}, scene="pile"),
        latency(),
    )
    instances = rows(section(text, "Instances"), "icgnet")[0]
    assert instances[3] == "pile"
    assert [cell.split()[0] for cell in instances[5:]] == ["60.0", "61.0", "62.0", "63.0", "64.0"]
    time = section(text, "Time")
    assert rows(time, "method")[0][5:] == ["parameters", "whole", "encode", "collision"]
    own = rows(time, "icgnet")[0]
    assert own[0] == "icgnet 01234567"
    assert own[3] == "Slow CPU, cpu, 1 thread"
    assert own[5:] == ["3.3 M", "300 (250 to 400)", "200 (200 to 200)", "90 (90 to 90)"]
    assert [rows(time, "ICG-Net")[0][index] for index in (3, 5, 6)] == ["NVIDIA RTX 3080", "3.2 M", "138"]
    assert "Clutter" not in text


def test_a_bar_in_a_name_does_not_break_the_table(page):
    text = page(clutter(planner="mine:A|B", weights=None, search=None))
    assert len(rows(text, r"mine:A\|B")[0]) == 8


def test_reports_are_found_in_folders_inside_of_folders_and_once(tmp_path):
    for folder in ("one", "deep/er/two"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "report.json").write_text(json.dumps(clutter()))
    reports = find_reports([tmp_path / "one", tmp_path])
    assert [report.path.parent.name for report in reports] == ["one", "two"]


def test_reports_of_other_kinds_are_named_and_not_enough_alone(page, tmp_path):
    assert "Not on this page:" in page(clutter(), {"benchmark": "loader"})
    with pytest.raises(
        InputError, match="clutter, target, reconstruction, segmentation, latency, captures, workcell; found: loader"
    ):
        compare(find_reports([tmp_path / "b"]))


def broken(tmp_path: Path, text: str) -> Path:
    (tmp_path / "report.json").write_text(text)
    return tmp_path


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"benchmark": "clu', "report.json: cannot be read"),
        ("[]", "does not say what it is of.*clutter, reconstruction, segmentation, latency"),
        ('{"gsr": 1}', "does not say what it is of"),
        ('{"benchmark": "beauty"}', "unknown kind 'beauty'.*clutter, reconstruction, segmentation, latency"),
        ('{"benchmark": "clutter", "settings": {}}', "report.json: this clutter report has no settings.full_opening"),
        (json.dumps(clutter() | {"gsr": {"mean": "a"}}), "gsr.mean must be a number, got 'a'"),
        (json.dumps(clutter() | {"lost": 0.5}), "lost must be a whole number, got 0.5"),
        (json.dumps(clutter() | {"commits": []}), "commits must be names of at least one commit, got \\[\\]"),
        (json.dumps(clutter() | {"commits": "aaa"}), "commits must be names of at least one commit, got 'aaa'"),
        (json.dumps(clutter() | {"origin": origin() | {"commit": 3}}), "commits must be names .*, got \\[3\\]"),
        (json.dumps(clutter() | {"failures": 3}), "failures must be names with values, got 3"),
        (json.dumps(clutter(view=["top"])), "settings.view must be a text, got \\['top'\\]"),
        (json.dumps(clutter(scene=None)), "settings.scene must be a text, got None"),
        (json.dumps(clutter(rounds="many")), "settings.rounds must be a whole number, got 'many'"),
        (json.dumps(clutter() | {"lost": math.inf}), "lost must be a whole number, got inf"),
        (json.dumps(clutter() | {"lost": 10**400}), "lost must be a whole number, got 1000"),
        (json.dumps(latency(model={})), "this latency report has no model.parameters"),
        ("[" * 100000, "report.json: cannot be read"),
    ],
)
def test_a_report_that_cannot_be_used_is_named(tmp_path, text, message):
    with pytest.raises(DataError, match=message):
        compare(find_reports([broken(tmp_path, text)]))
