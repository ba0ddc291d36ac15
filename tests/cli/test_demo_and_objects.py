"""`icgnet demo` and `icgnet objects check`."""

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from icgnet.cli import demo
from icgnet.cli.main import main
from icgnet.network.weights import save_weights
from tabletop_scenes import tiny_network


def middle_of_captures(folder: Path) -> Path:
    """The shipped captures, of each the middle: the tiny network takes everything for an object, which takes time."""
    folder.mkdir()
    for name in demo.CAPTURES:
        with np.load(demo.FOLDER / f"{name}.npz") as capture:
            K = capture["K"] - [[0, 0, 160], [0, 0, 120], [0, 0, 0]]
            K[:2] /= 2
            depth = capture["depth"][120:360:2, 160:480:2]
            np.savez(folder / f"{name}.npz", depth=depth, K=K, camera_pose=capture["camera_pose"])
    return folder


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_the_demo_writes_predictions_of_the_shipped_captures_and_warns_of_nothing(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(demo, "FOLDER", middle_of_captures(tmp_path / "captures"))
    save_weights(tmp_path / "tiny.safetensors", tiny_network(), {})
    out = tmp_path / "demo_output"
    assert main(["demo", "--out", str(out), "--weights", str(tmp_path / "tiny.safetensors"), "--threads", "1"]) == 0
    for folder in (out, tmp_path / "demo_output_table"):
        assert json.loads((folder / "result.json").read_text())["frame_id"] == "world"
        assert (folder / "picture.png").is_file()
    captured = capsys.readouterr()
    assert "icgnet view" in captured.out
    assert captured.err == ""


def test_a_missing_capture_is_named(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(demo, "FOLDER", tmp_path)
    assert main(["demo", "--out", str(tmp_path / "out")]) == 2
    assert "no demo capture" in capsys.readouterr().err


def test_a_folder_of_sound_meshes_passes(tmp_path, capsys):
    trimesh.creation.box([0.05, 0.04, 0.03]).export(tmp_path / "brick.ply")
    assert main(["objects", "check", str(tmp_path), "--units", "m"]) == 0
    captured = capsys.readouterr()
    assert "1 objects: 1 ok" in captured.out
    assert 'write "units: m" into' in captured.err
    (tmp_path / "objects.yaml").write_text("units: m")
    assert main(["objects", "check", str(tmp_path)]) == 0
    assert capsys.readouterr().err == ""


def test_a_broken_mesh_is_listed_and_exits_with_2(tmp_path, capsys):
    trimesh.creation.box([0.05, 0.04, 0.03]).export(tmp_path / "brick.ply")
    (tmp_path / "heap.obj").write_text("not a mesh")
    assert main(["objects", "check", str(tmp_path), "--units", "m"]) == 2
    captured = capsys.readouterr()
    assert "heap" in captured.out
    assert "1 of 2 objects" in captured.err
