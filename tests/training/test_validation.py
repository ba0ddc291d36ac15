from dataclasses import replace

import numpy as np
import pytest

from icgnet.errors import DataError
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import save_weights
from icgnet.training import validation
from icgnet.training.config import TRAININGS
from icgnet.training.validation import evaluate_weights, validation_samples

SAMPLING = replace(TRAININGS["tiny"].sampling, half_resolution=1.0)


def drawn(recipes, scenes, monkeypatch):
    """Ids of the recipes that a validation would look at."""
    seen = []
    monkeypatch.setattr(validation, "RecipeDataset", lambda chosen, *rest: seen.extend(chosen) or {})
    with pytest.raises(KeyError):
        validation_samples("tiny", SAMPLING, scenes, recipes, {})
    return [recipe.scene_id for recipe in seen]


def test_both_kinds_of_scenes_are_validated_when_they_alternate(recipes, monkeypatch):
    alternating = [replace(recipes[0], scene_id=i, kind="packed" if i % 3 == 0 else "pile") for i in range(90)]
    packed = np.mean([scene_id % 3 == 0 for scene_id in drawn(alternating, 30, monkeypatch)])
    assert 0.15 < packed < 0.55


def test_the_same_scenes_are_drawn_every_time(recipes, monkeypatch):
    many = [replace(recipes[0], scene_id=i) for i in range(20)]
    assert drawn(many, 5, monkeypatch) == drawn(many, 5, monkeypatch)


def test_evaluation_names_a_split_without_scenes(recipes, tmp_path, monkeypatch):
    save_weights(tmp_path / "w.safetensors", IcgNet(NETWORKS["tiny"]), {})
    monkeypatch.setattr(validation, "read_recipes", lambda folder: recipes)
    with pytest.raises(DataError, match="'val'"):
        evaluate_weights(tmp_path / "w.safetensors", [tmp_path], [])


def test_evaluation_reports_each_kind_and_all(recipes, shapes, tmp_path, monkeypatch):
    save_weights(tmp_path / "w.safetensors", IcgNet(NETWORKS["tiny"]), {})
    held_out = [replace(recipes[0], split="val"), replace(recipes[1], split="val", kind="pile")]
    monkeypatch.setattr(validation, "read_recipes", lambda folder: held_out)
    monkeypatch.setattr(validation, "load_object_set", lambda source: shapes)
    metrics = evaluate_weights(tmp_path / "w.safetensors", [tmp_path], ["shapes"])
    assert set(metrics) == {"packed", "pile", "all"}
    assert metrics["all"]["scenes"] == 2
    assert 0.0 <= metrics["pile"]["instance_miou"] <= 1.0
