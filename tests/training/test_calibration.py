import copy
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.special import expit

from icgnet.errors import DataError, InputError
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import is_stored_in_half, load_weights, save_weights
from icgnet.training.calibration import (
    Calibration,
    SceneGrasps,
    calibrate,
    calibrate_weights,
    decode_scenes,
    fit_calibration,
    fold,
    judge,
)
from icgnet.training.config import TRAININGS, MatchingCosts
from shape_scenes import HEADER
from simple_networks import network_that_likes_hands_from_above

SAMPLING = replace(TRAININGS["tiny"].sampling, half_resolution=1.0).for_validation()
LINE = Calibration(0.6, -0.9)


def made_up_scenes(count=20, contacts=400, line=LINE, seed=0):
    """Scenes whose grasps succeed with the probability that their logits have after the line."""
    rng = np.random.default_rng(seed)
    scenes = []
    for _ in range(count):
        logits = rng.normal(-1.0, 3.0, (contacts, 12))
        scenes.append(SceneGrasps(logits, rng.random(logits.shape) < expit(line(logits)), np.ones(contacts, bool)))
    return scenes


@pytest.fixture(scope="module")
def samples(make_dataset):
    dataset = make_dataset(SAMPLING, NETWORKS["tiny"])
    return [dataset[visit] for visit in range(3)]


@pytest.fixture
def weights(tmp_path):
    """A file of the network that likes hands from above."""
    save_weights(tmp_path / "w.safetensors", network_that_likes_hands_from_above(), {"step": 7})
    return tmp_path / "w.safetensors"


@pytest.fixture
def calibrate_shapes(shapes, data, monkeypatch):
    """`calibrate_weights` on the two validation scenes of the shapes."""
    monkeypatch.setattr("icgnet.training.validation.load_object_set", lambda source: shapes)
    return lambda weights, out, **more: calibrate_weights(weights, [data], ["shapes"], out, **more)


def logits_of(network, samples):
    return np.concatenate([scene.logits.ravel() for scene in decode_scenes(network, samples, MatchingCosts())])


def test_the_line_that_spoiled_the_logits_is_found():
    found = fit_calibration(made_up_scenes())
    assert found.scale == pytest.approx(LINE.scale, abs=0.02)
    assert found.offset == pytest.approx(LINE.offset, abs=0.04)


def test_an_overconfident_network_gets_the_same_scores_as_a_modest_one(samples):
    modest, overconfident = network_that_likes_hands_from_above(), network_that_likes_hands_from_above()
    fold(overconfident, Calibration(3.0, 2.0))
    for network in (modest, overconfident):
        fold(network, fit_calibration(decode_scenes(network, samples, MatchingCosts())))
    np.testing.assert_allclose(logits_of(modest, samples), logits_of(overconfident, samples), atol=1e-3)


def test_scores_of_other_scenes_become_true():
    result = calibrate(made_up_scenes())
    assert result.before.ece > 0.05
    assert result.after.ece < 0.01
    assert result.after.ece_equal_width < 0.01
    assert result.after.log_loss < result.before.log_loss
    assert (result.after.scenes, result.after.grasps) == (10, 10 * 400 * 12)


def test_no_scene_is_judged_by_a_line_that_was_fitted_on_it():
    # Every other scene follows another line, so that each half wants its own.
    apart = [
        scene
        for pair in zip(made_up_scenes(), made_up_scenes(line=Calibration(0.6, 1.5)), strict=True)
        for scene in pair
    ]
    assert calibrate(apart).after.ece > 0.1


@pytest.mark.parametrize("affordance", ["hand", "contact"])
def test_folding_maps_the_decoded_logits_and_changes_nothing_else(affordance, samples):
    torch.manual_seed(1)
    network = IcgNet(replace(NETWORKS["tiny"], affordance=affordance)).eval()
    torch.nn.init.normal_(network.affordance.success_layer.weight)
    before, kept = logits_of(network, samples), copy.deepcopy(network.state_dict())
    names = fold(network, LINE)
    after = logits_of(network, samples)
    assert np.ptp(before) > 0.1
    np.testing.assert_allclose(after, LINE(before), atol=1e-5)
    changed = {name for name, value in network.state_dict().items() if not torch.equal(value, kept[name])}
    assert changed == set(names)
    assert len(changed) == 2


def test_no_grasp_overtakes_another(samples):
    network = network_that_likes_hands_from_above()
    before = logits_of(network, samples)
    fold(network, LINE)
    steps = np.diff(logits_of(network, samples)[np.argsort(before, kind="stable")])
    assert steps.min() > -1e-5


def test_the_best_seen_grasp_is_told_from_better_ones_out_of_sight():
    logits = np.array([[5.0, 0.0], [1.0, 0.5], [-1.0, -2.0]])
    labels = np.array([[0, 0], [1, 0], [0, 0]], bool)
    seen = SceneGrasps(logits, labels, np.array([False, True, True]))
    unseen = SceneGrasps(logits, labels, np.zeros(3, bool))
    report = judge([seen, unseen])
    assert report.best_score == pytest.approx(expit(1.0))
    assert report.best_success == 1.0
    assert judge([unseen]).best_score is None


def test_choosing_the_best_of_noisy_scores_is_optimistic():
    # True scores on average, but the highest of many owes its place to its noise as well.
    rng = np.random.default_rng(0)
    scenes = []
    for _ in range(200):
        truth = rng.normal(-1.0, 1.0, (40, 12))
        labels = rng.random(truth.shape) < expit(truth)
        scenes.append(SceneGrasps(truth + rng.normal(0.0, 2.0, truth.shape), labels, np.ones(40, bool)))
    report = judge(scenes)
    assert report.best_score > report.best_success + 0.2


def test_separable_labels_give_a_finite_line():
    logits = np.linspace(-1.0, 1.0, 240).reshape(20, 12)
    found = fit_calibration([SceneGrasps(logits, logits > 0, np.ones(20, bool))])
    assert np.isfinite([found.scale, found.offset]).all()
    assert found.scale > 1.0


@pytest.mark.parametrize(
    ("logits", "labels", "message"),
    [
        (np.arange(12.0), np.zeros(12), "0 of the 12 grasps in 1 scenes succeed"),
        (np.arange(12.0), np.ones(12), "12 of the 12 grasps in 1 scenes succeed"),
        (np.arange(12.0), np.arange(12) < 6, "higher scores do not mean more successes"),
        (np.ones(12), np.arange(12) < 6, "same score"),
        (np.full(12, np.nan), np.arange(12) < 6, "not finite"),
    ],
)
def test_scores_that_teach_nothing_are_refused(logits, labels, message):
    with pytest.raises(DataError, match=message):
        fit_calibration([SceneGrasps(logits[None], labels[None].astype(bool), np.ones(1, bool))])


def test_one_scene_is_not_enough():
    with pytest.raises(DataError, match="half to judge: 1"):
        calibrate(made_up_scenes(1))


def test_calibrated_weights_are_weights_that_say_what_was_done(weights, calibrate_shapes, samples, tmp_path):
    result = calibrate_shapes(weights, tmp_path / "new" / "calibrated.safetensors")
    network, metadata = load_weights(tmp_path / "new" / "calibrated.safetensors", NETWORKS["tiny"])
    expected = result.calibration(logits_of(network_that_likes_hands_from_above(), samples))
    np.testing.assert_allclose(logits_of(network, samples), expected, atol=1e-5)
    assert metadata["step"] == 7
    record = metadata["calibration"]
    assert (record["scale"], record["offset"]) == (result.calibration.scale, result.calibration.offset)
    assert (record["data"], record["scenes"]) == (["data"], 2)
    assert (record["ece_before"], record["ece_after"]) == (result.before.ece, result.after.ece)


def test_a_second_calibration_says_so_and_adds_nothing(weights, calibrate_shapes, tmp_path):
    first, second, lines = tmp_path / "1.safetensors", tmp_path / "2.safetensors", []
    calibrate_shapes(weights, first)
    again = calibrate_shapes(first, second, report=lines.append)
    assert "calibrated before" in lines[0]
    assert again.calibration.scale == pytest.approx(1.0, abs=1e-3)
    once, twice = (load_weights(path)[1]["calibration"] for path in (first, second))
    assert (twice["scale"], twice["offset"]) == pytest.approx((once["scale"], once["offset"]), abs=1e-2)


def test_half_precision_stays_but_for_the_calibrated_layer(weights, calibrate_shapes, samples, tmp_path):
    network, _ = load_weights(weights)
    save_weights(weights, network, {}, half=True)
    result = calibrate_shapes(weights, tmp_path / "c.safetensors")
    assert is_stored_in_half(tmp_path / "c.safetensors")
    expected = result.calibration(logits_of(load_weights(weights)[0], samples))
    np.testing.assert_allclose(logits_of(load_weights(tmp_path / "c.safetensors")[0], samples), expected, atol=1e-5)


def test_other_hands_are_judged_apart():
    own, others = made_up_scenes(20), made_up_scenes(20, line=Calibration(0.6, 1.5), seed=1)
    scenes = [scene for pair in zip(own[::2], own[1::2], others[::2], others[1::2], strict=True) for scene in pair]
    scenes = [replace(scene, own_hand=index % 4 < 2) for index, scene in enumerate(scenes)]
    result = calibrate(scenes)
    assert {name: report.scenes for name, report in result.by_hand.items()} == {"its own hand": 10, "other hands": 10}
    assert all(report.ece > 3 * result.after.ece for report in result.by_hand.values())
    assert calibrate(own).by_hand == {}


def test_data_without_validation_scenes_leave_no_file(weights, recipes, calibrate_shapes, tmp_path, monkeypatch):
    monkeypatch.setattr("icgnet.training.validation.gather_recipes", lambda folders, any_hand: (recipes, HEADER))
    with pytest.raises(DataError, match="no recipes of split 'val'"):
        calibrate_shapes(weights, tmp_path / "c.safetensors")
    assert not (tmp_path / "c.safetensors").exists()


@pytest.mark.parametrize(("more", "message"), [({"scenes": 1}, "got 1"), ({"threads": 0}, "threads must be")])
def test_settings_out_of_range_are_refused(more, message, weights, calibrate_shapes, tmp_path):
    with pytest.raises(InputError, match=message):
        calibrate_shapes(weights, tmp_path / "c.safetensors", **more)


def test_a_folder_is_not_overwritten(weights, calibrate_shapes, tmp_path):
    with pytest.raises(InputError, match="is a folder"):
        calibrate_shapes(weights, tmp_path)
