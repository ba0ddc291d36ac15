"""How any worker makes any scene of what is to be generated."""

from dataclasses import dataclass

from icgnet.datagen.config import GenerateConfig, kind_of
from icgnet.datagen.label_scene import label_scene
from icgnet.datagen.recipe import LabelHeader, Recipe
from icgnet.errors import IcgnetError
from icgnet.grasping.gripper import Gripper
from icgnet.objects.classes import CLASSES
from icgnet.objects.object_set import ObjectSet


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
