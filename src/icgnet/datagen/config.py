"""What is to be generated; nothing heavy is imported here."""

import re
from dataclasses import dataclass, field
from typing import Literal

from icgnet.errors import InputError
from icgnet.grasping.hand_family import HandFamily
from icgnet.objects.kinds import KINDS, Kind, Split
from icgnet.settings import check_choices, check_range
from icgnet.simulation.config import Jitter, Physics, WideScenes

SceneChoice = Literal["packed", "pile", "both", "table", "bin", "wide", "all"]
TURNS: dict[SceneChoice, tuple[Kind, ...]] = {
    **{kind: (kind,) for kind in KINDS},
    "both": ("packed", "pile", "pile"),
    "wide": ("table", "table", "bin"),
    "all": ("packed", "table", "pile", "table", "pile", "bin"),
}
"""The kinds of successive scenes of a run."""
RAY_ADDRESS = r"local|auto|(ray://)?[^:/]+:\d+"


@dataclass(frozen=True)
class Variation:
    """Ranges of what is drawn once a scene for the label trials (scenes themselves settle with fixed physics)."""

    mass: tuple[float, float] = (0.3, 0.7)
    """Of every object of a packed or pile scene [kg]."""
    density: tuple[float, float] = (200.0, 800.0)
    """Of all objects of a table or bin [kg/m^3]."""
    pad_friction: tuple[float, float] = (0.6, 0.9)
    """Sliding friction of the finger pads."""

    def __post_init__(self) -> None:
        for name, (lower, upper) in vars(self).items():
            if not 0.0 < lower <= upper:
                raise InputError(f"variation {name} must be a range of positive numbers, got ({lower}, {upper})")


@dataclass(frozen=True)
class LabelSettings:
    """How scenes are labelled."""

    contacts: int = 48
    """Contacts that are tried in each packed or pile scene, at twelve angles each."""
    contacts_per_object: int = 16
    """Contacts that are tried on each object of a table or bin."""
    object_count: int | None = None
    """Objects to try for in every scene; drawn anew for each if None."""
    wide: WideScenes = field(default_factory=WideScenes)
    """How large tables and bins are, and what is on them."""
    physics: Physics = field(default_factory=Physics)
    """Engine and materials."""
    jitter: Jitter = field(default_factory=Jitter)
    """Drawn anew for each trial."""
    variation: Variation = field(default_factory=Variation)
    """Drawn anew for each scene."""

    def __post_init__(self) -> None:
        check_range(self, 1.0, "contacts", "contacts_per_object", "object_count")
        usual = Physics()
        for name, drawn in (("object_mass", "mass"), ("density", "density"), ("pad_friction", "pad_friction")):
            if getattr(self.physics, name) != getattr(usual, name):
                raise InputError(f"physics.{name} is drawn anew for each scene: set variation.{drawn} instead")


@dataclass(frozen=True)
class GenerateConfig:
    """What to generate."""

    objects: str = "procedural"
    """'procedural', or a folder of URDFs (VGN layout) or meshes; several, separated by commas, are mixed."""
    scene: SceneChoice = "both"
    """Kind of scenes. both: one packed scene for every two piles; wide: two tables for every bin; all: both and wide in
    turns."""
    scenes: int = 100
    """Number of scenes; a larger number continues a folder that has fewer."""
    split: Split = "train"
    """Which objects."""
    seed: int = 0
    """Of every random draw."""
    gripper: str = "franka"
    """Name of a gripper that ships with the package, or a gripper file."""
    hands: Literal["one", "family"] = "one"
    """Grasp with that hand in all scenes, or, but for a share of them, with hands that are drawn from a family."""
    family: HandFamily = field(default_factory=HandFamily)
    """The hands to draw from."""
    labels: LabelSettings = field(default_factory=LabelSettings)
    """How scenes are labelled."""
    shard_scenes: int = 50
    """Scenes in a file; a killed run loses the files that it had not finished."""
    workers: int = 1
    """Processes on this machine; the result does not depend on it. With 1, scenes are made in the calling process."""
    ray: str | None = None
    """Work on a Ray cluster instead: 'local' starts one here with so many workers, 'auto' or HOST:PORT joins one."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 1.0, "scenes", "shard_scenes", "workers")
        check_range(self, 0.0, "seed")
        if self.ray is not None and not re.fullmatch(RAY_ADDRESS, self.ray):
            raise InputError(f'ray must be "local", "auto", host:port or ray://host:port, got {self.ray!r}')

    @property
    def kinds(self) -> tuple[Kind, ...]:
        """The kinds of scenes that the run makes."""
        return tuple(kind for kind in KINDS if kind in TURNS[self.scene])


def kind_of(choice: SceneChoice, scene_id: int) -> Kind:
    """The kind of a scene in a run."""
    turns = TURNS[choice]
    return turns[scene_id % len(turns)]
