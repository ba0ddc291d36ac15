import json

import numpy as np
import pytest

from icgnet.benchmark.statistics import evaluate
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.studies.grasp_scores import NUMBERS, Tried, some_of


def tried(scores, objects, held):
    ends = tuple("held" if each else "missed" for each in held)
    return Tried(np.array(scores), np.array(objects), np.array(held), ends)


def test_the_score_of_the_object_decides_which_grasp_is_first():
    # As a hold 0.9 and 0.8; the first is on something that is hardly an object.
    picture = tried([0.76, 0.27], [0.95, 0.3], [True, False])
    found = evaluate(NUMBERS, [picture])
    assert (found["first"], found["first_alone"]) == (1.0, 0.0)
    assert (found["precision"], found["precision_alone"]) == (1.0, 0.5)
    assert (found["success"], found["possible"], found["first_three"]) == (0.5, 1.0, 0.5)


def test_scores_that_are_true_have_no_error():
    picture = tried([0.75] * 4, [1.0] * 4, [True, True, True, False])
    assert evaluate(NUMBERS, [picture])["error"] == 0.0
    assert evaluate(NUMBERS, [tried([0.3], [1.0], [True])])["error"] is None, "none is called good"


def test_the_best_the_best_of_each_object_and_some_others_are_tried():
    instances = np.array([0] * 40 + [1] * 5 + [2] * 5)
    rows = some_of(instances, 6, np.random.default_rng(0))
    assert set(range(6)) <= set(rows)
    assert {40, 45} <= set(rows)
    assert len(rows) > 10
    assert (np.diff(rows) > 0).all()
    assert some_of(np.zeros(1, dtype=int), 6, np.random.default_rng(0)).tolist() == [0]


def test_grasps_of_a_picture_are_tried(tmp_path, capsys):
    quick = ["--search.contacts", "64", "--search.per-object", "2", "--search.no-resample"]
    words = ["study", "grasp-scores", "--scene", "packed", "--noise", "none", "--pictures", "1", "--grasps", "2"]
    assert main([*words, *quick, "--out", str(tmp_path)]) == 0
    assert "success of the first grasp of a picture" in capsys.readouterr().out
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["tried"] == sum(report["causes"].values()) >= 2
    assert 0.0 <= report["scores"]["success"]["mean"] <= 1.0


@pytest.mark.parametrize("name", ["--pictures", "--grasps"])
def test_nothing_to_try_is_refused(name, capsys):
    assert main(["study", "grasp-scores", name, "0"]) == USAGE_ERROR
    assert "must be at least 1, got 0" in capsys.readouterr().err
