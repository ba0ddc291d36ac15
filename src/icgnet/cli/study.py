"""`icgnet study`: measurements that explain the numbers of the benchmark, one subcommand each."""

from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any

from icgnet.cli.measurement import Flat, Measurement
from icgnet.studies.config import (
    GraspScoresConfig,
    HandsConfig,
    LabelCeilingConfig,
    LoaderConfig,
    SensorNoiseConfig,
    SimulationConfig,
    TrainingSpeedConfig,
)


@dataclass(frozen=True, kw_only=True)
class Simulation(Measurement):
    """Scenes and grasps of the simulator beside the published ones; creep, top speeds, and the label filter."""

    config: Annotated[SimulationConfig, Flat]

    kind, module = "simulation", "icgnet.studies.simulation"


@dataclass(frozen=True, kw_only=True)
class LabelCeiling(Measurement):
    """The best that scores of grasps can reach against labels that are one draw of a jittered trial."""

    config: Annotated[LabelCeilingConfig, Flat]

    kind, module = "label-ceiling", "icgnet.studies.label_ceiling"


@dataclass(frozen=True, kw_only=True)
class GraspScores(Measurement):
    """What scores are worth where they are used: grasps of whole pictures, tried one by one."""

    config: Annotated[GraspScoresConfig, Flat]

    kind, module = "grasp-scores", "icgnet.studies.grasp_scores"


@dataclass(frozen=True, kw_only=True)
class Hands(Measurement):
    """How hands close on objects whose widths are known: time, sinking in, slip and tilt."""

    config: Annotated[HandsConfig, Flat]

    kind, module = "hands", "icgnet.studies.hands"

    def object_sources(self) -> tuple[str | Path, ...]:
        """None: its objects are boxes, cylinders and spheres."""
        return ()


@dataclass(frozen=True, kw_only=True)
class Loader(Measurement):
    """How many scenes a second one core makes ready for training."""

    config: Annotated[LoaderConfig, Flat]

    kind, module = "loader", "icgnet.studies.loader"


@dataclass(frozen=True, kw_only=True)
class TrainingSpeed(Measurement):
    """Where the time of a training step goes, how many scenes a second are trained, and the FLOPs of a scene."""

    config: Annotated[TrainingSpeedConfig, Flat]

    kind, module = "training-speed", "icgnet.studies.training_speed"


@dataclass(frozen=True, kw_only=True)
class SensorNoise(Measurement):
    """Noise and edges of real depth images beside simulated ones of the same cameras."""

    config: Annotated[SensorNoiseConfig, Flat]

    kind, module = "sensor-noise", "icgnet.studies.sensor_noise"

    def measure(self, module: ModuleType) -> Any:
        """The numbers; histograms go into the folder of the report as well."""
        numbers = super().measure(module)
        if self.out is not None:
            module.draw(numbers, self.out / "sensor_noise.png")
        return numbers
