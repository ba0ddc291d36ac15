import json

import numpy as np
import pytest
from PIL import Image

from icgnet.cli.main import USAGE_ERROR, main
from icgnet.sensors.config import CAMERAS
from icgnet.sensors.noise import corrupt_depth
from icgnet.simulation.camera import DepthImage
from icgnet.studies.config import SensorNoiseConfig
from icgnet.studies.sensor_noise import ROWS, measure, tables

CAMERA = CAMERAS["kinect_v2"]


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    """Two frames of a box before a wall; only the first one says by which camera."""
    folder = tmp_path_factory.mktemp("captures")
    depth = np.full(CAMERA.shape, 0.8, np.float32)
    depth[100:300, 150:300] = 0.6
    ids = np.where(depth < 0.7, 0, -2)
    for number, more in enumerate(({"camera": CAMERA.name}, {})):
        noisy = corrupt_depth(DepthImage(depth, ids), CAMERA.intrinsics, CAMERA.noise, np.random.default_rng(number))
        Image.fromarray(np.rint(10000 * noisy.depth).astype(np.uint16)).save(folder / f"box{number}_depth.png")
        Image.fromarray((ids + 2).astype(np.uint8)).save(folder / f"box{number}_labels.png")
        camera = {"K": CAMERA.intrinsics.tolist(), "depth_scale": 10000, **more}
        (folder / f"box{number}.json").write_text(json.dumps(camera))
    return folder


def test_each_camera_gets_images_from_where_its_frames_were_taken(captures):
    numbers = measure(SensorNoiseConfig(captures, images=2))
    (camera,) = numbers.cameras
    assert (camera.name, camera.frames, numbers.left_out) == ("kinect_v2", ("box0",), ("box1",))
    assert len(camera.ours) == 2
    assert camera.real[0].distance == pytest.approx(0.8, abs=0.02)
    for ours in camera.ours:
        assert ours.distance == pytest.approx(0.8, abs=0.2), "a table and some floor"
        assert ours.noise is not None
        assert camera.real[0].noise is not None
        assert 0.3 < ours.noise / camera.real[0].noise < 3.0
    (table,) = tables(numbers)
    assert table.headers == ("kinect_v2", "1 real", "2 simulated")
    assert len(table.rows) == len(ROWS)
    assert table.rows[0][1] == "0.80"
    assert "1 frames" in table.notes[0]


def test_the_command_writes_report_and_picture(captures, tmp_path, capsys):
    arguments = ["--captures", str(captures), "--images", "1", "--out", str(tmp_path / "report")]
    assert main(["study", "sensor-noise", *arguments]) == 0
    assert "raggedness" in capsys.readouterr().out
    report = json.loads((tmp_path / "report" / "report.json").read_text())
    assert report["left_out"] == ["box1"]
    assert report["cameras"]["kinect_v2"]["real"].keys() == {"box0"}
    with Image.open(tmp_path / "report" / "sensor_noise.png") as image:
        assert image.width > 600


def test_frames_without_a_camera_that_we_know_are_one_line(captures, tmp_path, capsys):
    for path in captures.glob("box1*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    assert main(["study", "sensor-noise", "--captures", str(tmp_path)]) == USAGE_ERROR
    error = capsys.readouterr().err
    assert "no frame names its camera" in error
    assert "kinect_v1" in error
    assert error.count("\n") == 1
