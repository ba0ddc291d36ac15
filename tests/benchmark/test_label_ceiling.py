import numpy as np
import pytest

from icgnet.benchmark.label_ceiling import ceiling, measure_ceiling
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.errors import InputError
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.object_set import load_object_set


def test_trials_that_always_end_alike_can_be_known():
    sure = np.tile(np.array([True, False, False, True, False]), (4, 1))
    found = ceiling("pile", [sure, sure])
    assert (found.f1, found.top1, found.undecided, found.success) == (1.0, 1.0, 0.0, 0.4)
    assert (found.scenes, found.trials, found.repeats) == (2, 10, 4)


def test_coin_tosses_cannot_be_known():
    tosses = np.random.default_rng(0).random((8, 4000)) < 0.5
    found = ceiling("pile", [tosses])
    # To call every toss a success has precision 1/2 and recall 1.
    assert found.f1 == pytest.approx(2 / 3, abs=0.02)
    assert found.top1 == pytest.approx(0.5, abs=0.15)
    assert found.undecided > 0.98


def test_a_repeat_does_not_judge_itself():
    outcomes = np.zeros((3, 6), dtype=bool)
    outcomes[np.arange(3), np.arange(3)] = True
    # Each success is alone in its repeat: the others know nothing of it.
    assert ceiling("packed", [outcomes]).top1 < 0.2


def test_real_trials_are_neither_certain_nor_random():
    found = measure_ceiling("packed", load_object_set("procedural"), "val", load_gripper(), 3, 3, 6, seed=1)
    assert found.scenes == 3
    assert found.trials == 3 * 6 * 12
    assert 0.0 < found.success < 0.5
    assert 0.5 < found.f1 <= 1.0


def test_too_few_repeats_are_refused(capsys):
    with pytest.raises(InputError, match="got 4 and 2"):
        measure_ceiling("packed", load_object_set("procedural"), "val", load_gripper(), 4, 2)
    assert main(["benchmark", "label-ceiling", "--repeats", "1"]) == USAGE_ERROR
    assert "3 repeats" in capsys.readouterr().err
