from dataclasses import replace

import numpy as np

from icgnet.inference.rejections import REASONS, Rejections
from icgnet.viewer.describe import REASON_WORDS, dropped_text, main_reason
from icgnet.viewer.page.grasps import EVERY_REASON
from icgnet.viewer.page.surroundings import plane_patch
from icgnet.viewer.page.words import grasp_details, header, object_details, object_label, object_line, object_list
from icgnet.viewer.palette import REASON_COLOURS


def test_every_reason_has_a_name_and_those_that_are_drawn_a_colour():
    assert set(REASON_WORDS) == set(REASONS)
    assert set(REASON_COLOURS) == set(REASONS) - {"unchecked"}
    assert len({*REASON_WORDS.values(), EVERY_REASON}) == len(REASONS) + 1


def test_beside_0_grasps_stands_what_was_in_the_way(rejecting_prediction):
    ball, box = rejecting_prediction.objects
    assert object_line(rejecting_prediction, ball) == "0 ball · 3 grasps"
    assert object_line(rejecting_prediction, box) == "1 box · 0 grasps"
    assert object_label(rejecting_prediction, ball) == "0 ball"
    assert object_label(rejecting_prediction, box) == "1 box: 0 grasps"
    assert dropped_text(rejecting_prediction, 1) == "2 would hit measured points (best 0.85), 40 low score (best 0.04)"
    assert dropped_text(rejecting_prediction, 0) == "nothing"
    assert "would hit measured points" in object_list(rejecting_prediction)
    assert "40 low score (best 0.04)" in object_details(rejecting_prediction, box)
    assert "1 object without a grasp" in header(rejecting_prediction)


def test_the_reason_is_that_of_the_grasps_that_came_farthest(rejecting_prediction):
    def with_counts(**counts: int):
        row = [counts.get(name, 0) for name in REASONS]
        dropped = replace(rejecting_prediction.rejections, counts=np.array([row, row]))
        return replace(rejecting_prediction, rejections=dropped)

    assert main_reason(with_counts(low_score=500, table=1, points=3), 0) == "would hit measured points"
    assert main_reason(with_counts(low_score=500, too_wide=1), 0) == "too wide for the hand"
    assert main_reason(with_counts(low_score=500, unchecked=9), 0) == "not checked"
    assert main_reason(with_counts(low_score=500), 1) == "low score, best 0.04"
    assert main_reason(with_counts(), 0) == "not asked for"


def test_what_was_not_asked_for_is_not_explained_by_what_was_dropped(rejecting_prediction):
    of_box = rejecting_prediction.of_instance(1)
    assert main_reason(of_box, 0) == "not asked for"
    assert main_reason(of_box, 1) == "would hit measured points"
    assert main_reason(rejecting_prediction.of_instance(0), 1) == "would hit measured points"
    assert main_reason(rejecting_prediction.in_region(np.full(3, 5.0), np.full(3, 6.0)), 0) == "not asked for"


def test_of_older_folders_it_says_that_the_reasons_are_not_known(rejecting_prediction):
    old = replace(rejecting_prediction, rejections=Rejections.empty())
    assert "predict again" in object_details(old, old.objects[1])
    assert "0 grasps" in object_list(old)


def test_names_cannot_bring_html_onto_the_page(rejecting_prediction):
    item = replace(rejecting_prediction.objects[1], class_name="<script>")
    named = replace(rejecting_prediction, objects=(rejecting_prediction.objects[0], item), frame_id="<b>")
    told = object_list(named) + object_details(named, item) + header(named)
    assert "<script>" not in told + grasp_details(named.grasps, 0, named.frame_id, None)
    assert "<code><b>" not in told


def test_a_grasp_is_told_in_the_frame_of_the_prediction(rejecting_prediction):
    told = grasp_details(rejecting_prediction.grasps, 0, "camera", None)
    assert " ".join(f"{value:.3f}" for value in rejecting_prediction.grasps.poses[0, :3, 3]) in told
    assert "50 / 62 mm" in told
    assert "Rejected: low score" in grasp_details(rejecting_prediction.grasps, 0, "camera", "low score")


def test_a_plane_is_drawn_where_points_lie_on_it():
    rng = np.random.default_rng(0)
    tilted = np.array([0.0, -np.sin(0.2), np.cos(0.2)])
    across = rng.uniform([0.0, 1.0], [0.6, 1.4], (4000, 2))
    points = np.column_stack([across, (0.3 + across[:, 1] * np.sin(0.2)) / np.cos(0.2)])
    patch = plane_patch(np.concatenate([points, rng.uniform(3.0, 4.0, (50, 3))]), tilted, 0.3)
    np.testing.assert_allclose(patch.rotation[:, 2], tilted)
    np.testing.assert_allclose(np.linalg.det(patch.rotation), 1.0)
    np.testing.assert_allclose(patch.size, (0.6, 0.4 / np.cos(0.2)), atol=0.03)
    np.testing.assert_allclose(patch.middle, points.mean(axis=0), atol=0.03)
