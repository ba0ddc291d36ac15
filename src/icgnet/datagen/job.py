"""What is to be generated, and how any worker makes any scene of it."""

import re
from dataclasses import dataclass, field
from typing import Literal, get_args

from icgnet.datagen.label_scene import LabelSettings, label_scene
from icgnet.datagen.recipe import LabelHeader, Recipe
from icgnet.errors import IcgnetError, InputError
from icgnet.grasping.gripper import Gripper
from icgnet.objects.classes import CLASSES
from icgnet.objects.object_set import KINDS, SPLITS, Kind, ObjectSet, Split

SceneChoice = Literal["packed", "pile", "both"]
RAY_ADDRESS = r"local|auto|(ray://)?[^:/]+:\d+"


@dataclass(frozen=True)
class GenerateConfig:
    """What to generate.

    Attributes:
        objects: "procedural", or a folder of URDFs or meshes.
        scene: kind of scenes; "both" makes one packed scene for every two piles.
        scenes: number of scenes; a larger number continues a folder that has fewer.
        split: which objects: train, val or test.
        seed: of every random draw.
        gripper: name or YAML file.
        labels: contacts a scene, physics, jitter.
        shard_scenes: scenes in a file; a killed run loses the files that it had not finished.
        workers: processes on this machine. With 1, scenes are made in the calling process.
        ray: makes the scenes on a Ray cluster instead: "local" starts one with `workers` processors on this machine,
            "auto" or an address joins one and uses all of it.
    """

    objects: str = "procedural"
    scene: SceneChoice = "both"
    scenes: int = 100
    split: Split = "train"
    seed: int = 0
    gripper: str = "franka"
    labels: LabelSettings = field(default_factory=LabelSettings)
    shard_scenes: int = 50
    workers: int = 1
    ray: str | None = None

    def __post_init__(self) -> None:
        if self.scene not in get_args(SceneChoice):
            raise InputError(f"scene must be one of {', '.join(get_args(SceneChoice))}, got {self.scene!r}")
        if self.split not in SPLITS:
            raise InputError(f"split must be one of {', '.join(SPLITS)}, got {self.split!r}")
        for name, least in (("scenes", 1), ("seed", 0), ("shard_scenes", 1), ("workers", 1)):
            if getattr(self, name) < least:
                raise InputError(f"{name} must be at least {least}, got {getattr(self, name)}")
        if self.ray is not None and not re.fullmatch(RAY_ADDRESS, self.ray):
            raise InputError(f'ray must be "local", "auto", host:port or ray://host:port, got {self.ray!r}')

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of scenes that the run makes."""
        return KINDS if self.scene == "both" else (self.scene,)


def kind_of(choice: SceneChoice, scene_id: int) -> Kind:
    """The kind of a scene in a run."""
    if choice == "both":
        return "packed" if scene_id % 3 == 0 else "pile"
    return choice


@dataclass(frozen=True)
class GenerateJob:
    """Everything that a worker must know to make any scene of a run; what it makes depends on nothing else."""

    config: GenerateConfig
    object_set: ObjectSet
    gripper: Gripper

    @property
    def header(self) -> LabelHeader:
        """What the labels are about."""
        return LabelHeader(self.gripper, CLASSES)

    def make(self, number: int) -> Recipe:
        """The labelled scene of this number.

        Raises:
            IcgnetError: what `label_scene` raises, with the number of the scene and the seed.
        """
        config = self.config
        try:
            kind = kind_of(config.scene, number)
            return label_scene(number, config.seed, kind, config.split, self.object_set, self.gripper, config.labels)
        except IcgnetError as error:
            raise type(error)(f"{self.name(number)}: {error}") from error
        except Exception as error:
            error.add_note(f"in {self.name(number)}")
            raise

    def name(self, number: int) -> str:
        """How messages call a scene."""
        return f"scene {number} (seed {self.config.seed})"
