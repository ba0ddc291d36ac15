"""Scenes and pictures for the numbers of the network: those with which the rounds of the clutter benchmark begin."""

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

import torch

from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.observation import NoiseName, Observation, ViewName, observe
from icgnet.benchmark.rounds import CAMERA, random_stream, round_scene
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.errors import InputError
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import Prediction
from icgnet.network.weights_header import stored_checksum
from icgnet.objects.kinds import Kind, Split
from icgnet.objects.object_set import ObjectSet
from icgnet.predictor import Predictor


@dataclass(frozen=True)
class PictureConfig:
    """Which pictures a number is measured on.

    Attributes:
        kind: of scenes.
        split: which objects.
        view: where the camera may stand.
        noise: what the sensor does.
        scenes: how many, with one picture each.
        seed: of every random draw.
    """

    kind: Kind = "packed"
    split: Split = "test"
    view: ViewName = "random"
    noise: NoiseName = "gaussian"
    scenes: int = 20
    seed: int = 1

    def __post_init__(self) -> None:
        if self.scenes < 1:
            raise InputError(f"scenes must be at least 1, got {self.scenes}")
        _ = self.clutter  # which checks the rest

    @property
    def clutter(self) -> ClutterConfig:
        """The clutter benchmark whose run 0 has these scenes."""
        return ClutterConfig(
            scene=self.kind,
            split=self.split,
            view=self.view,
            noise=self.noise,
            runs=1,
            rounds=self.scenes,
            seed=self.seed,
        )


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


def take_picture(config: PictureConfig, index: int, object_set: ObjectSet, gripper: Gripper) -> Picture:
    """The picture of this number; scene and camera depend on the seed and the number only.

    Raises:
        InputError: the object set has nothing for this kind and split.
    """
    scene = round_scene(config.clutter, 0, index, object_set)
    rng = random_stream(config.clutter, 0, index, CAMERA, 0)
    observation = observe(scene, object_set, config.view, config.noise, gripper, full_opening=True, rng=rng)
    return Picture(index, TrueShapes(scene, object_set), observation)


def take_pictures(config: PictureConfig, object_set: ObjectSet, gripper: Gripper) -> Iterator[Picture]:
    """The pictures of all scenes, one after the other.

    Raises:
        InputError: the object set has nothing for this kind and split.
    """
    for index in range(config.scenes):
        yield take_picture(config, index, object_set, gripper)


def settings(config: PictureConfig, objects: str, weights: Path | None) -> dict[str, object]:
    """What the numbers of a network depend on, for a report.

    Args:
        config: which pictures.
        objects: source of the object set.
        weights: file of the network's weights; None if it is untrained.

    Raises:
        DataError: the weights cannot be read.
    """
    checksum = None if weights is None else stored_checksum(weights)
    return {"objects": objects, **asdict(config), "weights": checksum, "threads": torch.get_num_threads()}
