"""`icgnet predict`, from files to files."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from safetensors.torch import load_file, save_file

from icgnet.cli.main import main
from icgnet.geometry.camera import unproject
from icgnet.network.weights import save_weights
from icgnet.network.weights_header import read_header
from tabletop_scenes import INTRINSICS, THREE_BOXES, camera_pose, depth_image, tiny_network

QUICK = ["--contacts", "48", "--max-checked", "96", "--no-resample", "--threads", "1"]
FOCAL = [str(x) for x in (INTRINSICS[0, 0], INTRINSICS[1, 1], INTRINSICS[0, 2], INTRINSICS[1, 2])]


@pytest.fixture(scope="module")
def files(tmp_path_factory) -> Path:
    """A folder with weights, a depth image, and the same as npz and cloud."""
    folder = tmp_path_factory.mktemp("files")
    depth = depth_image(THREE_BOXES, camera_pose())
    save_weights(folder / "tiny.safetensors", tiny_network(), {})
    Image.fromarray(np.round(1000 * depth).astype(np.uint16)).save(folder / "depth.png")
    np.savez(folder / "view.npz", depth=depth, K=INTRINSICS, camera_pose=camera_pose())
    grid = unproject(depth, INTRINSICS).reshape(-1, 3)
    trimesh.PointCloud(grid[np.isfinite(grid).all(axis=1)]).export(folder / "cloud.ply")
    return folder


def predict(files: Path, name: str, *options: str) -> int:
    return main(["predict", str(files / name), "--weights", str(files / "tiny.safetensors"), *QUICK, *options])


def test_a_depth_image_becomes_a_folder_with_everything(files, tmp_path, capsys):
    out = tmp_path / "out"
    assert predict(files, "depth.png", "--intrinsics", *FOCAL, "--depth-scale", "1000", "--out", str(out)) == 0
    names = {path.name for path in out.iterdir()}
    assert {"result.json", "grasps.npz", "meshes", "picture.png", "mask.png"} <= names
    result = json.loads((out / "result.json").read_text())
    assert result["frame_id"] == "camera"
    assert len(result["objects"]) > 0
    assert "meshes" in result["timings_ms"]
    assert Image.open(out / "picture.png").size[0] > 500
    said = capsys.readouterr().out
    assert "objects" in said
    assert str(out) in said.replace("\n", "")
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


def test_json_to_stdout_prints_nothing_else_and_writes_nothing(files, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert predict(files, "view.npz", "--json", "-") == 0
    result = json.loads(capsys.readouterr().out)
    assert {"frame_id", "objects", "grasps", "rejected", "timings_ms"} <= set(result)
    assert result["frame_id"] == "world"
    assert list(tmp_path.iterdir()) == []


def test_repeated_predictions_report_the_median_of_each_timing(files, tmp_path, monkeypatch):
    laps = iter([50.0, 10.0, 20.0])

    def with_lap(prediction):
        return replace(prediction, timings_ms={"encode": next(laps)})

    monkeypatch.setattr("icgnet.cli.predict.with_meshes", with_lap)
    assert predict(files, "view.npz", "--out", str(tmp_path / "out"), "--repeat", "3") == 0
    assert json.loads((tmp_path / "out" / "result.json").read_text())["timings_ms"] == {"encode": 20.0}


def test_json_alone_makes_no_meshes_and_names_no_files(files, capsys, monkeypatch):
    monkeypatch.setattr("icgnet.inference.prediction.DetectedObject.mesh", lambda item: pytest.fail("a mesh"))
    assert predict(files, "view.npz", "--json", "-") == 0
    objects = json.loads(capsys.readouterr().out)["objects"]
    assert objects
    assert not any("mesh" in entry for entry in objects)


def test_json_to_a_file(files, tmp_path):
    assert predict(files, "view.npz", "--json", str(tmp_path / "scene.json")) == 0
    assert json.loads((tmp_path / "scene.json").read_text())["frame_id"] == "world"


def test_a_cloud_is_taken_in_the_camera_frame(files, capsys):
    assert predict(files, "cloud.ply", "--json", "-") == 0
    assert json.loads(capsys.readouterr().out)["frame_id"] == "camera"


def test_grasps_of_one_object_only(files, capsys):
    assert predict(files, "view.npz", "--json", "-") == 0
    every = [grasp["instance_id"] for grasp in json.loads(capsys.readouterr().out)["grasps"]]
    assert len(set(every)) > 1
    wanted = every[-1]
    assert predict(files, "view.npz", "--json", "-", "--instance", str(wanted)) == 0
    kept = [grasp["instance_id"] for grasp in json.loads(capsys.readouterr().out)["grasps"]]
    assert kept == [wanted] * every.count(wanted)


def test_a_pose_may_be_given_by_numbers_with_signs_and_exponents(files, capsys):
    pose = [f"{value:.9e}" for value in camera_pose().ravel()]
    options = ("--intrinsics", *FOCAL, "--depth-scale", "1000", "--json", "-", "--camera-pose", *pose)
    assert predict(files, "depth.png", *options) == 0
    assert json.loads(capsys.readouterr().out)["frame_id"] == "world"


def bad_inputs(folder: Path) -> dict[str, tuple[list[str], str]]:
    """Arguments that are wrong, and what the message must name."""
    rng = np.random.default_rng(0)
    np.save(folder / "empty.npy", np.zeros((0, 3)))
    np.save(folder / "nan.npy", np.full((500, 3), np.nan))
    np.save(folder / "few.npy", rng.normal(size=(99, 3)))
    np.save(folder / "ball.npy", rng.normal(size=(2000, 3)))
    np.save(folder / "stack.npy", np.full((5, 40, 30), 0.5))
    np.save(folder / "left.npy", np.diag([1.0, 1.0, -1.0, 1.0]))
    np.save(folder / "shear.npy", np.array([[1, 0.3, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1.0]]))
    (folder / "broken.safetensors").write_bytes(b"not weights")
    header = read_header(folder / "tiny.safetensors")
    other = replace(header, config=replace(header.config, decoder_width=9))
    save_file(load_file(folder / "tiny.safetensors"), folder / "other.safetensors", other.entries())
    depth, view = str(folder / "depth.png"), str(folder / "view.npz")
    metric = [depth, "--intrinsics", *FOCAL, "--depth-scale", "1000"]
    return {
        "no such file": ([str(folder / "nowhere.png")], "nowhere.png"),
        "empty cloud": ([str(folder / "empty.npy")], "0 finite points"),
        "all-NaN cloud": ([str(folder / "nan.npy")], "0 finite points (of 500 given)"),
        "fewer than 100 points": ([str(folder / "few.npy")], "99 finite points"),
        "depth of the wrong shape": ([str(folder / "stack.npy"), "--intrinsics", *FOCAL], "(5, 40, 30)"),
        "millimetres taken for metres": ([depth, "--intrinsics", *FOCAL], "--depth-scale 1000"),
        "scale 0": ([depth, "--intrinsics", *FOCAL, "--depth-scale", "0"], "got 0"),
        "singular intrinsics": ([depth, "--intrinsics", "0", "0", "0", "0"], "singular"),
        "three intrinsics": ([depth, "--intrinsics", "1", "2", "3"], "got 3 values"),
        "left-handed pose": ([*metric, "--camera-pose", str(folder / "left.npy")], "right-handed"),
        "sheared pose": ([*metric, "--camera-pose", str(folder / "shear.npy")], "shear"),
        "no plane": ([str(folder / "ball.npy")], "no table found"),
        "unknown class": ([view, "--object-class", "teapot"], "'teapot'"),
        "unknown object": ([view, "--instance", "77"], "no object 77"),
        "region upside down": ([view, "--region", "0", "0", "1", "1", "1", "0"], "lower <= upper"),
        "broken weights": ([view, "--weights", str(folder / "broken.safetensors")], "broken.safetensors"),
        "weights of another configuration": (
            [view, "--weights", str(folder / "other.safetensors")],
            "of another shape",
        ),
        "unknown gripper": ([view, "--gripper", "tweezers"], "'tweezers'"),
        "table of a cloud levelled": ([str(folder / "ball.npy"), "--level-table"], "--level-table is for depth images"),
        "table levelled without its height": ([*metric, "--level-table"], "give camera_pose and table_height"),
        "no threads": ([view, "--threads", "0"], "threads must be at least 1 and at most 256, got 0"),
        "score above 1": ([view, "--min-score", "3"], "at least 0 and at most 1, got 3"),
    }


CASES = (
    *("no such file", "empty cloud", "all-NaN cloud", "fewer than 100 points", "no plane"),
    *("depth of the wrong shape", "millimetres taken for metres", "scale 0"),
    *("singular intrinsics", "three intrinsics", "left-handed pose", "sheared pose"),
    *("unknown class", "unknown object", "region upside down", "unknown gripper"),
    *("broken weights", "weights of another configuration"),
    *("table of a cloud levelled", "table levelled without its height", "no threads", "score above 1"),
)


def test_all_bad_inputs_are_tried(files):
    assert set(CASES) == set(bad_inputs(files))


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_one_line_that_names_it_and_no_folder(files, tmp_path, capsys, case):
    arguments, named = bad_inputs(files)[case]
    given = {word for word in arguments if word.startswith("--")}
    defaults = [] if "--weights" in given else ["--weights", str(files / "tiny.safetensors")]
    assert main(["predict", *arguments, *defaults, *QUICK[:5], "--out", str(tmp_path / "out")]) == 2
    err = capsys.readouterr().err
    assert err.startswith("error: ")
    assert err.count("\n") == 1
    assert named in err
    assert list(tmp_path.iterdir()) == []


def test_a_bad_input_ends_the_process_with_2_and_without_traceback(files):
    command = [sys.executable, "-m", "icgnet.cli.main", "predict", str(files / "nowhere.png")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert done.stdout == ""
    assert done.stderr.startswith("error: no such input file")


def test_a_folder_of_somebody_else_is_refused_before_anything_is_computed(files, tmp_path, capsys):
    (tmp_path / "thesis.tex").write_text("")
    assert main(["predict", str(files / "nowhere.png"), "--out", str(tmp_path)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (tmp_path / "thesis.tex").exists()


def test_no_half_written_folder_stays_when_the_picture_fails(files, tmp_path, monkeypatch):
    def full(*_: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr("icgnet.viewer.picture.draw_prediction", full)
    assert predict(files, "view.npz", "--out", str(tmp_path / "out")) == 2
    assert list(tmp_path.iterdir()) == []


def test_a_class_that_is_not_there_is_said_with_those_that_are(files, tmp_path, capsys):
    path = tmp_path / "all.json"
    assert predict(files, "view.npz", "--json", str(path), "--frame", "base_link") == 0
    result = json.loads(path.read_text())
    assert result["frame_id"] == "base_link"
    seen = {item["class_name"] for item in result["objects"]}
    missing = sorted(set(result["classes"]) - seen)[0]
    capsys.readouterr()
    assert predict(files, "view.npz", "--json", "-", "--object-class", missing) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["grasps"] == []
    assert f"no {missing} is seen, but {', '.join(sorted(seen))}" in said.err
