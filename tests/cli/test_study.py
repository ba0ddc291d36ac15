import json

import pytest

from icgnet.cli.main import USAGE_ERROR, main
from icgnet.datagen.config import LabelSettings
from icgnet.datagen.generate import GenerateConfig, generate


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    generate(folder, GenerateConfig(scene="packed", scenes=2, labels=LabelSettings(contacts=4)))
    return folder


def test_loader_prints_scenes_per_second_and_writes_a_report(scenes, tmp_path, capsys):
    assert main(["study", "loader", "--data", str(scenes), "--visits", "4", "--out", str(tmp_path / "report")]) == 0
    assert "scenes a second on one core" in capsys.readouterr().out
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert report["visits"] == 4
    visit = report["visit_ms"]
    assert visit["p10"] <= visit["median"] <= visit["p90"]
    assert report["scenes_per_second"] > 0
    assert report["settings"]["preset"] == "cpu"
    assert report["origin"].keys() == {"version", "commit", "processor", "cores", "python"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["loader", "--data", "nowhere"], "nowhere"),
        (["simulation", "--objects", "nowhere"], "nowhere"),
        (["simulation", "--objects", "procedural", "--scenes", "1"], "packed/chips_can"),
    ],
)
def test_unusable_input_is_one_line_and_exit_code_2(arguments, message, capsys):
    assert main(["study", *arguments]) == USAGE_ERROR
    error = capsys.readouterr().err
    assert error.startswith("error:")
    assert message in error
    assert error.count("\n") == 1
