"""How long a prediction takes, stage by stage, and how large the network is."""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from icgnet.benchmark.config import LatencyConfig
from icgnet.benchmark.pictures import Picture, take_pictures
from icgnet.benchmark.statistics import Quantiles
from icgnet.benchmark.tables import Table
from icgnet.errors import InputError
from icgnet.machine import processor
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights_header import DEFAULT_WEIGHTS
from icgnet.predictor import Predictor

WHOLE, MESHES = "whole", "meshes"
STAGES: tuple[str, ...] = ("input", "encode", "grasps", "collision", "select", MESHES)
"""In the order in which they run; all but the last lead to ranked grasps."""


@dataclass(frozen=True)
class ModelSize:
    """How large a network is.

    Attributes:
        parameters: number of trained values.
        bytes: that they take in memory.
        file_bytes: size of the weights file, if there is one.
    """

    parameters: int
    bytes: int
    file_bytes: int | None


@dataclass(frozen=True)
class PictureTime:
    """How long one picture takes, and what it shows.

    Attributes:
        edges: of the cube, the table or the bin, the longer one first [m].
        standing: objects that stand there.
        points: of the input.
        objects: that were found.
        whole_ms: time of the whole call, without meshes [ms].
    """

    edges: tuple[float, float]
    standing: int
    points: int
    objects: int
    whole_ms: Quantiles


@dataclass(frozen=True)
class LatencyNumbers:
    """Time from a cloud or a depth image to ranked, collision-checked grasps, and more.

    Attributes:
        whole_ms: time of the whole call, without meshes [ms].
        stages_ms: time of each of `STAGES` [ms].
        calls: that were timed.
        points: of the input, median.
        objects: that were found, mean.
        grasps: free ones that were found, mean.
        threads: CPU threads of the network.
        device: of the network.
        model: size of the network.
        pictures: the same for every picture.
    """

    whole_ms: Quantiles
    stages_ms: dict[str, Quantiles]
    calls: int
    points: float
    objects: float
    grasps: float
    threads: int
    device: str
    model: ModelSize
    pictures: list[PictureTime]


def model_size(network: IcgNet, weights: Path | None) -> ModelSize:
    """The size of a network, and of the file that it comes from."""
    parameters = list(network.parameters())
    return ModelSize(
        parameters=sum(p.numel() for p in parameters),
        bytes=sum(p.numel() * p.element_size() for p in parameters),
        file_bytes=None if weights is None else weights.stat().st_size,
    )


def measure(config: LatencyConfig) -> LatencyNumbers:
    """The times of the pictures of a configuration.

    Raises:
        IcgnetError: unusable objects, weights or gripper, or no scene with a cloud.
    """
    predictor = Predictor.load(config.weights, config.threads, config.gripper)
    pictures = list(take_pictures(config, predictor.gripper, config.wide))
    return time_predictions(predictor, pictures, config.repeats, config.input, config.weights or DEFAULT_WEIGHTS)


def tables(numbers: LatencyNumbers) -> list[Table]:
    """What is printed."""
    times = {stage: numbers.stages_ms[stage] for stage in STAGES if stage != MESHES}
    times |= {"whole, to ranked grasps": numbers.whole_ms, "then: meshes of all objects": numbers.stages_ms[MESHES]}
    size = numbers.model
    file = "" if size.file_bytes is None else f", {size.file_bytes / 1e6:.1f} MB on disk"
    note = (
        f"{numbers.calls} calls; {numbers.points:.0f} points, {numbers.objects:.1f} objects, "
        f"{numbers.grasps:.0f} grasps; {numbers.device}, {numbers.threads} threads, {processor()}; "
        f"{size.parameters / 1e6:.2f} M parameters, {size.bytes / 1e6:.1f} MB in memory{file}"
    )
    spread = "median (10th to 90th percentile)"
    rows = [(name, f"{time:.0f}") for name, time in times.items()]
    by_picture = [
        (
            f"{each.edges[0]:.2f} x {each.edges[1]:.2f}",
            *(str(count) for count in (each.standing, each.objects, each.points)),
            f"{each.whole_ms:.0f}",
        )
        for each in sorted(numbers.pictures, key=lambda each: each.points)
    ]
    heads = ("extent, m", "objects", "found", "points", f"whole, ms: {spread}")
    return [Table(("stage, ms", spread), rows, notes=(note,)), Table(heads, by_picture, "By picture")]


def time_predictions(
    predictor: Predictor,
    pictures: Sequence[Picture],
    repeats: int,
    source: Literal["cloud", "depth"] = "cloud",
    weights: Path | None = None,
) -> LatencyNumbers:
    """Predicts every picture once without looking at the clock, then again and again.

    Args:
        predictor: what is timed.
        pictures: what is seen; those without a cloud are left out.
        repeats: timed predictions of each.
        source: what the predictor gets; the depth image comes with the camera's pose.
        weights: file of the network, if it comes from one.

    Raises:
        InputError: no picture with a cloud.
    """
    usable = [picture for picture in pictures if len(picture.observation.cloud)]
    if not usable:
        raise InputError(f"none of {len(pictures)} scenes gives a cloud: ask for more scenes")
    for picture in usable:
        _time_prediction(predictor, picture, source)
    # Picture by picture in turn, so that what else the machine does meets all of them alike.
    turns = [[_time_prediction(predictor, picture, source) for picture in usable] for _ in range(repeats)]
    by_picture = list(zip(*turns, strict=True))
    timed = [each for turn in turns for each in turn]
    points, objects, grasps = np.array([found for _, *found in timed]).T
    return LatencyNumbers(
        whole_ms=Quantiles.of(times[WHOLE] for times, *_ in timed),
        stages_ms={stage: Quantiles.of(times.get(stage, 0.0) for times, *_ in timed) for stage in STAGES},
        calls=len(timed),
        points=float(np.median(points)),
        objects=float(objects.mean()),
        grasps=float(grasps.mean()),
        threads=torch.get_num_threads(),
        device=str(predictor.network.device),
        model=model_size(predictor.network, weights),
        pictures=[_of_picture(picture, timed) for picture, timed in zip(usable, by_picture, strict=True)],
    )


def _of_picture(picture: Picture, timed: Sequence[tuple[dict[str, float], int, int, int]]) -> PictureTime:
    _, points, objects, _ = timed[0]
    lower, upper = picture.truth.scene.surroundings.bounds
    longer, shorter = sorted((upper - lower).tolist(), reverse=True)
    return PictureTime(
        (longer, shorter), len(picture.truth), points, objects, Quantiles.of(times[WHOLE] for times, *_ in timed)
    )


def _time_prediction(predictor: Predictor, picture: Picture, source: str) -> tuple[dict[str, float], int, int, int]:
    """Time of each stage and of the whole [ms]; numbers of points, objects and grasps."""
    seen, start = picture.observation, time.perf_counter()
    if source == "cloud":
        found = predictor.predict_cloud(seen.cloud.points, seen.cloud.viewpoint, seen.table_height)
    else:
        found = predictor.predict_depth(seen.depth, seen.intrinsics, seen.T_world_camera, seen.table_height)
    ready = time.perf_counter()
    for item in found.objects:
        item.mesh()
    times = {WHOLE: 1e3 * (ready - start), MESHES: 1e3 * (time.perf_counter() - ready)}
    return found.timings_ms | times, len(found.cloud), len(found.objects), len(found.grasps)
