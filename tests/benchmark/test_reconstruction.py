"""Shape metrics on shapes of which the answer is known."""

import json

import numpy as np
import pytest
import trimesh

from box_objects import EDGE, RADIUS, BoxAndBall, placed, predicted
from icgnet.benchmark.reconstruction import compare_shapes, inside_any, match, score_scene, summarise
from icgnet.benchmark.true_shapes import NO_OBJECT, TrueShapes
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.geometry.signed_distance import build_signed_distance_grid

BOX_AT, BALL_AT = (0.10, 0.10, 0.08), (0.20, 0.18, 0.08)
POINT_NOISE = 0.35  # mean distance between the points of two samplings of the same surface [mm], at most


@pytest.fixture(scope="module")
def truth() -> TrueShapes:
    return TrueShapes(placed(("box", BOX_AT), ("ball", BALL_AT)), BoxAndBall())


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def on_surface(truth: TrueShapes, index: int, count: int) -> np.ndarray:
    points, *_ = trimesh.sample.sample_surface(truth.meshes[index], count, seed=index)
    return np.asarray(points)


def cloud_of(truth: TrueShapes, *objects: int) -> tuple[np.ndarray, np.ndarray]:
    """Points on some objects, and which of the given ones each belongs to."""
    points = np.concatenate([on_surface(truth, index, 100) for index in objects])
    return points, np.repeat(np.arange(len(objects)), 100)


def ball() -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=4, radius=RADIUS).apply_translation(BALL_AT)


def test_the_true_shapes_score_full_marks(truth, rng):
    scores = compare_shapes([truth.meshes[0]], truth, [0], 100_000, rng)
    assert scores.iou > 98.5  # distances are interpolated between nodes 1.5 mm apart
    assert scores.chamfer_l1_mm < POINT_NOISE
    assert scores.f_score_3mm > 99.9


def test_what_is_drawn_inside_of_an_object_counts_as_published(truth, rng):
    scores = compare_shapes([ball()], truth, [1], 50_000, rng)
    assert scores.iou > 98
    inner_share = 0.5**2 / (1 + 0.5**2)
    assert scores.completeness_mm == pytest.approx(1e3 * RADIUS / 2 * inner_share, abs=POINT_NOISE)
    assert scores.accuracy_mm < POINT_NOISE


def test_a_box_shifted_by_5_mm_has_the_numbers_of_the_textbook(truth, rng):
    scores = compare_shapes([truth.meshes[0].copy().apply_translation((0.005, 0, 0))], truth, [0], 100_000, rng)
    edge, shift = 1e3 * EDGE, 5.0
    assert scores.iou == pytest.approx(100 * (edge - shift) / (edge + shift), abs=1.0)
    # Of the six faces one is 5 mm in front, one as far inside (or nearer to a side), and four stick out a little.
    inside = (edge**3 - (edge - 2 * shift) ** 3) / (6 * edge**2)
    expected = (shift + inside + 4 * shift**2 / (2 * edge)) / 6
    assert expected < scores.chamfer_l1_mm < expected + POINT_NOISE
    assert scores.accuracy_mm == pytest.approx(scores.completeness_mm, abs=0.02)
    near = (4 * (1 - 2 / edge) + 1 - ((edge - 6) / edge) ** 2) / 6
    assert scores.f_score_3mm == pytest.approx(100 * near, abs=1.0)
    assert scores.f_score_10mm == 100.0


def test_overlapping_predictions_are_a_union(truth, rng):
    box = truth.meshes[0]
    once = compare_shapes([box], truth, [0], 50_000, np.random.default_rng(1))
    twice = compare_shapes([box, box.copy()], truth, [0], 50_000, np.random.default_rng(1))
    assert twice.iou == once.iou


def test_a_scene_without_prediction_has_no_distance_and_no_overlap(truth):
    scores = score_scene(0, truth, None)
    assert scores.scene.iou == 0.0
    assert scores.scene.chamfer_l1_mm is None
    numbers = summarise([scores])
    assert numbers.without_shape == 1
    assert numbers.scene["chamfer_l1_mm"] is None
    assert numbers.scene["iou"].mean == 0.0


def test_objects_are_matched_by_their_points_in_whatever_order_they_are_predicted(truth):
    points, labels = cloud_of(truth, 1, 0)
    scores = score_scene(0, truth, predicted([ball(), truth.meshes[0]], points, labels))
    assert scores.visible == len(scores.instances) == 2
    assert min(shape.iou for shape in scores.instances) > 97


def test_a_missed_object_counts_as_zero_among_the_visible_ones(truth):
    points, labels = cloud_of(truth, 0, 1)
    scores = score_scene(0, truth, predicted([truth.meshes[0]], points, np.where(labels == 0, 0, -1)))
    numbers = summarise([scores])
    assert (numbers.visible, numbers.matched) == (2, 1)
    assert numbers.per_instance["found"].mean == 50.0
    assert numbers.per_instance["iou_of_visible"].mean == pytest.approx(numbers.per_instance["iou"].mean / 2)


def test_the_mean_is_over_scenes_with_population_deviation(truth):
    points, labels = cloud_of(truth, 0, 1)
    full = score_scene(0, truth, predicted([truth.meshes[0], ball()], points, labels))
    numbers = summarise([full, score_scene(1, truth, None)])
    assert numbers.scene["iou"].mean == pytest.approx(full.scene.iou / 2)
    assert numbers.scene["iou"].std == pytest.approx(full.scene.iou / 2)
    assert (numbers.scene["iou"].low, numbers.scene["iou"].high) == pytest.approx((0.0, full.scene.iou))
    assert numbers.scene["chamfer_l1_mm"].mean == full.scene.chamfer_l1_mm


def test_a_match_has_the_largest_sum_and_no_pair_without_overlap():
    assert match(np.array([[0.6, 0.5], [0.5, 0.0]])) == [(0, 1), (1, 0)]
    assert match(np.array([[0.6, 0.0], [0.5, 0.0]])) == [(0, 0)]
    assert match(np.zeros((0, 3))) == []


def test_ray_parity_and_signed_distances_agree_on_what_is_inside(rng):
    torus = trimesh.creation.torus(0.04, 0.015)
    points = rng.uniform(-0.06, 0.06, (20_000, 3))
    by_rays = inside_any([torus], points)
    by_distance = build_signed_distance_grid(torus).distance(points) < 0
    assert by_rays.mean() > 0.05
    assert (by_rays != by_distance).mean() < 0.005


def test_a_point_belongs_to_the_nearest_object_and_noise_to_none(truth):
    points = np.array([(0.10, 0.10, 0.113), (0.20, 0.18, 0.108), (0.15, 0.05, 0.2)])
    assert truth.owners(points).tolist() == [0, 1, NO_OBJECT]


@pytest.mark.slow
def test_the_command_prints_a_table_and_writes_a_report(tmp_path, capsys):
    arguments = ["--scenes", "1", "--threads", "1", "--out", str(tmp_path)]
    assert main(["benchmark", "reconstruction", *arguments]) == 0
    assert "Chamfer-L1" in capsys.readouterr().out
    report = json.loads((tmp_path / "report.json").read_text())
    iou = report["scene"]["iou"]
    assert 20 < iou["mean"] < 100
    assert 0.2 < report["scene"]["chamfer_l1_mm"]["mean"] < 20
    assert iou["low"] <= iou["mean"] <= iou["high"]
    assert 0 < report["matched"] <= report["visible"]
    assert report["settings"]["gripper"]["name"] == "franka"
    assert {"scene", "split", "view", "noise", "scenes", "seed", "weights", "threads"} <= report["settings"].keys()
    assert len(report["settings"]["weights"]) == 64
    assert report["origin"]["processor"]


@pytest.mark.parametrize("number", ["reconstruction", "segmentation", "latency"])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--scenes", "0"], "scenes must be at least 1, got 0"),
        (["--seed", "-1"], "seed must be at least 0, got -1"),
        (["--objects", "nowhere"], "nowhere"),
        (["--weights", "nowhere.safetensors"], "nowhere.safetensors"),
        (["--threads", "0"], "threads must be at least 1, got 0"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(number, arguments, message, capsys):
    assert main(["benchmark", number, *arguments]) == USAGE_ERROR
    error = capsys.readouterr().err
    assert error.startswith("error:")
    assert message in error
