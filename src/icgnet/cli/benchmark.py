"""`icgnet benchmark`: the numbers that this project reports, one subcommand each."""

from dataclasses import dataclass
from typing import Annotated

from icgnet.benchmark.config import LatencyConfig, PictureConfig
from icgnet.cli.measurement import Flat, Measurement


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
