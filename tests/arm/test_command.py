"""`icgnet pick`, and its picture."""

import json

import numpy as np
import pytest
import yaml
from PIL import Image

import needs_arm  # noqa: F401
from arm_scenes import arm_file, box
from icgnet.cli.main import main


@pytest.fixture(autouse=True)
def plain_output(monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")


@pytest.fixture
def folder(tmp_path, seen, monkeypatch):
    """A folder with a saved prediction, and an arm that stands before what it holds."""
    monkeypatch.chdir(tmp_path)
    seen([box((0.05, 0.04, 0.10)), box((0.05, 0.04, 0.06), x=0.27)], grasped=(0, 1)).save(tmp_path / "seen")
    arm_file(tmp_path)
    return tmp_path


def test_a_plan_is_printed_written_and_drawn(folder, capsys):
    command = ["pick", "seen", "--arm", "arm.yaml", "--drop", "-0.05", "0.5", "0.2", "--instance", "1"]
    assert main(command) == 0
    output = capsys.readouterr().out
    assert "object 1, box" in output
    assert "refused grasps: none" in output
    for phase in ("reach", "approach", "close", "lift", "carry", "release", "return"):
        assert phase in output
    saved = json.loads((folder / "pick" / "plan.json").read_text())
    assert saved["instance_id"] == 1
    with Image.open(folder / "pick" / "picture.png") as image:
        pixels = np.asarray(image)
    assert image.width > 1500
    assert (pixels < 200).any(axis=2).mean() > 0.01


def test_clearances_are_printed_when_they_are_asked_for(folder, capsys):
    command = ["pick", "seen", "--arm", "arm.yaml", "--drop", "-0.05", "0.5", "0.2", "--overwrite"]
    assert main(command) == 0
    assert "least clearance" not in capsys.readouterr().out
    assert {phase["clearance"] for phase in json.loads((folder / "pick/plan.json").read_text())["phases"]} == {None}
    assert main([*command, "--clearances"]) == 0
    output = capsys.readouterr().out
    assert "least clearance" in output
    assert " mm" in output
    assert all(phase["clearance"] >= 0 for phase in json.loads((folder / "pick/plan.json").read_text())["phases"])


def test_a_plan_is_shown_in_the_browser(folder, capsys, monkeypatch):
    shown = []
    monkeypatch.setattr("icgnet.viewer.pick_web.PickViewer.wait", lambda viewer: (shown.append(viewer), viewer.stop()))
    assert main(["pick", "seen", "--arm", "arm.yaml", "--drop", "-0.05", "0.5", "0.2", "--view"]) == 0
    assert main(["view", "pick", "--port", "8123"]) == 0
    assert capsys.readouterr().out.count("in a browser; stop with Ctrl-C") == 2
    assert [viewer.motion.title for viewer in shown] == ["object 0", "object 0"]
    assert all(any(part.moves for part in viewer.motion.parts if part.kind == "arm") for viewer in shown)


def test_a_plan_that_was_not_found_cannot_be_viewed(folder, capsys):
    (folder / "empty").mkdir()
    (folder / "empty" / "plan.json").write_text("{}")
    assert main(["view", "empty"]) == 2
    assert "holds a plan without motion.npz: nothing was found" in capsys.readouterr().err


def test_joints_are_for_a_camera_on_the_arm(folder, capsys):
    (folder / "eye.yaml").write_text(yaml.safe_dump({"T_base_camera": [0.4, 0.1, 0.7, 0.0, 1.0, 0.0, 0.0]}))
    command = ["pick", "seen", "--drop", "0.1", "0.4", "0.2", "--hand-eye", "eye.yaml", "--joints", "0", "0"]
    assert main(command) == 2
    assert "--joints is for a camera on the arm" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--drop", "0.1", "0.4", "0.0"], "drop must be above the support, but it is 0.050 m below it"),
        (["--drop", "0.1", "9", "0.2"], "from the first joint of the arm"),
        (["--drop", "0.1", "0.4", "0.2", "--instance", "7"], "no object 7"),
        (["--drop", "0.1", "0.4", "0.2", "--object-class", "can"], "there is no grasp to plan for"),
        (["--drop", "0.1", "0.4", "0.2", "--hand-eye", "none.yaml"], "no such hand-eye file: none.yaml"),
        (["--drop", "nan", "0.4", "0.2"], "drop must be three finite numbers"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(folder, capsys, arguments, message):
    assert main(["pick", "seen", "--arm", "arm.yaml", *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_a_depth_image_needs_the_place_of_the_camera(folder, capsys):
    assert main(["pick", "image.png", "--drop", "0.1", "0.4", "0.2"]) == 2
    assert "a depth image needs --hand-eye" in capsys.readouterr().err
