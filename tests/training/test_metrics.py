import numpy as np
import pytest
import torch

from icgnet.training.metrics import (
    GraspTally,
    average_precision,
    best_f1,
    count_masks,
    count_ranking,
    f1_score,
    mask_iou,
    ranking_precision,
    selection_score,
    summarise,
)


def test_f1_of_a_hand_worked_case():
    predicted = np.array([1, 1, 1, 0, 0], bool)
    labels = np.array([1, 0, 1, 1, 0], bool)
    # Two hits, precision 2/3, recall 2/3.
    assert f1_score(predicted, labels) == pytest.approx(2 / 3)
    assert f1_score(~predicted & False, labels & False) == 0.0


def test_best_f1_finds_the_separating_threshold():
    scores = np.array([0.1, 0.2, 0.33, 0.37, 0.9])
    labels = np.array([0, 0, 0, 1, 1], bool)
    value, threshold = best_f1(scores, labels)
    assert value == 1.0
    assert threshold == pytest.approx(0.35)


def test_average_precision_of_a_hand_worked_case():
    # Sorted by score: right, wrong, right. Three objects, one never found: (1 + 2/3) / 3.
    detections = [(0.9, 0.8), (0.5, 0.7), (0.7, 0.3)]
    assert average_precision(detections, 3) == pytest.approx((1 + 2 / 3) / 3)
    assert average_precision([], 3) == 0.0


def test_ranking_precision_is_one_only_for_a_perfect_order():
    labels = np.array([1, 1, 0, 0], bool)
    assert ranking_precision(np.array([0.9, 0.8, 0.2, 0.1]), labels) == 1.0
    assert ranking_precision(np.array([0.1, 0.2, 0.8, 0.9]), labels) == pytest.approx(0.5)


def test_mask_iou_of_a_hand_worked_case():
    first = torch.tensor([[1, 1, 0, 0], [0, 0, 0, 0]], dtype=torch.bool)
    second = torch.tensor([[1, 1, 1, 0], [0, 0, 1, 1]], dtype=torch.bool)
    torch.testing.assert_close(mask_iou(first, second), torch.tensor([[2 / 3, 0.0], [0.0, 0.0]]))


def test_second_prediction_of_the_same_object_is_wrong():
    masks = torch.tensor([[1, 1, 1, 1]], dtype=torch.bool)
    predicted = torch.tensor([[1, 1, 1, 0], [1, 1, 1, 1]], dtype=torch.bool)
    tally = GraspTally()
    count_masks(tally, (predicted, torch.tensor([0.6, 0.9])), masks)
    assert tally.mask_ious == [1.0]
    assert [overlap for _, overlap in tally.detections] == [1.0, 0.0]


def test_objects_that_nobody_found_count_as_zero():
    tally = GraspTally(instances=2)
    nothing = (torch.zeros(0, 4, dtype=torch.bool), torch.zeros(0))
    count_masks(tally, nothing, torch.ones(2, 4, dtype=torch.bool))
    metrics = summarise(tally)
    assert metrics["instance_miou"] == 0.0
    assert metrics["instance_ap50"] == 0.0


def test_union_of_shapes_is_pooled_over_scenes():
    metrics = summarise(GraspTally(scene_overlap=[(1, 2), (3, 6)], shape_ious=[0.5, 1.0]))
    assert metrics["occupancy_scene_iou"] == pytest.approx(0.5)
    assert metrics["occupancy_iou"] == pytest.approx(0.75)


def test_calibration_error_and_the_best_scores_are_reported():
    scores = np.array([0.8] * 10, np.float32)
    labels = np.arange(10) < 5
    metrics = summarise(GraspTally(scores=[scores], labels=[labels], seen=[~labels], top_1_scores=[0.7, 0.9]))
    assert metrics["grasp_ece"] == pytest.approx(0.3)
    assert metrics["grasp_top1_score"] == pytest.approx(0.8)


def test_the_best_grasp_counts_and_whether_any_could_have_succeeded():
    tally = GraspTally()
    count_ranking(tally, torch.tensor([0.2, 0.9, 0.5]), torch.tensor([False, True, False]))
    count_ranking(tally, torch.tensor([0.2, 0.9, 0.5]), torch.tensor([True, False, False]))
    count_ranking(tally, torch.tensor([0.3, 0.1]), torch.tensor([False, False]))
    count_ranking(tally, torch.zeros(0), torch.zeros(0, dtype=torch.bool))
    metrics = summarise(tally)
    assert metrics["grasp_top1_precision"] == pytest.approx(1 / 3)
    assert metrics["grasp_top1_possible"] == pytest.approx(2 / 3)
    assert metrics["grasp_top1_score"] == pytest.approx((0.9 + 0.9 + 0.3) / 3)


def test_the_sum_of_tallies_is_the_tally_of_all_scenes():
    first, second, both = GraspTally(scenes=1), GraspTally(scenes=2, instances=3), GraspTally(scenes=3, instances=3)
    for parts in ((first, both), (second, both)):
        for tally in parts:
            count_ranking(tally, torch.tensor([0.2, 0.9]), torch.tensor([parts[0] is first, False]))
    assert vars(first + second) == vars(both)


def test_better_grasps_are_selected():
    worse = {"grasp_best_f1": 0.6, "grasp_average_precision": 0.5}
    assert selection_score(worse | {"grasp_average_precision": 0.6}) > selection_score(worse)
