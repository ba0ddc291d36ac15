"""Hand and classes go from the data into the weights, and unlike ones are refused in one line."""

import json
from dataclasses import replace

import pytest
import torch

from icgnet.errors import DataError, InputError
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import load_weights, save_weights
from icgnet.training.calibration import calibrate_weights
from icgnet.training.checkpoint import CHECKPOINT_FILE
from icgnet.training.config import CONFIG_FILE, TRAININGS
from icgnet.training.dataset import RecipeDataset, gather_recipes, network_for
from icgnet.training.loop import FINAL_FILE, train
from icgnet.training.validation import evaluate_weights
from shape_scenes import HEADER, write_recipes

CONFIG = replace(TRAININGS["tiny"], steps=1, validation_scenes=0, checkpoint_minutes=0.0)
WIDE = replace(HEADER, gripper=replace(HEADER.gripper, name="wide", max_opening=0.1))
MORE = replace(HEADER, classes=(*HEADER.classes, "vase"))
WIDER = r"hand 'wide'.*max_opening 0.1 instead of 0.08"


@pytest.fixture
def wide_data(tmp_path):
    write_recipes(tmp_path / "wide", header=WIDE)
    return tmp_path / "wide"


def write_tiny(path, header=HEADER, **changes):
    save_weights(path, IcgNet(replace(network_for("tiny", header), **changes)), {})
    return path


def test_folders_of_unlike_hands_are_mixed_for_networks_of_any_hand_alone(data, wide_data, tmp_path):
    with pytest.raises(DataError, match=rf"wide cannot be mixed with .*data: it has {WIDER}"):
        train(replace(CONFIG, network="paper"), [data, wide_data], tmp_path / "out")
    recipes, header = gather_recipes([data, wide_data], any_hand=True)
    assert header == HEADER
    assert {recipe.gripper.max_opening for recipe in recipes} == {0.08, 0.1}


def test_folders_of_unlike_classes_are_not_mixed(data, tmp_path):
    write_recipes(tmp_path / "more", header=MORE)
    with pytest.raises(DataError, match=r"more cannot be mixed with .*data: it has classes .*other, vase instead of"):
        train(CONFIG, [data, tmp_path / "more"], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_another_name_or_mounting_is_mixed(data, tmp_path):
    mounted = replace(HEADER.gripper, name="mine", base_offset=(0.0, 0.0, -0.2))
    write_recipes(tmp_path / "mine", header=replace(HEADER, gripper=mounted))
    recipes, header = gather_recipes([data, tmp_path / "mine"])
    assert (len(recipes), header) == (12, HEADER)


def test_weights_know_the_hand_and_the_classes_of_their_data(wide_data, shapes, monkeypatch, tmp_path):
    monkeypatch.setattr("icgnet.training.validation.load_object_set", lambda source: shapes)
    train(CONFIG, [wide_data], tmp_path / "out", ["shapes"])
    network, _ = load_weights(tmp_path / "out" / FINAL_FILE)
    assert network.config.gripper == WIDE.gripper
    assert network.config.classes == WIDE.classes
    checkpoint = torch.load(tmp_path / "out" / CHECKPOINT_FILE, weights_only=True)
    assert checkpoint["config"]["gripper"] == WIDE.gripper.to_dict()
    record = json.loads((tmp_path / "out" / CONFIG_FILE).read_text())
    assert record["network"]["gripper"]["max_opening"] == 0.1


def test_a_network_has_as_many_class_logits_as_the_data_have_classes():
    network = IcgNet(network_for("tiny", MORE))
    ends = {each.out_features for each in network.refinement.modules() if isinstance(each, torch.nn.Linear)}
    assert len(MORE.classes) + 1 in ends


def test_weights_that_began_with_another_hand_are_a_start_but_not_those_of_other_classes(train_shapes, tmp_path):
    train_shapes(CONFIG, tmp_path / "wide_start", start=write_tiny(tmp_path / "wide.safetensors", WIDE))
    with pytest.raises(DataError, match=r"classes is .*other, vase, wanted mug"):
        train_shapes(CONFIG, tmp_path / "out", start=write_tiny(tmp_path / "more.safetensors", MORE))
    assert not (tmp_path / "out").exists()


def test_a_run_does_not_go_on_with_data_of_another_hand(train_shapes, wide_data, tmp_path):
    train_shapes(CONFIG, tmp_path / "out")
    with pytest.raises(DataError, match=r"network\.gripper\.max_opening: 0.08 there, 0.1 now"):
        train(CONFIG, [wide_data], tmp_path / "out", ["shapes"])


def test_weights_of_the_published_kind_are_judged_and_calibrated_on_their_own_hand_only(wide_data, tmp_path):
    weights = write_tiny(tmp_path / "w.safetensors", affordance="contact")
    message = r"the scenes in .*wide have the hand 'wide', but the weights know only 'franka'"
    with pytest.raises(InputError, match=message):
        evaluate_weights(weights, [wide_data], ["procedural"])
    with pytest.raises(InputError, match=message):
        calibrate_weights(weights, [wide_data], ["procedural"], tmp_path / "out.safetensors")


def test_others_are_judged_on_any_hand(wide_data, shapes, monkeypatch, tmp_path):
    monkeypatch.setattr("icgnet.training.validation.load_object_set", lambda source: shapes)
    weights = write_tiny(tmp_path / "w.safetensors")
    assert evaluate_weights(weights, [wide_data], ["shapes"])["all"]["scenes"] > 0


def test_weights_are_judged_on_data_of_more_classes(data, shapes, monkeypatch, tmp_path):
    monkeypatch.setattr("icgnet.training.validation.load_object_set", lambda source: shapes)
    fewer = write_tiny(tmp_path / "fewer.safetensors", replace(HEADER, classes=("box", "other")))
    assert evaluate_weights(fewer, [data], ["shapes"])["all"]["scenes"] > 0
    neither = write_tiny(tmp_path / "neither.safetensors", replace(HEADER, classes=("box", "can")))
    with pytest.raises(InputError, match="the class 'mug' is not known, nor 'other'; the classes are box, can"):
        evaluate_weights(neither, [data], ["shapes"])


def test_an_object_of_a_class_that_the_labels_do_not_know_is_other(recipes, shapes):
    network = replace(NETWORKS["tiny"], classes=("other", "box"))
    dataset = RecipeDataset(recipes, {"shapes": shapes}, CONFIG.sampling, network, 0)
    whole = RecipeDataset(recipes, {"shapes": shapes}, CONFIG.sampling, NETWORKS["tiny"], 0)
    for visit in range(3):
        names = [NETWORKS["tiny"].classes[index] for index in whole[visit].classes]
        assert dataset[visit].classes.tolist() == [int(name == "box") for name in names]
    with pytest.raises(InputError, match="is not known, nor 'other'; the classes are box, can"):
        RecipeDataset(recipes, {"shapes": shapes}, CONFIG.sampling, replace(network, classes=("box", "can")), 0)
