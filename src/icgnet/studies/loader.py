"""How many scenes a second training reads on one core: camera, noise, ids, occupancy and labels from recipes."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from icgnet.benchmark.statistics import Quantiles
from icgnet.benchmark.tables import Table
from icgnet.studies.config import LoaderConfig
from icgnet.training.config import TRAININGS, TrainingConfig
from icgnet.training.dataset import RecipeDataset, network_for
from icgnet.training.validation import load_object_sets, recipes_of_split

WARM_UP = 5  # visits before the clock runs: lookup tables are made at the first ones


@dataclass(frozen=True)
class LoaderNumbers:
    """What some training visits take on one core.

    Attributes:
        visits: how many were timed.
        visit_ms: time of a visit.
        scenes_per_second: visits by their summed time.
    """

    visits: int
    visit_ms: Quantiles
    scenes_per_second: float


def measure(config: LoaderConfig) -> LoaderNumbers:
    """Makes the first samples of a training run, one after the other, on one thread.

    Raises:
        DataError: no usable recipes, or a missing object set.
    """
    torch.set_num_threads(1)
    return time_visits(load_dataset(config.data, config.objects, TRAININGS[config.preset]), config.visits)


def tables(numbers: LoaderNumbers) -> list[Table]:
    """What is printed."""
    row = (f"{numbers.scenes_per_second:.1f}", f"{numbers.visit_ms:.0f}", str(numbers.visits))
    return [Table(("scenes a second on one core", "ms a visit, median (10th to 90th percentile)", "visits"), [row])]


def load_dataset(data: Sequence[Path], objects: Sequence[str | Path], config: TrainingConfig) -> RecipeDataset:
    """The samples of a training run on some folders.

    Raises:
        DataError: no recipes of split "train", or a missing object set.
    """
    recipes, header = recipes_of_split(data, "train")
    network = network_for(config.network, header)
    return RecipeDataset(recipes, load_object_sets(objects), config.sampling, network, config.seed)


def time_visits(dataset: RecipeDataset, visits: int) -> LoaderNumbers:
    """Makes samples one after the other; the first few are not timed."""
    for visit in range(WARM_UP):
        dataset[visit]
    times = []
    for visit in range(WARM_UP, WARM_UP + visits):
        start = time.perf_counter()
        dataset[visit]
        times.append(1e3 * (time.perf_counter() - start))
    return LoaderNumbers(visits, Quantiles.of(times), 1e3 * visits / sum(times))
