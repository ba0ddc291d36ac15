"""How good weights are on scenes of held-out objects, seen by fixed cameras."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from torch.utils.data import DataLoader, Dataset

from icgnet.datagen.recipe import LabelHeader, Recipe
from icgnet.errors import DataError
from icgnet.network.config import NetworkConfig
from icgnet.network.threads import set_threads
from icgnet.network.weights import load_weights
from icgnet.objects.classes import known_class
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.training.config import TRAININGS, Sampling
from icgnet.training.dataset import RecipeDataset, gather_recipes
from icgnet.training.interrupts import ignore_interrupts
from icgnet.training.metrics import GraspTally, count_scenes, summarise
from icgnet.training.sample import Sample

VALIDATION_SEED = 20_000


def load_object_sets(sources: Sequence[str | Path]) -> dict[str, ObjectSet]:
    """The object sets of the sources, by name; see `load_object_set`."""
    object_sets = [load_object_set(source) for source in sources]
    return {each.name: each for each in object_sets}


def recipes_of_split(data: Sequence[Path], split: str, any_hand: bool = False) -> tuple[list[Recipe], LabelHeader]:
    """All recipes of a split in the folders, and what their labels are about; `any_hand` mixes those of several.

    Raises:
        DataError: there are none, a folder is not readable, or the folders are of unlike hands or classes.
    """
    everything, header = gather_recipes(data, any_hand)
    recipes = [recipe for recipe in everything if recipe.split == split]
    if not recipes:
        raise DataError(f"no recipes of split {split!r} in {', '.join(map(str, data))}")
    return recipes, header


def known_recipes(network: NetworkConfig, data: Sequence[Path], split: str) -> list[Recipe]:
    """All recipes of a split in the folders, labelled with the hand that a network knows.

    Classes that the network does not know count as "other".

    Raises:
        InputError: the labels are of another hand, or of unknown classes, and the network has no class "other".
        DataError: see `recipes_of_split`.
    """
    recipes, header = recipes_of_split(data, split, network.any_hand)
    whose = f"the scenes in {', '.join(map(str, data))}"
    network.check_hand(header.gripper, whose)
    for name in header.classes:
        known_class(name, network.classes)
    return recipes


def validation_samples(
    network: NetworkConfig,
    sampling: Sampling,
    scenes: int,
    recipes: Sequence[Recipe],
    object_sets: dict[str, ObjectSet],
    apart: bool = False,
) -> list[Sample]:
    """Samples with fixed cameras, the same at every validation; none when there are no recipes.

    Args:
        network: configuration of the network that the samples are for.
        sampling: of the training; augmentation is switched off.
        scenes: at most so many recipes are used, drawn once and for all.
        recipes: of scenes that are not trained on; those that show nothing are left out.
        object_sets: what the recipes are made of, by name.
        apart: make them in another process. Whoever forks afterwards must not have traced rays itself: the threads that
            embree starts for that are missing in a child, which may then wait for them for ever.
    """
    chosen = draw_scenes(recipes, scenes)
    if not chosen:
        return []
    dataset = RecipeDataset(chosen, object_sets, sampling.for_validation(), network, VALIDATION_SEED)
    looks = _Looks(dataset)
    samples = DataLoader(
        looks, batch_size=None, collate_fn=looks.pass_on, num_workers=int(apart), worker_init_fn=ignore_interrupts
    )
    return [sample for sample in samples if sample is not None]


class _Looks(Dataset):
    """The sample of every scene of a data set at its own visit, or None."""

    def __init__(self, dataset: RecipeDataset) -> None:
        self.dataset = dataset

    def __len__(self) -> int:
        return len(self.dataset)

    def __getitem__(self, visit: int) -> Sample | None:
        return self.dataset.look(visit)

    @staticmethod
    def pass_on(sample: Any) -> Any:
        """Hands a sample on as it is."""
        return sample


def draw_scenes(recipes: Sequence[Recipe], most: int) -> list[Recipe]:
    """At most so many of the recipes, of all kinds that there are, the same every time."""
    order = np.random.default_rng(VALIDATION_SEED).permutation(len(recipes))[:most]
    return [recipes[index] for index in order]


def evaluate_weights(
    weights: Path,
    data: Sequence[Path],
    objects: Sequence[str | Path],
    split: str = "val",
    threads: int | None = None,
) -> dict[str, dict[str, float]]:
    """Metrics of a weights file on all scenes of a split, for each kind of scene and for all together.

    Args:
        weights: a safetensors file that training wrote.
        data: folders of recipes.
        objects: sources of the object sets that the recipes name.
        split: which recipes.
        threads: CPU threads, for the whole process; as many as torch takes if None.

    Raises:
        InputError: a number of threads below 1, scenes of a hand that the weights do not know; see `known_recipes`.
        DataError: unusable weights, no such recipes, or a missing object set.
    """
    set_threads(threads)
    network, _ = load_weights(weights)
    recipes = known_recipes(network.config, data, split)
    object_sets = load_object_sets(objects)
    cpu = TRAININGS["cpu"]
    kinds = sorted({recipe.kind for recipe in recipes})
    groups = {kind: [recipe for recipe in recipes if recipe.kind == kind] for kind in kinds}
    samples = {
        kind: validation_samples(network.config, cpu.sampling, len(group), group, object_sets)
        for kind, group in groups.items()
    }
    tallies = {kind: count_scenes(network, each, cpu.matching) for kind, each in samples.items()}
    tallies["all"] = sum(tallies.values(), start=GraspTally())
    return {kind: summarise(tally) | {"scenes": tally.scenes} for kind, tally in tallies.items()}
