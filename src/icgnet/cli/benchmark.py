"""`icgnet benchmark`: the numbers that this project reports, one subcommand each."""

from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Annotated

import tyro

from icgnet.benchmark.config import CapturesConfig, LatencyConfig, PictureConfig, TargetConfig
from icgnet.cli.measurement import Flat, Measurement
from icgnet.errors import InputError

if TYPE_CHECKING:
    from icgnet.benchmark.captures import CaptureNumbers
    from icgnet.benchmark.target import TargetNumbers


@dataclass(frozen=True, kw_only=True)
class Reconstruction(Measurement):
    """Predicted shapes against true ones: IoU, Chamfer-L1 and F-score, for whole scenes and single objects."""

    config: Annotated[PictureConfig, Flat]

    kind, module = "reconstruction", "icgnet.benchmark.reconstruction"


@dataclass(frozen=True, kw_only=True)
class Segmentation(Measurement):
    """Predicted instances against true ones: mIoU, AP50, panoptic quality, classes and their confusion."""

    config: Annotated[PictureConfig, Flat]

    kind, module = "segmentation", "icgnet.benchmark.segmentation"


@dataclass(frozen=True, kw_only=True)
class Latency(Measurement):
    """Time of each stage from a cloud or depth image to grasps, ranked and checked for collision; size of the model."""

    config: Annotated[LatencyConfig, Flat]

    kind, module = "latency", "icgnet.benchmark.latency"


@dataclass(frozen=True, kw_only=True)
class Target(Measurement):
    """Grasp one named object, hidden more or less by others, in one attempt: success by occlusion, and failures."""

    config: Annotated[TargetConfig, Flat]
    workers: int = 1
    """Processes; every scene draws the same whatever their number is."""

    kind, module = "target", "icgnet.benchmark.target"

    def measure(self, module: ModuleType) -> "TargetNumbers":
        """The numbers.

        Raises:
            IcgnetError: unknown planner, unusable objects or weights.
        """
        return module.measure(self.config, self.workers)


@dataclass(frozen=True, kw_only=True)
class Captures(Measurement):
    """Objects and grasps in real frames against labels or clicks; the support and the time. --out draws the frames."""

    config: Annotated[CapturesConfig, Flat, tyro.conf.PositionalRequiredArgs]
    gallery: int = 12
    """With --out, draw so many of the worst frames large, with what went wrong."""

    kind, module = "captures", "icgnet.benchmark.captures"

    def measure(self, module: ModuleType) -> "CaptureNumbers":
        """The numbers; draws the frames if there is a folder for them.

        Raises:
            IcgnetError: unusable frames or weights, or a gallery of less than no frames.
        """
        if self.gallery < 0:
            raise InputError(f"gallery must be at least 0 frames, got {self.gallery}")
        if self.out is None:
            return module.measure(self.config)
        from icgnet.benchmark.capture_pictures import CapturePictures

        pictures = CapturePictures(self.out)
        numbers = module.measure(self.config, pictures.draw)
        pictures.collect(numbers.rows, self.gallery)
        return numbers

    def object_sources(self) -> tuple[str, ...]:
        """No object sets."""
        return ()
