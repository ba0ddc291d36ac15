"""The numbers of real frames, on masks of which the answer is known."""

import json
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from icgnet.benchmark.capture_scores import FrameScores, kinds_of, overlap, score, support_plane
from icgnet.benchmark.captures import predict, summarise, tables
from icgnet.benchmark.config import EVERY, IN_CLICKS, IN_LABELS, CapturesConfig
from icgnet.benchmark.labelled_frames import LabelledFrame
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.errors import InputError
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import make_transform
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.grasp_search import GraspSearch
from icgnet.inference.prediction import DetectedObject, Prediction
from icgnet.objects.classes import CLASSES
from icgnet.predictor import Predictor
from labelled_scenes import DEPTH, LABELS, T_CAMERA_TABLE, clicks, frame, pixels_on, write_frame
from tabletop_scenes import tiny_network

PERFECT = LABELS - 1
"""The mask of a predictor that is always right."""


def answer(
    mask: np.ndarray, classes: tuple[str, ...] = ("box",) * 3, grasped: tuple[int, ...] = (), T=T_CAMERA_TABLE
) -> Prediction:
    """A prediction with these instances, one grasp for each number in `grasped`, and this table."""
    rows = np.flatnonzero(DEPTH > 0)
    count = len(grasped)
    poses = np.tile(make_transform(np.eye(3), np.array([0.0, 0.0, 0.4])), (count, 1, 1))
    numbers = np.full(count, 0.05)
    points = np.zeros((len(rows), 3))
    return Prediction(
        objects=tuple(
            DetectedObject(k, 0.8, name, 0.9, points[:1], lambda: pytest.fail("no mesh is needed"))
            for k, name in enumerate(classes)
        ),
        grasps=Grasps(poses, numbers, numbers, numbers, np.array(grasped, int), poses[:, :3, 3], np.zeros(count, int)),
        frame_id="camera",
        rejected={},
        timings_ms={},
        cloud=PointCloud(points, None, "camera"),
        cloud_instances=mask.ravel()[rows],
        T_frame_table=T,
        gripper=load_gripper(),
        classes=CLASSES,
        input_rows=rows,
        input_shape=mask.shape,
    )


def square(*corners: tuple[int, int, int]) -> np.ndarray:
    """Labels of 100 x 100 pixels with squares of 20 pixels: label, top and left."""
    labels = np.zeros((100, 100), dtype=np.int64)
    for label, top, left in corners:
        labels[top : top + 20, left : left + 20] = label
    return labels


def test_a_perfect_mask_scores_one_everywhere():
    labels = square((1, 10, 10), (2, 60, 60))
    numbers = overlap(labels, labels)
    assert (numbers.precision, numbers.recall, numbers.f, numbers.boundary_f) == (1, 1, 1, 1)
    assert numbers.best == (1, 1)


def test_the_numbers_of_predicted_objects_do_not_matter():
    assert overlap(square((2, 10, 10), (1, 60, 60)), square((1, 10, 10), (2, 60, 60))).f == 1


def test_half_an_object_has_full_precision_and_half_the_recall():
    labels = square((1, 10, 10))
    half = labels.copy()
    half[:, 20:] = 0
    numbers = overlap(half, labels)
    assert (numbers.precision, numbers.recall) == (1, 0.5)
    assert numbers.f == pytest.approx(2 / 3)
    assert numbers.best == pytest.approx((2 / 3,))
    # Three of the four sides are where they belong, but for the cut ends of two of them.
    assert 0.4 < numbers.boundary_f < 0.8


def test_pixels_of_false_objects_cost_precision_and_missed_ones_recall():
    numbers = overlap(square((1, 10, 10), (2, 60, 10)), square((1, 10, 10), (2, 60, 60)))
    assert (numbers.precision, numbers.recall, numbers.f, numbers.boundary_f) == (0.5, 0.5, 0.5, 0.5)
    assert sorted(numbers.best) == [0, 1]


def test_two_objects_in_one_are_matched_once():
    merged = np.minimum(square((1, 10, 10), (2, 10, 30)), 1)
    numbers = overlap(merged, square((1, 10, 10), (2, 10, 30)))
    assert (numbers.precision, numbers.recall) == (0.5, 0.5)
    assert sorted(numbers.best) == pytest.approx([0, 2 / 3])


def test_nothing_found_scores_zero():
    numbers = overlap(square(), square((1, 10, 10)))
    assert (numbers.precision, numbers.recall, numbers.f, numbers.boundary_f, numbers.best) == (0, 0, 0, 0, (0,))


def test_boundaries_may_be_off_by_little():
    # 0.3 % of the diagonal of 141 pixels, rounded up, is one pixel.
    assert overlap(square((1, 11, 10)), square((1, 10, 10))).boundary_f == 1
    assert overlap(square((1, 13, 13)), square((1, 10, 10))).boundary_f < 0.2


def test_what_became_of_an_object_is_told_from_the_labels_of_its_clicks():
    # Columns: no label, then labels 1 to 4.
    kinds, main = kinds_of(
        np.array(
            [
                [0, 8, 0, 0, 0],  # alone on one label
                [2, 0, 8, 0, 0],  # four of five clicks are enough
                [0, 0, 0, 5, 5],  # on two labels, one of which the next has a click of
                [9, 0, 0, 0, 1],  # hardly seen
                [10, 0, 0, 0, 0],
            ]
        )
    )
    assert kinds == ("whole", "whole", "split", "missed", "missed")
    assert main == (1, 2, 3, 4, 0)
    assert kinds_of(np.array([[0, 8], [3, 1]]))[0] == ("merged", "missed")
    assert kinds_of(np.array([[0, 8], [0, 8]]))[0] == ("merged", "merged")
    assert kinds_of(np.array([[3, 5], [8, 0]]))[0] == ("split", "missed")
    assert kinds_of(np.array([[3], [8]])) == (("missed", "missed"), (0, 0))


@pytest.mark.parametrize("with_clicks", [None, clicks()])
def test_a_right_prediction_is_right_in_everything(with_clicks):
    scores = score(frame(with_clicks), answer(PERFECT, grasped=(0, 1, 1)), CLASSES)
    assert scores.kinds == ("whole",) * 3
    assert (scores.false, scores.good, scores.quality, scores.story()) == (0, 3, 1.0, "all right")
    assert scores.support.right
    assert scores.support.angle_deg < 0.2
    assert scores.support.height_mm < 0.5
    if with_clicks is None:
        assert scores.overlap.f == 1
    else:
        assert (scores.classes, scores.grasped) == ((True, True, True), (True, True))


def test_given_classes_of_whole_objects_count_and_unknown_ones_are_named():
    marked = clicks(("box", "bowl", None))
    scores = score(frame(marked), answer(PERFECT, ("can", "box", "box")), ("box", "can", "other"))
    assert (scores.classes, scores.unknown_classes) == ((False, False), ("bowl",))
    numbers = summarise([scores])
    assert (numbers.groups[EVERY].class_accuracy.mean, numbers.unknown_classes) == (0.0, {"bowl": 1})
    assert "bowl (1)" in " ".join(tables(numbers)[0].notes)


def test_a_grasp_counts_for_the_object_that_its_instance_mostly_lies_on():
    scores = score(frame(clicks()), answer(PERFECT, grasped=(1, 2)), CLASSES)
    assert scores.grasped == (False, True)  # the third one is not graspable
    assert "no grasp on 1 of 2" in scores.story()


def test_a_table_that_is_tilted_or_too_low_is_wrong():
    tilted, low = T_CAMERA_TABLE.copy(), T_CAMERA_TABLE.copy()
    cosine, sine = np.cos(np.deg2rad(8)), np.sin(np.deg2rad(8))
    tilted[:3, :3] = tilted[:3, :3] @ np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])
    low[:3, 3] -= 0.03 * low[:3, 2]
    of_tilted, of_low = (score(frame(clicks()), answer(PERFECT, T=T), CLASSES) for T in (tilted, low))
    assert of_tilted.support.angle_deg == pytest.approx(8, abs=0.2)
    assert of_low.support.height_mm == pytest.approx(30, abs=0.5)
    assert not of_tilted.support.right
    assert not of_low.support.right
    assert "support off by 0 degrees, 30 mm" in of_low.story()


def test_the_support_of_a_frame_with_pose_is_compared_in_the_camera():
    assert score(frame(posed=True), answer(PERFECT, T=np.eye(4)), CLASSES).support.right


def test_without_a_plane_that_holds_half_of_the_points_no_support_is_known():
    rng = np.random.default_rng(0)
    flat, loose = rng.uniform(-0.3, 0.3, (300, 3)), rng.uniform(-0.3, 0.3, (400, 3))
    flat[:, 2] = 0.5
    found = support_plane(np.concatenate([flat, loose[:200]]))
    assert found is not None
    np.testing.assert_allclose(found[0].normal, [0, 0, -1], atol=0.01)
    assert found[0].offset == pytest.approx(0.5, abs=2e-3)
    assert support_plane(np.concatenate([flat, loose])) is None
    assert support_plane(flat[:50]) is None
    marked = replace(clicks(), support=np.zeros((0, 2), dtype=np.int64))
    assert score(frame(marked), answer(PERFECT), CLASSES).support is None


def on_table(mask: np.ndarray) -> np.ndarray:
    """The mask with a fourth object where the table is."""
    u, v = pixels_on(0, 12)[5]
    more = mask.copy()
    more[v - 3 : v + 3, u - 3 : u + 3] = 3
    return more


def test_an_object_on_the_table_is_false_and_one_beyond_all_clicks_not_where_clicks_are_incomplete():
    far = PERFECT.copy()
    far[LABELS == 0] = np.where(np.arange((LABELS == 0).sum()) < 20, 3, -1)
    four = ("box",) * 4
    for mask, sure, unsure in ((on_table(PERFECT), 1, 1), (far, 1, 0)):
        assert score(frame(), answer(mask, four), CLASSES).false == 1
        assert score(frame(clicks()), answer(mask, four), CLASSES).false == sure
        untouched = replace(clicks(uncertain=True), support=pixels_on(0, 12)[5:6])
        assert score(frame(untouched), answer(mask, four), CLASSES).false == unsure


def test_an_error_counts_as_nothing_found_and_ends_nothing():
    class Refusing(Predictor):
        def __init__(self):
            pass

        def predict_depth(self, *_):
            raise InputError("no table")

    prediction, seconds, error = predict(Refusing(), frame())
    assert (prediction, error) == (None, "no table")
    assert seconds >= 0
    scores = score(frame(), None, CLASSES, seconds, error)
    assert (scores.overlap.f, scores.kinds, scores.false, scores.story()) == (0, ("missed",) * 3, 0, "no table")
    assert not scores.support.right
    numbers = summarise([scores]).groups[EVERY]
    assert (numbers.errors, numbers.support_right.mean, numbers.support_angle_deg) == (1, 0.0, None)
    of_clicks = score(frame(clicks()), None, CLASSES, seconds, error)
    assert (of_clicks.grasped, of_clicks.classes) == ((False, False), ())


def in_subset(subset: str, labelled: LabelledFrame, mask: np.ndarray, seconds: float) -> FrameScores:
    return score(replace(labelled, subset=subset), answer(mask, ("box",) * 4), CLASSES, seconds)


def test_frames_are_averaged_and_objects_counted_by_subset_and_kind_of_truth():
    lost = np.where(LABELS == 1, PERFECT, -1)
    rows = [
        in_subset("easy", frame(), PERFECT, 1.0),
        in_subset("hard", frame(), lost, 3.0),
        in_subset("hard", frame(clicks()), on_table(lost), 2.0),
    ]
    groups = summarise(rows).groups
    assert list(groups) == ["easy", "hard", IN_LABELS, IN_CLICKS, EVERY]
    assert (groups["easy"].f.mean, groups["easy"].good.mean, groups["easy"].whole.mean) == (100, 100, 100)
    assert groups[IN_LABELS].recall.mean == pytest.approx(50 * (1 + rows[1].overlap.recall))
    assert groups[IN_LABELS].good.mean == pytest.approx(100 * 4 / 6)
    assert (groups[IN_CLICKS].f, groups[IN_CLICKS].false.mean, groups[IN_CLICKS].frames) == (None, 1, 1)
    assert groups[EVERY].missed.mean == pytest.approx(100 * 4 / 9)
    assert (groups[EVERY].seconds.mean, groups[EVERY].worst_seconds, groups[EVERY].objects) == (2.0, 3.0, 9)
    assert list(summarise(rows[:1]).groups) == ["easy", EVERY]
    assert [row[0].split("\n")[0] for row in tables(summarise(rows))[0].rows[:3]] == ["easy", "hard", IN_LABELS]
    assert tables(summarise(rows[:1]))[0].rows[1][0] == "all\n1 / 3"
    assert rows[1].story() == "2 of 3 objects below 0.75; 2 missed"
    assert rows[2].story() == "2 of 3 objects not whole; 2 missed; 1 false; no grasp on 2 of 2"
    assert [row.quality for row in rows] == [1, 1 / 3, 1 / 4]


def test_published_values_stand_below_ours_only_where_labels_are_compared():
    printed = tables(summarise([score(frame(), answer(PERFECT), CLASSES)]))
    assert [table.title.split(",")[0] for table in printed] == [
        "overlap with label images",
        "objects",
        "support and time",
    ]
    assert ("UOIS-Net-3D", "-", "-", "83.3", "71.2", "-") in printed[0].rows
    for table in printed:
        assert all(len(row) == len(table.headers) for row in table.rows)
    assert len(tables(summarise([score(frame(clicks()), answer(PERFECT), CLASSES)]))) == 2


def test_the_command_measures_a_folder_and_draws_it(tmp_path, capsys, monkeypatch):
    write_frame(tmp_path / "real" / "labelled", "one", labelled=True)
    write_frame(tmp_path / "real" / "clicked", "two", labelled=False)
    Image.new("RGB", (320, 240), "blue").save(tmp_path / "real" / "labelled" / "one_color.jpg")
    quick = Predictor(tiny_network(), search=GraspSearch(contacts=32, max_checked=40, min_score=0.0))
    monkeypatch.setattr(Predictor, "load", lambda *_: quick)
    arguments = ["--threads", "1", "--out", str(tmp_path / "out"), "--gallery", "1"]
    assert main(["benchmark", "captures", str(tmp_path / "real"), *arguments]) == 0
    assert "labelled" in capsys.readouterr().out
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert list(report["groups"]) == ["clicked", "labelled", IN_LABELS, IN_CLICKS, EVERY]
    assert [row["name"] for row in report["rows"]] == ["clicked/two", "labelled/one"]
    assert report["groups"][EVERY]["support_right"]["mean"] == 100
    assert len(report["settings"]["weights"]) == 64
    assert report["settings"]["pose"] is True
    pictures = sorted(str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*.png"))
    assert pictures == [
        *("frames/clicked/two.png", "frames/labelled/one.png"),
        *("sheets/clicked_1.png", "sheets/labelled_1.png", "worst.png"),
    ]
    assert main(["benchmark", "report", str(tmp_path / "out")]) == 0
    page = capsys.readouterr().out
    assert "## Real frames" in page
    assert page.count("out: ") == 2
    assert "UOIS-Net-3D" in page


def test_wrong_use_names_what_is_valid(tmp_path, capsys):
    with pytest.raises(InputError, match="threads must be at least 1, got 0"):
        CapturesConfig(folder=tmp_path, threads=0)
    assert main(["benchmark", "captures", str(tmp_path)]) == USAGE_ERROR
    assert "no frame here" in capsys.readouterr().err
    assert main(["benchmark", "captures", str(tmp_path), "--gallery", "-1"]) == USAGE_ERROR
    assert "gallery must be at least 0" in capsys.readouterr().err
    assert main(["benchmark", "captures"]) == USAGE_ERROR
