"""Fixtures around the small world of `shape_scenes`."""

from pathlib import Path

import pytest

from icgnet.datagen.recipe import Recipe
from icgnet.objects.object_set import ObjectSet
from icgnet.training.dataset import RecipeDataset
from icgnet.training.loop import train
from shape_scenes import SHAPES, ShapeSet, make_recipe, write_recipes


@pytest.fixture(scope="session")
def shapes(tmp_path_factory) -> ObjectSet:
    """The object set; its distance grids live in a folder of the test run."""
    patch = pytest.MonkeyPatch()
    patch.setenv("ICGNET_CACHE", str(tmp_path_factory.mktemp("cache")))
    object_set = ShapeSet()
    for key in SHAPES:
        object_set.signed_distance(key)
    patch.undo()
    return object_set


@pytest.fixture(scope="session")
def recipes() -> list[Recipe]:
    return [make_recipe(scene_id) for scene_id in range(4)]


@pytest.fixture(scope="session")
def make_dataset(shapes, recipes):
    """Builds a data set of the four scenes."""

    def build(sampling, network, seed=0) -> RecipeDataset:
        return RecipeDataset(recipes, {"shapes": shapes}, sampling, network, seed)

    return build


@pytest.fixture
def data(tmp_path) -> Path:
    """A folder with four training recipes and two validation recipes."""
    folder = tmp_path / "data"
    write_recipes(folder)
    return folder


@pytest.fixture
def train_shapes(shapes, data, monkeypatch):
    """`train` with the shapes as its only object set."""
    monkeypatch.setattr("icgnet.training.validation.load_object_set", lambda source: shapes)

    def run(config, out, **arguments):
        return train(config, [data], out, ["shapes"], **arguments)

    return run
