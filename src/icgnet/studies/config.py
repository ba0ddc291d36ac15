"""What decides the numbers of the studies; nothing heavy is imported here."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from icgnet.benchmark.config import NoiseName
from icgnet.inference.grasp_search import DEFAULT_SEARCH, GraspSearch
from icgnet.objects.kinds import Kind, Split
from icgnet.settings import check_choices, check_range

FEWEST_REPEATS = 3.0


@dataclass(frozen=True)
class SimulationConfig:
    """Scenes and grasps of the simulator beside the published ones; creep, top speeds, and the label filter."""

    objects: Path
    """Folder of the VGN object set."""
    split: Split = "test"
    """Which objects the scenes are made of."""
    scenes: int = 60
    """Scenes of each kind."""
    trials: int = 2000
    """Trials whose filtered decision is compared with the whole physics."""
    seed: int = 0
    """Of every random draw."""
    gripper: str = "franka"
    """Name of a hand that ships with the package, or a gripper file. The published grasps were made with franka."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 1.0, "scenes", "trials")
        check_range(self, 0.0, "seed")


@dataclass(frozen=True)
class LabelCeilingConfig:
    """The best that scores of grasps can reach against labels that are one draw of a jittered trial."""

    objects: str = "procedural"
    """Object set of the scenes."""
    split: Split = "val"
    """Which objects the scenes are made of."""
    scenes: int = 30
    """Scenes of each kind."""
    repeats: int = 8
    """How often each trial is repeated, with other jitter, mass and friction."""
    contacts: int = 16
    """Contacts of each scene; each is tried at all angles."""
    seed: int = 0
    """Of the scenes and trials."""
    gripper: str = "franka"
    """Name of a hand that ships with the package, or a gripper file."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 1.0, "scenes", "contacts")
        check_range(self, FEWEST_REPEATS, "repeats")
        check_range(self, 0.0, "seed")


@dataclass(frozen=True)
class GraspScoresConfig:
    """What scores are worth where they are used: grasps of whole pictures, tried one by one."""

    objects: str = "procedural"
    """Object set of the scenes."""
    scene: Kind = "table"
    """Kind of scenes."""
    split: Split = "val"
    """Which objects the scenes are made of."""
    noise: NoiseName = "stereo"
    """What the sensor does."""
    pictures: int = 30
    """How many scenes, with one picture each."""
    grasps: int = 10
    """So many of the best grasps of a picture are tried, so many others, and the best of each object."""
    seed: int = 1
    """Of every random draw."""
    gripper: str = "franka"
    """Name of a hand that ships with the package, or a gripper file; the network must know it."""
    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    threads: int = 1
    """CPU threads of the network."""
    search: GraspSearch = DEFAULT_SEARCH
    """How grasps are looked for; all of a picture are, whatever `most` says."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 1.0, "pictures", "grasps", "threads")
        check_range(self, 0.0, "seed")


@dataclass(frozen=True)
class HandsConfig:
    """How hands close on objects whose widths are known: time, sinking in, slip and tilt."""

    grippers: tuple[str, ...] = ("franka", "robotiq_2f_85", "robotiq_2f_140", "wsg_50", "xarm")
    """Names of hands that ship with the package, or gripper files."""
    extremes: bool = True
    """Also members of the hand family at the ends of its ranges."""
    mass: float = 0.7
    """Of the objects [kg]."""
    friction: float = 0.6
    """Of the pads."""
    seed: int = 0
    """Of what is drawn of the members."""

    def __post_init__(self) -> None:
        check_range(self, 0.0, "mass", "friction", above=True)
        check_range(self, 0.0, "seed")


@dataclass(frozen=True)
class TrainingScenes:
    """Scenes as a training preset reads them."""

    data: tuple[Path, ...]
    """Folders that `icgnet generate` wrote; they name the hand."""
    objects: tuple[str, ...] = ("procedural",)
    """The object sets that the scenes were made of."""
    preset: Literal["tiny", "cpu", "paper"] = "cpu"
    """Training preset."""


@dataclass(frozen=True)
class LoaderConfig(TrainingScenes):
    """How many scenes a second one core makes ready for training."""

    visits: int = 60
    """Visits to time."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 1.0, "visits")


@dataclass(frozen=True)
class TrainingSpeedConfig(TrainingScenes):
    """Where the time of a training step goes, how many scenes a second are trained, and the FLOPs of a scene.

    Started by torchrun, all processes train together.
    """

    steps: int = 20
    """Steps to time, after up to 16 that are not: their FLOPs are counted."""
    network: Literal["tiny", "default", "paper"] | None = None
    """Network in place of the preset's."""
    batch: int | None = None
    """Scenes per step, in each process, in place of the preset's."""
    common_statistics: bool | None = None
    """Whether processes share the statistics of their batches, in place of the preset's."""
    accelerator: Literal["auto", "cpu", "gpu"] = "auto"
    """What to compute on; auto takes a GPU where there is one."""
    threads: int | None = None
    """CPU threads in place of the preset's."""
    seed: int = 0
    """Of the weights and of every draw."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 1.0, "steps", "batch", "threads")
        check_range(self, 0.0, "seed")


@dataclass(frozen=True)
class SensorNoiseConfig:
    """Noise, holes and edges of real depth images beside those of simulated ones of the same cameras."""

    captures: Path
    """Folder of frames as for `benchmark captures`; what names its `camera` in camera.json or NAME.json counts."""
    objects: str = "procedural"
    """Object set of the simulated scenes."""
    split: Split = "val"
    """Which objects the scenes are made of."""
    images: int = 12
    """Simulated images of each camera, at the distances and tilts of its real frames."""
    seed: int = 0
    """Of every random draw."""

    def __post_init__(self) -> None:
        check_choices(self)
        check_range(self, 1.0, "images")
        check_range(self, 0.0, "seed")
