"""Simulated captures."""

from pathlib import Path

import numpy as np
import pytest

from icgnet.cli.demo import FOLDER
from icgnet.cli.main import main
from icgnet.geometry.camera import unproject
from icgnet.geometry.transforms import transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.objects.kinds import Kind
from icgnet.objects.object_set import load_object_set
from icgnet.sensors.capture import SimulatedCapture, simulate_capture


@pytest.fixture(scope="module")
def capture() -> SimulatedCapture:
    return simulate_capture("packed", load_object_set("procedural"), "test", np.random.default_rng(1), objects=2)


def test_table_pixels_lie_on_the_table_up_to_the_noise(capture: SimulatedCapture) -> None:
    on_table = (capture.ids == -2) & (capture.depth > 0)
    points = transform_points(capture.camera_pose, unproject(capture.depth, capture.intrinsics)[on_table])
    heights = points[:, 2] - TABLE_HEIGHT
    assert abs(np.median(heights)) < 0.001
    assert 0.0001 < heights.std() < 0.02


def test_every_object_has_a_class_and_the_larger_ones_are_seen(capture: SimulatedCapture) -> None:
    assert len(capture.classes) == len(capture.scene.objects)
    assert set(np.unique(capture.ids[capture.ids >= 0])) <= set(range(len(capture.classes)))
    assert (capture.ids >= 0).sum() > 500


def test_the_same_seed_gives_the_same_capture(capture: SimulatedCapture) -> None:
    again = simulate_capture("packed", load_object_set("procedural"), "test", np.random.default_rng(1), objects=2)
    np.testing.assert_array_equal(again.depth, capture.depth)
    np.testing.assert_array_equal(again.ids, capture.ids)


def test_simulate_writes_what_predict_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--out", str(tmp_path / "scene.npz"), "--count", "1", "--seed", "3"]) == 0
    with np.load(tmp_path / "scene.npz") as saved:
        assert saved["depth"].shape == (480, 640)
        assert saved["K"].shape == (3, 3)
        assert saved["camera_pose"].shape == (4, 4)
    assert "on the table" in capsys.readouterr().out


def test_simulate_names_a_wrong_file_kind(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "--out", str(tmp_path / "scene.png")]) == 2
    assert "scene.png" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "kind", "count"), [("demo", "packed", 5), ("table", "table", 14)])
def test_objects_of_the_bundled_captures_are_not_trained_on(name: str, kind: Kind, count: int) -> None:
    objects = load_object_set("procedural")
    bundled = simulate_capture(kind, objects, "test", np.random.default_rng(4), count)
    with np.load(FOLDER / f"{name}.npz") as saved:
        # Not the depth itself: another processor may let the objects settle a hair differently.
        assert tuple(saved["classes"]) == bundled.classes
    assert not {placed.name for placed in bundled.scene.objects} & set(objects.names(kind, "train"))
