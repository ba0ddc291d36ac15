"""`icgnet calibrate` on two small scenes of procedural objects, and what it says of wrong use."""

import json
from pathlib import Path

import pytest
from PIL import Image

from icgnet.cli.main import main
from icgnet.network.weights import load_weights, save_weights
from simple_networks import network_that_likes_hands_from_above


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("data") / "scenes"
    options = ["--scene", "packed", "--scenes", "2", "--labels.contacts", "24", "--split", "val"]
    assert main(["generate", "--out", str(folder), *options]) == 0
    return folder


@pytest.fixture
def weights(tmp_path) -> Path:
    save_weights(tmp_path / "w.safetensors", network_that_likes_hands_from_above(), {})
    return tmp_path / "w.safetensors"


@pytest.mark.slow
def test_calibrate_writes_weights_a_diagram_and_a_report(scenes, weights, tmp_path, capsys):
    out = tmp_path / "calibrated"
    assert main(["calibrate", "--weights", str(weights), "--data", str(scenes), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "expected calibration error" in printed
    assert "before" in printed
    assert load_weights(out / "weights.safetensors")[1]["calibration"]["scenes"] == 2
    with Image.open(out / "reliability.png") as image:
        assert image.width > image.height
    numbers = json.loads((out / "report.json").read_text())
    assert numbers["after"]["log_loss"] < numbers["before"]["log_loss"]
    assert sum(each["count"] for each in numbers["after"]["bins_of_equal_width"]) == numbers["after"]["grasps"]


@pytest.mark.slow
def test_evaluate_prints_the_calibration_error(scenes, weights, capsys):
    assert main(["evaluate", "--data", str(scenes), "--weights", str(weights)]) == 0
    assert "grasp_ece" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["--weights", "nowhere.safetensors", "--data", "a", "--out", "o"], "nowhere.safetensors"),
        (["--weights", ".", "--data", "a", "--out", "o"], "no such file or folder: a"),
        (["--weights", ".", "--data", ".", "--out", "o", "--scenes", "1"], "got 1"),
    ],
)
def test_wrong_use_is_one_line_and_leaves_nothing(arguments, named, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["calibrate", *arguments]) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert named in err
    assert list(tmp_path.iterdir()) == []
