"""The guide says what is true, and its lines run as they are written."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from arm_scenes import arm_file, box, boxes_seen
from http_service import DEPTH, POSE, HeldUpPredictor, depth_png, known_prediction, npz, running
from icgnet.client import Client
from icgnet.errors import MissingExtraError
from icgnet.service.app import PREDICT_RESPONSES
from icgnet.service.bodies import JSON, NPZ, PNG
from icgnet.service.options import ANSWERS, OPTIONS, PICK_OPTIONS
from tabletop_scenes import INTRINSICS

ADDRESS = "http://127.0.0.1:8000"
GUIDE = (Path(__file__).parents[2] / "docs" / "guides" / "service.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", GUIDE, re.S | re.M)


def first_cells(header: str) -> list[str]:
    table = GUIDE.partition(f"| {header} |")[2].partition("\n\n")[0]
    return [line.split("|")[1].strip() for line in table.splitlines()[2:]]


def test_every_option_kind_and_status_is_in_the_guide():
    assert first_cells("option") == [f"`{name}`" for name in OPTIONS]
    assert first_cells("option of a pick") == [f"`{name}`" for name in PICK_OPTIONS if name not in OPTIONS]
    assert first_cells("`Content-Type`") == [f"`{kind}`" for kind in (PNG, NPZ, JSON)]
    statuses = {int(number) for cell in first_cells("status") for number in cell.split(", ")}
    assert statuses >= set(PREDICT_RESPONSES) - {200}
    assert all(f"`answer={kind}`" in GUIDE for kind in ANSWERS)


def curl_lines() -> list[str]:
    if shutil.which("curl") is None:
        pytest.skip("needs curl")
    return [line for block in blocks("bash") for line in block.splitlines() if line.startswith("curl ")]


def test_the_lines_for_the_shell_run(tmp_path):
    lines = [line for line in curl_lines() if "/predict" in line]
    assert len(lines) == 4
    (tmp_path / "depth.png").write_bytes(depth_png())
    (tmp_path / "view.npz").write_bytes(npz(depth=DEPTH, K=INTRINSICS, camera_pose=POSE))
    cloud = {"points": known_prediction().cloud.points.tolist(), "viewpoint": POSE[:3, 3].tolist()}
    (tmp_path / "cloud.json").write_text(json.dumps(cloud))
    with running(HeldUpPredictor()) as (url, _, _):
        said = [
            subprocess.run(line.replace(ADDRESS, url), shell=True, cwd=tmp_path, capture_output=True, check=True).stdout
            for line in lines
        ]
    assert len(json.loads(said[0])["grasps"]) > 5
    assert len(said[1].splitlines()) == 4
    with np.load(tmp_path / "answer.npz") as saved:
        assert saved["instance_mask"].shape == known_prediction().input_shape
    assert json.loads(said[3])["format"] == known_prediction().to_dict()["format"]


def test_the_lines_of_python_run(capsys):
    _, code = blocks("python")
    names = {"depth": DEPTH, "K": INTRINSICS, "T_base_camera": POSE}
    with running(HeldUpPredictor()) as (url, _, _):
        exec(code.replace(ADDRESS, url), names)
    assert len(names["T_base_grasp"]) == len(known_prediction().grasps)
    assert len(names["vertices"]) > 0
    assert capsys.readouterr().out


def test_the_lines_for_a_pick_run(tmp_path, capsys):
    pytest.importorskip("icgnet.arm.libraries", reason="needs icgnet[arm]", exc_type=MissingExtraError)
    from icgnet.arm.arm import Arm
    from icgnet.service.picking import PickBench

    (line,) = [line for line in curl_lines() if "/pick" in line]
    code, _ = blocks("python")
    (tmp_path / "view.npz").write_bytes(npz(depth=DEPTH, K=INTRINSICS, camera_pose=POSE))
    predictor = HeldUpPredictor(boxes_seen([box((0.05, 0.04, 0.10))]))
    with running(predictor, bench=PickBench(Arm.load(arm_file(tmp_path)))) as (url, _, _):
        subprocess.run(line.replace(ADDRESS, url), shell=True, cwd=tmp_path, capture_output=True, check=True)
        with Client(url, timeout=60.0) as client:
            exec(code, {"client": client, "depth": DEPTH, "K": INTRINSICS, "T_base_camera": POSE})
    assert json.loads((tmp_path / "plan.json").read_text())["plan"]["phases"]
    assert capsys.readouterr().out.split()[::2][:2] == ["reach", "approach"]
