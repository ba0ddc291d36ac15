"""Instance metrics on labels of which the answer is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from box_objects import predicted as predicted_scene
from icgnet.benchmark.segmentation import (
    FEWEST_POINTS,
    Labelling,
    SceneMasks,
    compare_masks,
    label_overlaps,
    labelling,
    panoptic_quality,
    summarise,
)
from icgnet.benchmark.true_shapes import NamedObject
from icgnet.cli.main import main
from icgnet.errors import InputError
from icgnet.objects.classes import CLASSES


def labels(**counts: int) -> np.ndarray:
    """So many points of each label; `none` stands for -1, `a0` for 0 and so on, repeated names in pieces."""
    return np.concatenate([np.full(count, -1 if name == "none" else int(name[1:])) for name, count in counts.items()])


def truth(points: np.ndarray, *classes: str) -> tuple[np.ndarray, tuple[NamedObject, ...]]:
    """Whose the points are, and what stands there."""
    return points, tuple(NamedObject(f"object_{index}", name) for index, name in enumerate(classes))


def found(points: np.ndarray, *objects: tuple[str, float]) -> Labelling:
    return Labelling(points, tuple(name for name, _ in objects), np.array([score for _, score in objects]))


@pytest.fixture
def perfect() -> SceneMasks:
    points = labels(a0=100, b1=200)
    return compare_masks(0, found(points, ("box", 0.9), ("mug", 0.8)), *truth(points, "box", "mug"))


def test_a_perfect_answer_scores_100_everywhere(perfect):
    numbers = summarise([perfect])
    for name in ("instance_miou", "ap50", "pq", "sq", "rq", "class_pq", "class_accuracy"):
        assert numbers.scores[name].mean == pytest.approx(100.0), name
    assert numbers.confusion["box"]["box"] == numbers.confusion["mug"]["mug"] == 1
    assert sum(sum(row.values()) for row in numbers.confusion.values()) == 2


def test_two_objects_merged_into_one_are_one_match_and_one_miss():
    points = labels(a0=120, b1=80)
    numbers = summarise([compare_masks(0, found(np.zeros(200, int), ("box", 0.9)), *truth(points, "box", "box"))])
    assert numbers.scores["sq"].mean == pytest.approx(60.0)
    assert numbers.scores["rq"].mean == pytest.approx(100 / 1.5)
    assert numbers.scores["pq"].mean == numbers.scores["class_pq"].mean == pytest.approx(40.0)
    assert numbers.scores["ap50"].mean == pytest.approx(50.0)
    assert numbers.scores["instance_miou"].mean == pytest.approx(50.0)  # 0.6 and 0.4
    assert numbers.confusion["box"]["missed"] == 1


def test_an_object_in_two_pieces_is_one_match_and_one_invention():
    predicted = found(labels(a0=70, b1=30), ("box", 0.5), ("ball", 0.9))
    numbers = summarise([compare_masks(0, predicted, *truth(labels(a0=100), "box"))])
    assert numbers.scores["pq"].mean == pytest.approx(100 * 0.7 / 1.5)
    # The wrong piece is the surer one, so the right one comes with precision 1/2.
    assert numbers.scores["ap50"].mean == pytest.approx(50.0)
    assert numbers.confusion["invented"]["ball"] == 1


def test_objects_are_ranked_by_their_own_score_and_not_by_that_of_their_class():
    points = labels(a0=70, b1=30)
    pieces = predicted_scene([trimesh.Trimesh()] * 2, np.zeros((100, 3)), points)
    sure_of_class = (replace(pieces.objects[0], score=0.9, class_score=0.3), replace(pieces.objects[1], score=0.4))
    answer = labelling(replace(pieces, objects=sure_of_class))
    assert answer.scores.tolist() == [0.9, 0.4]
    # The right piece is the surer one, so that the wrong one costs nothing.
    assert summarise([compare_masks(0, answer, *truth(labels(a0=100), "box"))]).scores["ap50"].mean == pytest.approx(
        100.0
    )


def test_a_wrong_class_costs_class_quality_only(perfect):
    points = labels(a0=100, b1=200)
    wrong = compare_masks(0, found(points, ("box", 0.9), ("can", 0.8)), *truth(points, "box", "mug"))
    numbers = summarise([wrong])
    assert numbers.scores["pq"].mean == pytest.approx(100.0)
    assert numbers.scores["class_accuracy"].mean == pytest.approx(50.0)
    assert numbers.scores["class_pq"].mean == pytest.approx(100 / 3)  # box right; mug missed; can invented
    assert numbers.confusion["mug"]["can"] == 1
    both = summarise([perfect, wrong])
    assert both.scores["class_accuracy"].mean == pytest.approx(75.0)
    assert both.scores["class_accuracy"].std == pytest.approx(25.0)


def test_the_class_that_an_object_could_have_had_as_well_counts_apart():
    points = labels(a0=FEWEST_POINTS - 1, b1=100, c2=200, d3=300)  # the first one is hardly seen, so not asked for
    real = (("hidden", "ball"), ("tub", "cylindric", "can"), ("tin", "box", "can"), ("cup", "mug"))
    answer = found(points, ("ball", 0.9), ("can", 0.9), ("ball", 0.8), ("mug", 0.7))
    numbers = summarise([compare_masks(0, answer, points, tuple(NamedObject(*each) for each in real))])
    assert numbers.by_object == {"cup": {"mug": 1}, "tin": {"ball": 1}, "tub": {"can": 1}}
    assert numbers.scores["class_accuracy"].mean == pytest.approx(100 / 3)
    assert numbers.scores["class_accuracy_alternative"].mean == pytest.approx(200 / 3)


def test_answers_are_counted_by_object(perfect):
    missed = compare_masks(1, found(labels(none=100)), *truth(labels(a0=100), "box"))
    assert summarise([perfect, missed]).by_object == {"object_0": {"box": 1, "missed": 1}, "object_1": {"mug": 1}}


def test_noise_points_and_hardly_seen_objects_are_not_asked_for():
    points = labels(a0=100, b1=FEWEST_POINTS - 1, none=50)
    everything = found(labels(a0=100, b1=FEWEST_POINTS - 1, c2=50), ("box", 0.9), ("mug", 0.8), ("can", 0.8))
    numbers = summarise([compare_masks(0, everything, *truth(points, "box", "mug"))])
    assert numbers.objects == 1
    assert numbers.predicted == 1
    assert numbers.scores["pq"].mean == pytest.approx(100.0)


def test_nothing_found_scores_zero():
    numbers = summarise([compare_masks(0, found(labels(none=100)), *truth(labels(a0=100), "box"))])
    assert numbers.scores["pq"].mean == numbers.scores["ap50"].mean == numbers.scores["instance_miou"].mean == 0.0
    assert numbers.scores["class_accuracy"] is None
    assert numbers.scores["sq"] is None
    assert numbers.confusion["box"]["missed"] == 1


def test_scenes_are_counted_together_and_not_averaged(perfect):
    missed = compare_masks(1, found(labels(none=100)), *truth(labels(a0=100), "box"))
    # Two matches and one miss, in whichever scenes.
    assert panoptic_quality([perfect, missed])[0] == pytest.approx(2 / 2.5)
    numbers = summarise([perfect, missed])
    assert numbers.scores["pq"].low <= numbers.scores["pq"].mean <= numbers.scores["pq"].high


def test_overlaps_leave_out_points_without_an_object():
    overlaps = label_overlaps(np.array([0, 0, 1, -1, 1]), 2, np.array([0, 0, 0, 1, -1]), 2)
    np.testing.assert_allclose(overlaps, [[2 / 3, 0.0], [1 / 3, 0.0]])


@pytest.mark.slow
def test_the_command_prints_tables_and_writes_a_report(tmp_path, capsys):
    arguments = ["--scenes", "1", "--threads", "1", "--out", str(tmp_path)]
    assert main(["benchmark", "segmentation", *arguments]) == 0
    printed = capsys.readouterr().out
    assert "panoptic quality" in printed
    assert "missed" in printed
    report = json.loads((tmp_path / "report.json").read_text())
    assert 30 < report["scores"]["instance_miou"]["mean"] <= 100
    pq, sq, rq = (report["scores"][name]["mean"] for name in ("pq", "sq", "rq"))
    assert pq <= min(sq, rq)
    assert report["settings"]["scene"] == "packed"
    assert len(report["rows"]) == report["scenes"] == 1


def test_objects_of_classes_that_the_weights_do_not_know_count_as_other():
    bottle = NamedObject("pile/jar", "bowl", "bottle")
    assert bottle.known_to(CLASSES) == bottle
    assert bottle.known_to(("bottle", "other")) == NamedObject("pile/jar", "other", "bottle")
    with pytest.raises(InputError, match="nor 'other'; the classes are mug"):
        bottle.known_to(("mug",))
