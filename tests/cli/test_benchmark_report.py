import json

import pytest

from icgnet.cli.main import USAGE_ERROR, main

SPREAD = {"mean": 60.0, "std": 1.0, "low": 59.0, "high": 61.0}
SETTINGS = {
    **{"objects": "procedural", "scene": "packed", "split": "test", "view": "random", "noise": "gaussian"},
    "gripper": {"name": "franka"},
}
REPORT = {
    "benchmark": "reconstruction",
    "scene": {"iou": SPREAD, "chamfer_l1_mm": SPREAD},
    "scenes": 100,
    "without_shape": 0,
    "settings": {**SETTINGS, "scenes": 100, "seed": 1, "weights": "a" * 64},
    "origin": {"version": "0.1.0", "commit": "abc"},
}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "results" / "shapes").mkdir(parents=True)
    (tmp_path / "results" / "shapes" / "report.json").write_text(json.dumps(REPORT))
    return tmp_path / "results"


def test_the_page_is_printed_as_plain_markdown_or_written(folder, tmp_path, capsys):
    assert main(["benchmark", "report", str(folder)]) == 0
    page = capsys.readouterr().out
    assert page.startswith("# Benchmark\n")
    (own,) = [line for line in page.splitlines() if line.startswith("| icgnet")]  # unbroken, however long
    assert own.count("60.0 ± 1.0 [59.0, 61.0]") == 1
    out = tmp_path / "pages" / "page.md"
    assert main(["benchmark", "report", str(folder), "--out", str(out)]) == 0
    assert out.read_text() == page
    assert capsys.readouterr().out == f"{out}: 1 report\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "holds no report.json"),
        ("{", "report.json: cannot be read"),
        ('{"benchmark": "beauty"}', "must be one of clutter, reconstruction, segmentation, latency"),
    ],
)
def test_a_folder_without_usable_reports_is_one_line_and_exit_code_2(text, message, tmp_path, capsys):
    if text is not None:
        (tmp_path / "report.json").write_text(text)
    assert main(["benchmark", "report", str(tmp_path)]) == USAGE_ERROR
    error = capsys.readouterr().err
    assert error.startswith("error:")
    assert str(tmp_path) in error
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("folders", "message"), [([], "at least one folder"), (["nowhere"], "no such folder: nowhere")]
)
def test_folders_must_be_given_and_be_there(folders, message, capsys):
    assert main(["benchmark", "report", *folders]) == USAGE_ERROR
    assert message in capsys.readouterr().err
