"""`icgnet benchmark`: the numbers that this project reports, one subcommand each."""

from dataclasses import dataclass
from typing import Annotated

import tyro

from icgnet.benchmark.config import LatencyConfig, PictureConfig
from icgnet.cli.benchmark_clutter import Clutter
from icgnet.cli.benchmark_report import Report
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
    """Time of each stage from a cloud or depth image to ranked, collision-checked grasps; size of the model."""

    config: Annotated[LatencyConfig, Flat]

    kind, module = "latency", "icgnet.benchmark.latency"


@dataclass(frozen=True)
class Benchmark:
    """Measure what this project claims."""

    number: Annotated[
        Annotated[Clutter, tyro.conf.subcommand("clutter")]
        | Annotated[Reconstruction, tyro.conf.subcommand("reconstruction")]
        | Annotated[Segmentation, tyro.conf.subcommand("segmentation")]
        | Annotated[Latency, tyro.conf.subcommand("latency")]
        | Annotated[Report, tyro.conf.subcommand("report")],
        tyro.conf.arg(name=""),
    ]
    """What to measure."""

    def run(self) -> None:
        """Measures."""
        self.number.run()
