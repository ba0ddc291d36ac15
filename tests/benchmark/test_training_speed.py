"""Parts of a training step that add up, and FLOPs that a hand count confirms."""

import itertools
import json
from dataclasses import replace

import pytest

import icgnet.benchmark.training_speed as training_speed
from icgnet.benchmark.training_speed import (
    BACKWARD,
    DENSE,
    GRASPS,
    OCCUPANCY,
    PARTS,
    QUERIES,
    SEGMENTATION,
    SURFACE,
    Meter,
    TrainingSpeed,
    measure_training,
)
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.datagen.config import LabelSettings
from icgnet.datagen.generate import GenerateConfig, generate
from icgnet.errors import InputError
from icgnet.network.config import NETWORKS
from icgnet.training.config import TRAININGS
from launch import icgnet_together, output_of

TINY = replace(TRAININGS["tiny"], batch=2)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scenes")
    generate(folder, GenerateConfig(scene="packed", scenes=2, labels=LabelSettings(contacts=4)))
    return folder


@pytest.fixture(scope="module")
def speed(scenes) -> TrainingSpeed:
    speed = measure_training([scenes], ["procedural"], TINY, 3)
    assert speed is not None
    return speed


def test_a_part_interrupts_the_one_around_it_and_the_parts_are_the_whole():
    meter = Meter(iter([0.0, 1.0, 3.0, 7.0]).__next__)
    with meter.part("outer"), meter.part("inner"):
        pass
    assert meter.parts == {"outer": 1.0 + 4.0, "inner": 2.0}


def test_every_part_of_a_step_takes_time_and_together_they_are_the_step(speed):
    assert tuple(speed.parts_ms) == PARTS
    for times in speed.parts_ms.values():
        assert 0 < times.p10 <= times.median <= times.p90
    assert sum(times.p10 for times in speed.parts_ms.values()) <= speed.step_ms.p90
    assert sum(times.p90 for times in speed.parts_ms.values()) >= speed.step_ms.p10
    assert 1e3 / speed.step_ms.p90 <= 1.2 * speed.scenes_per_second
    assert 0 < speed.waiting_share < 1
    assert (speed.steps, speed.batch, speed.threads, speed.processes) == (3, 2, 1, 1)


def test_the_loader_has_a_process_of_its_own_even_if_the_preset_has_none(speed):
    assert TINY.workers == 0
    assert speed.workers == 1
    assert speed.loader.visits == 6


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
    assert speed.flops.forward[DENSE] == pytest.approx(2e-9 * grid_products("tiny"), rel=1e-6)


def test_the_backward_pass_has_about_twice_the_flops_of_the_forward_pass(speed):
    forward = sum(speed.flops.forward.values())
    assert {SURFACE, DENSE, QUERIES, SEGMENTATION, OCCUPANCY, GRASPS} >= speed.flops.forward.keys()
    assert {SURFACE, DENSE, QUERIES, OCCUPANCY, GRASPS} <= speed.flops.forward.keys()
    assert 1.5 * forward < speed.flops.backward < 2.1 * forward
    assert speed.flops.total == pytest.approx(forward + speed.flops.backward)
    assert speed.flops.total_p10 <= speed.flops.total <= speed.flops.total_p90 * (1 + 1e-9)
    assert speed.flops.scenes == 6
    assert BACKWARD not in speed.flops.forward


def test_what_the_counter_does_not_know_is_counted_by_hand():
    # Two heads of width 4, 5 queries and 7 tokens: two products of 2 * 5 * 4 * 7 multiply-adds.
    assert training_speed._attention_flop((1, 2, 5, 4), (1, 2, 7, 4), (1, 2, 7, 4)) == 2 * 2 * (2 * 5 * 4 * 7)
    # 3 points, 8 rows each, 16 channels, there and back.
    assert training_speed._weighted_rows_flop((1000, 16), (24,)) == 2 * 2 * 3 * 8 * 16


def test_wrong_use_names_what_is_valid(scenes):
    with pytest.raises(InputError, match="steps must be at least 1, got 0"):
        measure_training([scenes], ["procedural"], TINY, 0)
    with pytest.raises(InputError, match="threads must be at least 1, got 0"):
        measure_training([scenes], ["procedural"], replace(TINY, threads=0), 1)


@pytest.mark.slow
def test_the_command_prints_the_parts_and_writes_a_report(scenes, tmp_path, capsys):
    arguments = ["--data", str(scenes), "--preset", "tiny", "--steps", "1", "--batch", "1", "--out", str(tmp_path)]
    assert main(["benchmark", "training-speed", *arguments]) == 0
    printed = capsys.readouterr().out
    for expected in (*PARTS, "scenes a second", "not counted: element-wise"):
        assert expected in " ".join(printed.split())
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["benchmark"] == "training-speed"
    assert report["parts_ms"].keys() == set(PARTS)
    assert report["flops"]["total"] > 0
    assert report["batch"] == 1
    assert report["settings"]["network"] == "tiny"


@pytest.mark.slow
def test_the_scenes_of_all_processes_are_counted_and_the_first_alone_reports(scenes, tmp_path):
    command = ["benchmark", "training-speed", "--preset", "tiny", "--steps", 2, "--data", scenes, "--out", tmp_path]
    options = ["--batch", 1, "--accelerator", "cpu", "--common-statistics", False]
    assert output_of(icgnet_together(*command, *options)).count("scenes a second") == 1
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["processes"] == 2
    assert report["settings"]["common_statistics"] is False
    # The processes wait for each other, so steps take as long in both; the median of two is their mean.
    assert report["scenes_per_second"] == pytest.approx(2 * 1e3 / report["step_ms"]["median"], rel=0.3)


def test_a_folder_without_scenes_is_one_line(capsys):
    assert main(["benchmark", "training-speed", "--data", "nowhere"]) == USAGE_ERROR
    assert "nowhere" in capsys.readouterr().err
