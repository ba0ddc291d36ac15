from dataclasses import replace

import numpy as np
import pytest

from icgnet.errors import DataError
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import save_weights
from icgnet.training import validation
from icgnet.training.config import TRAININGS
from icgnet.training.validation import draw_scenes, evaluate_weights, validation_samples
from shape_scenes import HEADER

SAMPLING = replace(TRAININGS["tiny"].sampling, half_resolution=1.0)


def test_both_kinds_of_scenes_are_validated_when_they_alternate(recipes):
    alternating = [replace(recipes[0], scene_id=i, kind="packed" if i % 3 == 0 else "pile") for i in range(90)]
    packed = np.mean([recipe.kind == "packed" for recipe in draw_scenes(alternating, 30)])
    assert 0.15 < packed < 0.55


def test_the_same_scenes_are_drawn_every_time(recipes):
    many = [replace(recipes[0], scene_id=i) for i in range(20)]
    ids = [recipe.scene_id for recipe in draw_scenes(many, 5)]
    assert ids == [recipe.scene_id for recipe in draw_scenes(many, 5)]
    assert len(set(ids)) == 5


def test_a_scene_that_shows_nothing_is_not_validated(recipes, shapes):
    empty = replace(recipes[1], objects=())
    samples = validation_samples(NETWORKS["tiny"], SAMPLING, 9, [recipes[0], empty, recipes[2]], {"shapes": shapes})
    assert len(samples) == 2


@pytest.mark.parametrize("apart", [False, True])
def test_samples_are_made_in_another_process_where_one_forks_afterwards(recipes, shapes, monkeypatch, apart):
    asked = {}

    def load(looks, num_workers, **settings):
        asked["workers"] = num_workers
        return [looks[index] for index in range(len(looks))]

    monkeypatch.setattr(validation, "DataLoader", load)
    samples = validation_samples(NETWORKS["tiny"], SAMPLING, 2, recipes[:2], {"shapes": shapes}, apart)
    assert len(samples) == 2
    assert asked["workers"] == int(apart)


def test_evaluation_names_a_split_without_scenes(recipes, tmp_path, monkeypatch):
    save_weights(tmp_path / "w.safetensors", IcgNet(NETWORKS["tiny"]), {})
    monkeypatch.setattr(validation, "gather_recipes", lambda folders, any_hand: (recipes, HEADER))
    with pytest.raises(DataError, match="'val'"):
        evaluate_weights(tmp_path / "w.safetensors", [tmp_path], [])


def test_evaluation_reports_each_kind_and_all(recipes, shapes, tmp_path, monkeypatch):
    save_weights(tmp_path / "w.safetensors", IcgNet(NETWORKS["tiny"]), {})
    held_out = [replace(recipes[0], split="val"), replace(recipes[1], split="val", kind="pile")]
    monkeypatch.setattr(validation, "gather_recipes", lambda folders, any_hand: (held_out, HEADER))
    monkeypatch.setattr(validation, "load_object_set", lambda source: shapes)
    metrics = evaluate_weights(tmp_path / "w.safetensors", [tmp_path], ["shapes"])
    assert set(metrics) == {"packed", "pile", "all"}
    assert metrics["all"]["scenes"] == 2
    assert 0.0 <= metrics["pile"]["instance_miou"] <= 1.0
