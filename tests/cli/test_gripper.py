"""`icgnet gripper check`."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from icgnet.cli.gripper import measures
from icgnet.cli.main import main
from icgnet.grasping.gripper import GRIPPERS, load_gripper

ENTRIES = yaml.safe_load((GRIPPERS / "franka.yaml").read_text())


@pytest.fixture(autouse=True)
def plain_output(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")


def test_a_file_is_measured_and_drawn(tmp_path, capsys):
    entries = ENTRIES | {"name": "mine", "max_opening": 0.07, "base_quaternion": [0.0, 0.0, 0.0, 1.0]}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(entries))
    assert main(["gripper", "check", str(tmp_path / "mine.yaml"), "--out", str(tmp_path / "picture.png")]) == 0
    output = capsys.readouterr().out
    assert "gripper mine" in output
    assert "0 to 70.0 mm between the pads" in output
    assert "(0, 0, 0, 1)" in output
    with Image.open(tmp_path / "picture.png") as image:
        assert image.width > 3 * 500


def test_the_measures_are_those_of_the_hand():
    told = measures(load_gripper())
    assert told["widest object"].startswith("68.0 mm with 6.0 mm")
    assert told["finger (x, y, z)"] == "21.0 x 26.0 x 53.8 mm, 4 boxes"
    assert told["finger in front of the palm"] == "46.3 mm"
    assert told["palm (x, y, z)"] == "63.2 x 204.0 x 91.9 mm, 3 boxes"
    assert told["base link in the grasp frame"] == "at (0.0, 0.0, -112.3) mm, quaternion wxyz (1, 0, 0, 0)"


@pytest.mark.parametrize(
    ("change", "arguments", "message"),
    [
        ({"clearance": 1.0}, [], "clearance must be a number from 0.0005 to 0.05 m, got 1.0"),
        ({}, ["--out", "picture.jpg"], "must end in .png, got 'picture.jpg'"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(tmp_path, monkeypatch, capsys, change, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(ENTRIES | change))
    assert main(["gripper", "check", "mine.yaml", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert np.array_equal([path.name for path in tmp_path.iterdir()], ["mine.yaml"])


def test_the_hand_of_the_guide_is_one(tmp_path):
    guide = (Path(__file__).parents[2] / "docs" / "guides" / "own_gripper.md").read_text()
    (tmp_path / "wide.yaml").write_text(guide.split("```yaml\n")[1].split("```")[0])
    assert load_gripper(tmp_path / "wide.yaml").name == "wide"
