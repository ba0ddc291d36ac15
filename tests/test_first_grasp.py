"""The guide to the first grasp runs as it is written, after the installation."""

import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import needs_arm  # noqa: F401
from icgnet.cli.main import main

GUIDE = (Path(__file__).parents[1] / "docs" / "guides" / "first_grasp.md").read_text()


@pytest.mark.slow
def test_its_steps_lead_to_a_grasp_in_the_frame_of_the_base(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    steps = re.findall(r"^```(python|bash)\n(.*?)^```", GUIDE, re.S | re.M)
    for language, block in steps:
        if language == "python":
            exec(block, {})
            continue
        for line in block.splitlines():
            if line.startswith(("icgnet predict ", "icgnet pick ")):
                assert main(shlex.split(line)[1:]) == 0
    assert "frame base of" in capsys.readouterr().out
    T_base_camera = np.array(json.loads((tmp_path / "T_base_camera.json").read_text()))
    with np.load(tmp_path / "seen" / "grasps.npz") as grasps:
        assert grasps["frame_id"] == "base"
        # The camera looks at what is to be grasped.
        in_camera = np.linalg.inv(T_base_camera) @ grasps["grasps"][0] @ [0, 0, 0, 1]
    assert np.linalg.norm(in_camera[:2]) < 0.3 < in_camera[2] < 1.0
    assert json.loads((tmp_path / "plan" / "plan.json").read_text())["phases"]
