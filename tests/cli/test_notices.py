"""Every command that takes an object set says which of its objects it leaves out."""

from pathlib import Path

import pytest

from icgnet.cli.main import USAGE_ERROR, main

URDF = """<robot name="twice"><link name="base">
  <visual><geometry><box size="0.05 0.05 0.05"/></geometry></visual>
  <collision><geometry><box size="0.05 0.05 0.05"/></geometry></collision>
</link></robot>"""

COMMANDS = {
    "generate": ["generate", "--out", "out", "--scene", "pile"],
    "simulate": ["simulate", "--out", "scene.npz", "--scene", "pile"],
    "sensors": ["sensors", "--out", "sheet.png", "--scene", "pile"],
    "clutter": ["benchmark", "clutter", "--planner", "random", "--scene", "pile", "--out", "out"],
    "reconstruction": ["benchmark", "reconstruction", "--scene", "pile"],
    "segmentation": ["benchmark", "segmentation", "--scene", "pile"],
    "latency": ["benchmark", "latency", "--scene", "pile"],
    "simulation": ["study", "simulation"],
}


@pytest.fixture
def doubled(tmp_path) -> Path:
    """An object set with one name for two objects, and another object to train with."""
    for path in ("train/twice", "test/twice", "train/brick"):
        file = tmp_path / "things" / "pile" / f"{path}.urdf"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(URDF)
    return tmp_path / "things"


@pytest.mark.parametrize("name", COMMANDS)
def test_an_object_that_is_left_out_is_named_on_standard_error(name, doubled, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    # Nothing is left to test with, so that every command ends soon; generation finds that out before it says anything.
    split = "train" if name == "generate" else "test"
    options = ["--scenes", "1", "--labels.contacts", "1"] if name == "generate" else []
    code = main([*COMMANDS[name], "--objects", str(doubled), "--split", split, *options])
    printed = capsys.readouterr()
    assert code == (0 if name == "generate" else USAGE_ERROR), printed.err
    assert printed.err.splitlines()[0] == "warning: pile/twice is left out: 2 objects have this name"
    assert printed.err.count("is left out") == 1
    assert "is left out" not in printed.out


def test_nothing_is_said_of_a_set_that_is_used_whole(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["simulate", "--out", "scene.npz", "--count", "1"]) == 0
    assert capsys.readouterr().err == ""
