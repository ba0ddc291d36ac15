"""How any worker makes any scene of what is to be generated."""

from dataclasses import dataclass

import numpy as np

from icgnet.datagen.config import GenerateConfig, kind_of
from icgnet.datagen.label_scene import label_scene
from icgnet.datagen.recipe import LabelHeader, Recipe
from icgnet.errors import IcgnetError
from icgnet.grasping.gripper import Gripper
from icgnet.grasping.hand_family import draw_hand
from icgnet.objects.classes import CLASSES
from icgnet.objects.object_set import ObjectSet

HAND_STREAM = 1


@dataclass(frozen=True)
class GenerateJob:
    """Everything that a worker must know to make any scene of a run; what it makes depends on nothing else.

    Attributes:
        config: what to generate.
        object_set: what scenes are made of.
        gripper: the hand, or the one that a family is mixed with.
    """

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
            hand = self.hand(number)
            return label_scene(number, config.seed, kind, config.split, self.object_set, hand, config.labels)
        except IcgnetError as error:
            raise type(error)(f"{self.name(number)}: {error}") from error
        except Exception as error:
            error.add_note(f"in {self.name(number)}")
            raise

    def hand(self, number: int) -> Gripper:
        """The hand that grasps in this scene; it has a random stream of its own, so that scenes do not depend on it."""
        if self.config.hands == "one":
            return self.gripper
        stream = np.random.SeedSequence(self.config.seed, spawn_key=(number, HAND_STREAM))
        return draw_hand(self.config.family, self.gripper, np.random.default_rng(stream))

    def name(self, number: int) -> str:
        """How messages call a scene."""
        return f"scene {number} (seed {self.config.seed})"
