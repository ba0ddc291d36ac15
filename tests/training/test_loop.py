import json
import math
import multiprocessing
import os
import shutil
import signal
from dataclasses import replace

import pytest
import torch

from icgnet.errors import DataError, InputError, TrainingDivergedError
from icgnet.network.weights import load_weights
from icgnet.parallel.lock import locked
from icgnet.training.checkpoint import CHECKPOINT_FILE, WeightAverage, read_checkpoint
from icgnet.training.config import TRAININGS, LossWeights, MatchingCosts, Sampling, TrainingConfig
from icgnet.training.loop import BEST_FILE, FINAL_FILE, METRICS_FILE, Trainer
from icgnet.viewer.training_curves import read_run

CONFIG = replace(
    TRAININGS["tiny"],
    steps=4,
    sampling=Sampling(occupancy_points=64, contacts=8, half_resolution=1.0),
    log_seconds=0.0,
)


def state_of(out):
    return torch.load(out / CHECKPOINT_FILE, weights_only=True)


def assert_same_weights(first, second):
    for part in ("network", "average"):
        for name, value in first[part].items():
            assert torch.equal(value, second[part][name]), f"{part} {name}"


def test_resumed_run_equals_a_continuous_one_bit_for_bit(train_shapes, tmp_path):
    train_shapes(CONFIG, tmp_path / "whole")
    train_shapes(CONFIG, tmp_path / "legs", leg_steps=3)
    assert state_of(tmp_path / "legs")["progress"]["step"] == 3
    train_shapes(CONFIG, tmp_path / "legs")
    whole, legs = state_of(tmp_path / "whole"), state_of(tmp_path / "legs")
    assert whole["progress"]["finished"]
    assert_same_weights(whole, legs)


def test_other_seed_trains_another_network(train_shapes, tmp_path):
    for seed in (0, 1):
        train_shapes(replace(CONFIG, steps=1, seed=seed), tmp_path / str(seed))
    with pytest.raises(AssertionError):
        assert_same_weights(state_of(tmp_path / "0"), state_of(tmp_path / "1"))


@pytest.mark.slow
def test_worker_processes_do_not_change_the_training(train_shapes, tmp_path):
    config = replace(CONFIG, steps=2)
    train_shapes(config, tmp_path / "none")
    train_shapes(replace(config, workers=2), tmp_path / "two")
    assert_same_weights(state_of(tmp_path / "none"), state_of(tmp_path / "two"))


def test_run_leaves_log_and_weights(train_shapes, tmp_path):
    metrics = train_shapes(replace(CONFIG, steps=2, validation_minutes=0.0), tmp_path)
    lines = [json.loads(line) for line in (tmp_path / METRICS_FILE).read_text().splitlines()]
    assert {line["kind"] for line in lines} == {"train", "val"} == {line["kind"] for line in read_run(tmp_path).lines}
    assert all(
        {"loss", "grasp", "scenes_per_s", "waiting_share"} <= line.keys() for line in lines if line["kind"] == "train"
    )
    assert "grasp_best_f1" in metrics
    for name in (BEST_FILE, FINAL_FILE):
        network, metadata = load_weights(tmp_path / name)
        assert network.config.name == "tiny"
        assert metadata["step"] >= 1


def test_finished_run_says_so_and_stays(train_shapes, tmp_path):
    config = replace(CONFIG, steps=1)
    train_shapes(config, tmp_path)
    before = state_of(tmp_path)
    lines = []
    train_shapes(config, tmp_path, report=lines.append)
    assert any("finished" in line for line in lines)
    assert_same_weights(before, state_of(tmp_path))


def test_best_weights_stay_when_a_run_is_killed_before_its_next_checkpoint(train_shapes, tmp_path, monkeypatch):
    scores = iter([{"grasp_best_f1": 0.1}, {"grasp_best_f1": 0.9}, {"grasp_best_f1": 0.5}, {"grasp_best_f1": 0.4}])
    monkeypatch.setattr("icgnet.training.loop.evaluate", lambda *_: next(scores))
    config = replace(CONFIG, steps=3, validation_minutes=0.0)
    train_shapes(config, tmp_path, leg_steps=1)
    checkpoint = (tmp_path / CHECKPOINT_FILE).read_bytes()
    train_shapes(config, tmp_path, leg_steps=1)
    best = (tmp_path / BEST_FILE).read_bytes()
    (tmp_path / CHECKPOINT_FILE).write_bytes(checkpoint)
    train_shapes(config, tmp_path, leg_steps=1)
    assert (tmp_path / BEST_FILE).read_bytes() == best


def test_the_log_holds_each_step_once_after_a_kill(train_shapes, tmp_path):
    config = replace(CONFIG, steps=3)
    train_shapes(config, tmp_path, leg_steps=1)
    with (tmp_path / METRICS_FILE).open("a") as file:
        # Written after the checkpoint, and one more that was cut off.
        file.write('{"kind": "train", "step": 2, "loss": null}\n{"kind": "train", "ste')
    train_shapes(config, tmp_path)
    lines = [json.loads(line) for line in (tmp_path / METRICS_FILE).read_text().splitlines()]
    assert [line["step"] for line in lines if line["kind"] == "train"] == [1, 2, 3]
    assert all(line["loss"] is not None for line in lines if line["kind"] == "train")


def test_a_log_without_a_checkpoint_is_set_aside(train_shapes, tmp_path):
    config = replace(CONFIG, steps=1)
    (tmp_path / METRICS_FILE).write_text('{"kind": "train", "step": 5}\n')
    lines = []
    train_shapes(config, tmp_path, report=lines.append)
    assert any("beginning anew; the log is now metrics-1.jsonl" in line for line in lines)
    assert '"step": 5' in (tmp_path / "metrics-1.jsonl").read_text()
    assert '"step": 5' not in (tmp_path / METRICS_FILE).read_text()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
def test_an_interrupted_run_writes_a_checkpoint_and_goes_on(train_shapes, tmp_path, number):
    config, lines = replace(CONFIG, steps=3), []

    def interrupt(line):
        lines.append(line)
        if line.startswith("kind train step 1"):
            os.kill(os.getpid(), number)

    handler = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt):
        train_shapes(config, tmp_path, report=interrupt)
    assert lines[-1] == "interrupted; the same command goes on from step 1"
    assert state_of(tmp_path)["progress"]["step"] == 1
    assert signal.getsignal(number) is handler
    train_shapes(config, tmp_path, report=lines.append)
    assert "going on from step 1" in lines
    assert state_of(tmp_path)["progress"]["finished"]


def test_a_signal_during_the_last_validation_changes_nothing(train_shapes, tmp_path, monkeypatch):
    def interrupted(network, samples, matching):
        os.kill(os.getpid(), signal.SIGTERM)
        return {"score": 1.0}

    monkeypatch.setattr("icgnet.training.loop.evaluate", interrupted)
    monkeypatch.setattr("icgnet.training.loop.selection_score", lambda metrics: metrics["score"])
    lines = []
    metrics = train_shapes(replace(CONFIG, steps=1), tmp_path, report=lines.append)
    assert metrics == {"score": 1.0}
    assert not any("interrupted" in line for line in lines)
    assert state_of(tmp_path)["progress"]["finished"]


def test_two_runs_into_one_folder_are_one_clear_error(train_shapes, tmp_path):
    with locked(tmp_path), pytest.raises(DataError, match=r"process \d+ on .* is writing into this folder"):
        train_shapes(CONFIG, tmp_path)


def test_the_run_says_in_how_many_bits_it_computes(train_shapes, tmp_path):
    lines = []
    train_shapes(replace(CONFIG, steps=2, precision="bfloat16"), tmp_path, report=lines.append, leg_steps=1)
    assert lines[0] == "computing on cpu in bfloat16 (precision bfloat16), threads 1"
    train_shapes(replace(CONFIG, steps=2, precision="float32"), tmp_path, report=lines.append)
    assert "going on with another setting: training.precision: bfloat16 there, float32 now" in lines


def test_a_run_that_diverges_says_so(train_shapes, tmp_path):
    with pytest.raises(TrainingDivergedError, match=r"20 steps in a row.*lower the learning rate \(1e\+30\)"):
        train_shapes(replace(CONFIG, steps=60, batch=1, learning_rate=1e30, warmup_steps=0), tmp_path)


def test_a_step_that_computes_nan_changes_nothing(train_shapes, tmp_path, monkeypatch):
    forward = Trainer.forward

    def nan_in_the_third(trainer, samples):
        if trainer.progress.step == 2:
            samples = [replace(each, input=replace(each.input, dense=each.input.dense * torch.nan)) for each in samples]
        return forward(trainer, samples)

    monkeypatch.setattr(Trainer, "forward", nan_in_the_third)
    train_shapes(CONFIG, tmp_path, leg_steps=2)
    before = state_of(tmp_path)
    train_shapes(CONFIG, tmp_path, leg_steps=1)
    assert_same_weights(before, state_of(tmp_path))
    train_shapes(CONFIG, tmp_path)
    lines = [line for line in read_run(tmp_path).lines if line["kind"] == "train"]
    assert [line["skipped"] for line in lines] == [0, 0, 1, 0]
    assert all(value.isfinite().all() for value in state_of(tmp_path)["average"].values())


def test_folder_of_another_run_is_refused_by_name(train_shapes, tmp_path):
    train_shapes(replace(CONFIG, steps=1), tmp_path)
    with pytest.raises(DataError, match=r"training\.learning_rate: 0\.001 there, 0\.1 now"):
        train_shapes(replace(CONFIG, steps=1, learning_rate=0.1), tmp_path)


def test_how_it_reports_may_change_between_legs(train_shapes, tmp_path):
    train_shapes(replace(CONFIG, steps=2), tmp_path, leg_steps=1)
    train_shapes(replace(CONFIG, steps=2, log_seconds=5.0), tmp_path)
    assert state_of(tmp_path)["progress"]["step"] == 2


def test_more_data_go_on_and_are_named(train_shapes, data, tmp_path):
    config = replace(CONFIG, steps=2)
    train_shapes(config, tmp_path / "run", leg_steps=1)
    shutil.copy(data / "scenes.parquet", data / "more.parquet")
    lines = []
    train_shapes(config, tmp_path / "run", report=lines.append)
    assert "going on with another setting: data.scenes: 4 there, 8 now" in lines


def test_damaged_configuration_is_named(train_shapes, tmp_path):
    train_shapes(CONFIG, tmp_path, leg_steps=1)
    (tmp_path / "config.json").write_text('{"training": ')
    with pytest.raises(DataError, match=r"config\.json is damaged"):
        train_shapes(CONFIG, tmp_path)


def test_damaged_checkpoint_is_named(tmp_path):
    path = tmp_path / CHECKPOINT_FILE
    path.write_bytes(b"not a checkpoint")
    with pytest.raises(DataError, match=CHECKPOINT_FILE):
        read_checkpoint(path)


def test_average_follows_the_weights():
    network = torch.nn.Linear(1, 1, bias=False)
    torch.nn.init.zeros_(network.weight)
    average = WeightAverage(network, 0.5)
    torch.nn.init.ones_(network.weight)
    average.update(network, step=100)
    assert float(average.network.weight) == pytest.approx(0.5)
    average.update(network, step=100)
    assert float(average.network.weight) == pytest.approx(0.75)


def test_training_data_must_be_there(train_shapes, data, tmp_path):
    (data / "manifest.json").unlink()
    with pytest.raises(DataError, match="manifest"):
        train_shapes(CONFIG, tmp_path)


@pytest.mark.parametrize("budget", [{"steps": None, "minutes": None}, {"steps": 5, "minutes": 1.0}])
def test_budget_is_steps_or_minutes(budget):
    with pytest.raises(InputError, match="steps or minutes"):
        TrainingConfig(**budget)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"steps": 0, "minutes": None}, "steps must be at least 1, got 0"),
        ({"minutes": -1.0}, "minutes must be above 0, got -1"),
        ({"minutes": math.nan}, "minutes must be above 0, got nan"),
        ({"batch": 0}, "batch must be at least 1, got 0"),
        ({"threads": 0}, "threads must be at least 1, got 0"),
        ({"workers": -1}, "workers must be at least 0, got -1"),
        ({"learning_rate": 0.0}, "learning_rate must be above 0, got 0"),
        ({"average_decay": 2.0}, "average_decay must be at least 0 and at most 1, got 2"),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_settings_out_of_range_are_named(wrong, message):
    with pytest.raises(InputError, match=message):
        TrainingConfig(**wrong)


@pytest.mark.parametrize(
    ("kind", "wrong", "message"),
    [
        (Sampling, {"tsdf": 1.5}, "tsdf must be at least 0 and at most 1, got 1.5"),
        (Sampling, {"fewest_voxels": 0}, "fewest_voxels must be at least 1, got 0"),
        (Sampling, {"translation": -0.1}, "translation must be at least 0, got -0.1"),
        (LossWeights, {"mask": -1.0}, "mask must be at least 0, got -1"),
        (MatchingCosts, {"dice": math.nan}, "dice must be at least 0, got nan"),
    ],
)
def test_settings_of_samples_and_losses_out_of_range_are_named(kind, wrong, message):
    with pytest.raises(InputError, match=message):
        kind(**wrong)


def test_unknown_network_is_an_input_error():
    with pytest.raises(InputError, match="tiny"):
        TrainingConfig(network="huge")


def test_time_budget_counts_the_time_of_all_legs():
    config = TrainingConfig(minutes=10.0)
    assert config.progress(step=10**6, elapsed=300.0) == pytest.approx(0.5)
    assert config.progress(step=0, elapsed=601.0) == 1.0


@pytest.mark.slow
def test_a_signal_to_the_whole_group_leaves_the_workers_to_the_run(train_shapes, tmp_path):
    config, lines = replace(CONFIG, steps=4, workers=1), []

    def interrupt(line):
        lines.append(line)
        if line.startswith("kind train step 1"):
            for process in (*multiprocessing.active_children(), multiprocessing.current_process()):
                os.kill(process.pid, signal.SIGTERM)

    with pytest.raises(KeyboardInterrupt):
        train_shapes(config, tmp_path, report=interrupt)
    assert lines[-1].startswith("interrupted; the same command goes on from step")
    assert state_of(tmp_path)["progress"]["step"] >= 1
