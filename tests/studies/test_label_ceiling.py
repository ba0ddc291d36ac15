import numpy as np
import pytest

from icgnet.benchmark.statistics import evaluate
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.object_set import load_object_set
from icgnet.studies.config import LabelCeilingConfig
from icgnet.studies.label_ceiling import NUMBERS, outcomes


def test_trials_that_always_end_alike_can_be_known():
    sure = np.tile(np.array([True, False, False, True, False]), (4, 1))
    found = evaluate(NUMBERS, [sure, sure])
    assert (found["f1"], found["top1"], found["undecided"], found["success"]) == (1.0, 1.0, 0.0, 0.4)
    assert (found["scenes"], found["trials"], found["repeats"]) == (2, 10, 4)


def test_coin_tosses_cannot_be_known():
    tosses = np.random.default_rng(0).random((8, 4000)) < 0.5
    found = evaluate(NUMBERS, [tosses])
    # To call every toss a success has precision 1/2 and recall 1.
    assert found["f1"] == pytest.approx(2 / 3, abs=0.02)
    assert found["top1"] == pytest.approx(0.5, abs=0.15)
    assert found["undecided"] > 0.98


def test_a_repeat_does_not_judge_itself():
    repeats = np.zeros((3, 6), dtype=bool)
    repeats[np.arange(3), np.arange(3)] = True
    # Each success is alone in its repeat: the others know nothing of it.
    assert evaluate(NUMBERS, [repeats])["top1"] < 0.2


def test_real_trials_are_neither_certain_nor_random():
    config = LabelCeilingConfig(scenes=3, repeats=3, contacts=6, seed=1)
    found = evaluate(NUMBERS, outcomes(config, "packed", load_object_set("procedural"), load_gripper()))
    assert found["scenes"] == 3
    assert found["trials"] == 3 * 6 * 12
    assert 0.0 < found["success"] < 0.5
    assert 0.5 < found["f1"] <= 1.0


def test_too_few_repeats_are_refused(capsys):
    assert main(["study", "label-ceiling", "--repeats", "2"]) == USAGE_ERROR
    assert "repeats must be at least 3, got 2" in capsys.readouterr().err
