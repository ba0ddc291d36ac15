"""Scenes and pictures for the numbers of the network: those with which the rounds of the clutter benchmark begin."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

from rich.console import Console
from rich.progress import track

from icgnet.benchmark.config import WIDE, PictureConfig
from icgnet.benchmark.observation import Observation, observe
from icgnet.benchmark.rounds import CAMERA, random_stream, round_scene
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.errors import InputError
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import Prediction
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.predictor import Predictor
from icgnet.simulation.config import WideScenes

Measured = TypeVar("Measured")
ItemT = TypeVar("ItemT")


@dataclass(frozen=True, eq=False)
class Picture:
    """One picture of a scene, and the truth about it.

    Attributes:
        index: number of the scene.
        truth: the shapes that stand there.
        observation: what the camera saw.
    """

    index: int
    truth: TrueShapes
    observation: Observation

    def predict(self, predictor: Predictor) -> Prediction | None:
        """What the network makes of the cloud; None if there is no cloud."""
        cloud = self.observation.cloud
        if len(cloud) == 0:
            return None
        return predictor.predict_cloud(cloud.points, cloud.viewpoint, self.observation.table_height)


def progress_bar(items: Iterable[ItemT], what: str, total: int | None = None) -> Iterable[ItemT]:
    """The items, with a bar on standard error, if that is a terminal, that shows how many have been taken.

    How many there are is to be given where the items have no length.
    """
    console = Console(stderr=True)
    return track(items, what, total, console=console, transient=True, disable=not console.is_terminal)


def take_picture(
    config: PictureConfig, index: int, object_set: ObjectSet, gripper: Gripper, wide: WideScenes = WIDE
) -> Picture:
    """The picture of this number; scene and camera depend on the seed and the number only, and tables on `wide`.

    Raises:
        InputError: the object set has nothing for this kind and split.
    """
    scene = round_scene(config, 0, index, object_set, wide)
    rng = random_stream(config, 0, index, CAMERA, 0)
    observation = observe(scene, object_set, config.view, config.noise, gripper, full_opening=True, rng=rng)
    return Picture(index, TrueShapes(scene, object_set), observation)


def take_pictures(config: PictureConfig, gripper: Gripper, wide: WideScenes = WIDE) -> Iterator[Picture]:
    """All pictures, one after the other; `wide` says what tables and bins are like.

    Raises:
        IcgnetError: unusable objects, or a set that has nothing for this kind and split.
    """
    object_set = load_object_set(config.objects)
    for index in progress_bar(range(config.scenes), "scenes"):
        yield take_picture(config, index, object_set, gripper, wide)


def score_pictures(
    config: PictureConfig, predictor: Predictor, score: Callable[[Picture, Prediction | None], Measured | None]
) -> list[Measured]:
    """What was measured on each picture of a configuration.

    Args:
        config: which pictures.
        predictor: the network.
        score: measures a picture and what the network made of it; None leaves the scene out.

    Raises:
        IcgnetError: unusable objects, or no scene that could be measured.
    """
    results = (score(each, each.predict(predictor)) for each in take_pictures(config, predictor.gripper))
    measured = [result for result in results if result is not None]
    if not measured:
        raise InputError(f"none of {config.scenes} scenes has an object that can be seen: ask for more scenes")
    return measured
