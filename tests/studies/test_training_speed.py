"""Parts of a training step that add up, and FLOPs that a hand count confirms."""

import itertools
import json
import multiprocessing

import pytest
import torch

import icgnet.studies.training_speed as training_speed
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.datagen.config import LabelSettings
from icgnet.datagen.generate import GenerateConfig, generate
from icgnet.network.config import NETWORKS
from icgnet.studies.config import TrainingSpeedConfig
from icgnet.studies.training_speed import (
    BACKWARD,
    BY_HAND,
    FORWARD,
    PARTS,
    STEP,
    WAITING,
    TrainingSpeedNumbers,
    measure,
)
from icgnet.training.config import TRAININGS
from icgnet.training.loop import Trainer
from launch import icgnet_together, output_of


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    generate(folder, GenerateConfig(scene="packed", scenes=1, labels=LabelSettings(contacts=2)))
    return folder


@pytest.fixture(scope="module")
def speed(scenes) -> TrainingSpeedNumbers:
    speed = measure(TrainingSpeedConfig(data=(scenes,), preset="tiny", batch=1, steps=2))
    assert speed is not None
    return speed


def test_every_part_of_a_step_takes_time_and_together_they_are_the_step(speed):
    assert tuple(speed.step_ms) == (*PARTS, STEP)
    for times in speed.step_ms.values():
        assert 0 < times.p10 <= times.median <= times.p90
    assert sum(speed.step_ms[part].mean for part in PARTS) == pytest.approx(speed.step_ms[STEP].mean)
    assert 1e3 / speed.step_ms[STEP].mean == pytest.approx(speed.scenes_per_second)
    assert speed.waiting_share == pytest.approx(speed.step_ms[WAITING].mean / speed.step_ms[STEP].mean)
    assert (speed.steps, speed.batch, speed.threads, speed.processes) == (2, 1, 1, 1)


def test_the_modules_of_the_network_are_timed(speed):
    assert {"sparse", "dense", "refinement"} <= speed.module_ms.keys()
    assert all(times.p10 > 0 for times in speed.module_ms.values())


def test_a_module_that_a_step_does_not_call_took_no_time_there():
    found = training_speed._quantiles([{"dense": 2.0}, {"dense": 4.0, "grasps": 1.0}], 10.0)
    assert {name: times.mean for name, times in found.items()} == {"dense": 30.0, "grasps": 5.0}


def test_the_loader_has_a_process_of_its_own_even_if_the_preset_has_none(speed):
    assert TRAININGS["tiny"].workers == 0
    assert speed.workers == 1
    assert speed.loader.visits == 2


def test_no_process_of_the_loader_is_forked_after_rays_were_traced_here(scenes, monkeypatch):
    # It could wait for ever for threads that the fork does not have.
    events = []
    make_batches, time_visits = Trainer.batches, training_speed.time_visits
    monkeypatch.setattr(Trainer, "batches", lambda trainer: events.append("fork") or make_batches(trainer))

    def trace(dataset, visits):
        events.append(f"rays beside {len(multiprocessing.active_children())} processes")
        return time_visits(dataset, visits)

    monkeypatch.setattr(training_speed, "time_visits", trace)
    measure(TrainingSpeedConfig(data=(scenes,), preset="tiny", batch=1, steps=1))
    assert events == ["fork", "rays beside 0 processes"]


def grid_products(preset: str) -> int:
    """Multiply-adds of the dense U-Net's convolutions, from its widths."""
    network = NETWORKS[preset]
    widths, cells = network.dense_widths, [30**3, 15**3, 8**3, 4**3]
    pairs = [
        ((source, max(target // 2, source), target), size)
        for source, target, size in zip((network.dense_channels, *widths[:-1]), widths, cells, strict=True)
    ]
    pairs += [
        ((below + skip, skip, skip), size)
        for (below, skip), size in zip(itertools.pairwise(widths[::-1]), cells[-2::-1], strict=True)
    ]
    return sum(27 * size * (a * b + b * c) for (a, b, c), size in pairs)


def test_the_dense_network_has_the_flops_that_its_sizes_say(speed):
    assert speed.module_gflop["dense"].mean == pytest.approx(2e-9 * grid_products("tiny"), rel=1e-6)


def test_the_backward_pass_has_about_twice_the_flops_of_the_forward_pass(speed):
    forward, backward, whole = (speed.step_gflop[name] for name in (FORWARD, BACKWARD, STEP))
    assert {"sparse", "dense", "refinement"} <= speed.module_gflop.keys()
    assert max(module.mean for module in speed.module_gflop.values()) < forward.mean
    assert 1.5 * forward.mean < backward.mean < 2.1 * forward.mean
    assert whole.mean == pytest.approx(forward.mean + backward.mean)
    assert speed.counted_scenes == 2


def test_what_the_counter_does_not_know_is_counted_by_hand():
    aten = torch.ops.aten
    # Two heads of width 4, 5 queries and 7 tokens: two products of 2 * 5 * 4 * 7 multiply-adds.
    attention = BY_HAND[aten._scaled_dot_product_flash_attention_for_cpu]
    assert attention((1, 2, 5, 4), (1, 2, 7, 4), (1, 2, 7, 4), 0.0) == 2 * 2 * (2 * 5 * 4 * 7)
    # 3 points, 8 rows each, 16 channels, there and back.
    assert BY_HAND[aten._embedding_bag]((1000, 16), (24,)) == 2 * 2 * 3 * 8 * 16


@pytest.mark.slow
def test_the_scenes_of_all_processes_are_counted_and_the_first_alone_reports(scenes, tmp_path):
    command = ["study", "training-speed", "--preset", "tiny", "--steps", 2, "--data", scenes, "--out", tmp_path]
    options = ["--batch", 1, "--accelerator", "cpu", "--common-statistics", False]
    printed = " ".join(output_of(icgnet_together(*command, *options)).split())
    assert printed.count("scenes a second") == 1
    for expected in (*PARTS, "not counted: element-wise"):
        assert expected in printed
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["benchmark"] == "training-speed"
    assert report["step_ms"].keys() == {*PARTS, STEP}
    assert report["step_gflop"][STEP]["mean"] > 0
    assert (report["processes"], report["batch"]) == (2, 1)
    assert report["settings"]["common_statistics"] is False
    # The processes wait for each other, so steps take as long in both; the median of two is their mean.
    assert report["scenes_per_second"] == pytest.approx(2 * 1e3 / report["step_ms"][STEP]["mean"], rel=0.3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--data", "nowhere"], "nowhere"),
        (["--data", "nowhere", "--steps", "0"], "steps must be at least 1, got 0"),
        (["--data", "nowhere", "--threads", "0"], "threads must be at least 1, got 0"),
    ],
)
def test_wrong_use_is_one_line(arguments, message, capsys):
    assert main(["study", "training-speed", *arguments]) == USAGE_ERROR
    assert message in capsys.readouterr().err
