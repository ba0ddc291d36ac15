"""Timings that are taken from the right calls."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from icgnet.benchmark.config import LatencyConfig, PictureConfig
from icgnet.benchmark.latency import STAGES, LatencyNumbers, model_size, tables, time_predictions
from icgnet.benchmark.pictures import Picture, take_picture, take_pictures
from icgnet.benchmark.rounds import round_scene
from icgnet.cli.main import main
from icgnet.errors import InputError
from icgnet.geometry.clouds import PointCloud
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.grasp_search import GraspSearch
from icgnet.objects.object_set import load_object_set
from icgnet.predictor import DEFAULT_WEIGHTS, Predictor
from icgnet.simulation.config import WideScenes


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    """The shipped network with a short search."""
    return Predictor.load(search=GraspSearch(contacts=32, max_checked=48, resample=False))


@pytest.fixture(scope="module")
def picture() -> Picture:
    return take_picture(PictureConfig(scenes=1), 0, load_object_set("procedural"), load_gripper())


def without_cloud(picture: Picture) -> Picture:
    nothing = PointCloud(np.zeros((0, 3)), np.zeros(3), "world")
    return replace(picture, observation=replace(picture.observation, cloud=nothing))


class Counted(Predictor):
    """A predictor that counts its calls."""

    calls = 0

    def predict_cloud(self, *args):
        self.calls += 1
        return super().predict_cloud(*args)


@pytest.fixture(scope="module")
def counted(predictor) -> Counted:
    return Counted(predictor.network, search=predictor.search)


@pytest.fixture(scope="module")
def numbers(counted, picture) -> LatencyNumbers:
    return time_predictions(counted, [picture, without_cloud(picture)], 3)


def test_the_first_call_of_each_picture_is_not_timed(numbers, counted):
    assert numbers.calls == 3
    assert counted.calls == 4


def test_stages_and_their_percentiles_are_in_order_and_within_the_whole(numbers, picture):
    assert tuple(numbers.stages_ms) == STAGES
    whole = numbers.whole_ms
    assert whole.p10 <= whole.median <= whole.p90
    for stage, times in numbers.stages_ms.items():
        assert 0 < times.p10 <= times.median <= times.p90
        assert stage == "meshes" or times.median < whole.p90
    assert numbers.points == len(picture.observation.cloud)
    assert (numbers.device, numbers.threads) == ("cpu", torch.get_num_threads())


def test_a_depth_image_has_more_points_than_the_cloud_of_the_objects(numbers, predictor, picture):
    assert time_predictions(predictor, [picture], 1, "depth").points > 3 * numbers.points


def test_every_picture_says_what_it_shows_and_how_long_it_took(numbers, picture):
    (one,) = numbers.pictures
    assert (one.edges, one.standing) == ((0.3, 0.3), len(picture.truth))
    assert (one.points, one.objects) == (numbers.points, numbers.objects)
    assert one.whole_ms == numbers.whole_ms
    _, by_picture = tables(numbers)
    assert by_picture.rows[0][:2] == ("0.30 x 0.30", str(one.standing))


def test_tables_are_as_large_as_is_asked_for():
    config = LatencyConfig(scene="table", scenes=1, wide=WideScenes(objects=(4, 4), table_edge=(0.5, 0.5)))
    (picture,) = take_pictures(config, load_gripper(), config.wide)
    lower, upper = picture.truth.scene.surroundings.bounds
    np.testing.assert_allclose(upper - lower, 0.5, atol=1e-6)
    assert len(picture.truth) <= 4


def test_the_size_counts_every_parameter_and_the_file(predictor):
    size = model_size(predictor.network, DEFAULT_WEIGHTS)
    assert size.parameters == sum(tensor.numel() for _, tensor in predictor.network.named_parameters())
    assert size.bytes == 4 * size.parameters
    # Kernels are stored in 16 bits, the rest in 32.
    assert size.file_bytes == DEFAULT_WEIGHTS.stat().st_size
    assert size.bytes / 2 < size.file_bytes < size.bytes


def test_wrong_use_names_what_is_valid(predictor, picture):
    with pytest.raises(InputError, match="repeats must be at least 1, got 0"):
        LatencyConfig(repeats=0)
    with pytest.raises(InputError, match="none of 1 scenes"):
        time_predictions(predictor, [without_cloud(picture)], 1)


def test_pictures_show_the_scenes_of_the_clutter_benchmark_whatever_the_camera(picture):
    objects, gripper = load_object_set("procedural"), load_gripper()
    other = take_picture(PictureConfig(scenes=7, view="top", noise="dex"), 0, objects, gripper)
    for scene in (other.truth.scene, round_scene(PictureConfig(), 0, 0, objects)):
        for one, two in zip(scene.objects, picture.truth.scene.objects, strict=True):
            assert one.name == two.name
            np.testing.assert_array_equal(one.T_world_object, two.T_world_object)
    assert not np.array_equal(other.observation.T_world_camera, picture.observation.T_world_camera)


@pytest.mark.slow
def test_the_command_prints_stages_and_writes_a_report(tmp_path, capsys):
    arguments = ["--scenes", "1", "--repeats", "1", "--threads", "1", "--out", str(tmp_path)]
    assert main(["benchmark", "latency", *arguments]) == 0
    printed = capsys.readouterr().out
    assert "collision" in printed
    assert "M parameters" in printed
    report = json.loads((tmp_path / "report.json").read_text())
    assert 1 < report["whole_ms"]["median"] < 60_000
    assert list(report["stages_ms"]) == ["input", "encode", "grasps", "collision", "select", "meshes"]
    assert len(report["settings"]["weights"]) == 64
    assert report["threads"] == 1
    size = report["model"]
    assert size["bytes"] == 4 * size["parameters"] > 4e4
    assert size["bytes"] / 2 < size["file_bytes"] < size["bytes"]
