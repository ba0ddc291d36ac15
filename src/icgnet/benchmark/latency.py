"""How long a prediction takes, stage by stage, and how large the network is."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from icgnet.benchmark.pictures import Picture
from icgnet.errors import InputError
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.prediction import Prediction
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.threads import set_threads
from icgnet.predictor import Predictor

InputName = Literal["cloud", "depth"]
MESHES = "meshes"
STAGES: tuple[str, ...] = ("input", "encode", "grasps", "collision", "select", MESHES)
"""In the order in which they run; all but the last lead to ranked grasps."""


@dataclass(frozen=True)
class LatencyNumbers:
    """Time from a cloud or a depth image to ranked, collision-checked grasps, and more; all times in [ms].

    Attributes:
        median_ms: of the whole call, without meshes.
        p10_ms: one tenth of the calls is faster.
        p90_ms: one tenth of the calls is slower.
        stages_ms: median of each of `STAGES`.
        stages_p10_ms: one tenth of the stage's times is below.
        stages_p90_ms: one tenth of the stage's times is above.
        calls: that were timed.
        points: of the input, median.
        objects: that were found, mean.
        grasps: free ones that were found, mean.
        threads: CPU threads of the network.
        device: of the network.
    """

    median_ms: float
    p10_ms: float
    p90_ms: float
    stages_ms: dict[str, float]
    stages_p10_ms: dict[str, float]
    stages_p90_ms: dict[str, float]
    calls: int
    points: float
    objects: float
    grasps: float
    threads: int
    device: str


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


def untrained_predictor(preset: str, threads: int | None = None) -> Predictor:
    """A predictor with random weights, to time a network that nobody has trained.

    Raises:
        InputError: no such preset, or a number of threads below 1.
    """
    if preset not in NETWORKS:
        raise InputError(f"preset must be one of {', '.join(NETWORKS)}, got {preset!r}")
    set_threads(threads)
    torch.manual_seed(0)
    return Predictor(IcgNet(NETWORKS[preset]), load_gripper())


def model_size(network: IcgNet, weights: Path | None) -> ModelSize:
    """The size of a network, and of the file that it comes from."""
    parameters = list(network.parameters())
    return ModelSize(
        parameters=sum(p.numel() for p in parameters),
        bytes=sum(p.numel() * p.element_size() for p in parameters),
        file_bytes=None if weights is None else weights.stat().st_size,
    )


def measure_latency(
    predictor: Predictor,
    pictures: Sequence[Picture],
    repeats: int,
    source: InputName = "cloud",
    on_call: Callable[[], None] = lambda: None,
) -> LatencyNumbers:
    """Predicts every picture once without looking at the clock, then again and again.

    Args:
        predictor: what is timed.
        pictures: what is seen; those without a cloud are left out.
        repeats: timed predictions of each.
        source: what the predictor gets; the depth image comes with the camera's pose.
        on_call: called after each prediction, untimed ones included.

    Raises:
        InputError: no repeats, or no picture with a cloud.
    """
    if repeats < 1:
        raise InputError(f"repeats must be at least 1, got {repeats}")
    usable = [picture for picture in pictures if len(picture.observation.cloud)]
    if not usable:
        raise InputError(f"none of {len(pictures)} scenes gives a cloud: ask for more scenes")
    totals, stages, results = [], [], []
    for repeat in range(repeats + 1):
        for picture in usable:
            start = time.perf_counter()
            prediction = _predict(predictor, picture, source)
            total = 1e3 * (time.perf_counter() - start)
            timings = {**prediction.timings_ms, MESHES: _extract_meshes(prediction)}
            if repeat > 0:
                totals.append(total)
                stages.append([timings.get(stage, 0.0) for stage in STAGES])
                results.append((len(prediction.cloud), len(prediction.objects), len(prediction.grasps)))
            on_call()
    low, median, high = np.quantile(totals, [0.1, 0.5, 0.9])
    lows, medians, highs = (
        dict(zip(STAGES, row, strict=True)) for row in np.quantile(stages, [0.1, 0.5, 0.9], axis=0).tolist()
    )
    points, objects, grasps = np.array(results).T
    return LatencyNumbers(
        *(float(median), float(low), float(high)),
        stages_ms=medians,
        stages_p10_ms=lows,
        stages_p90_ms=highs,
        calls=len(totals),
        points=float(np.median(points)),
        objects=float(objects.mean()),
        grasps=float(grasps.mean()),
        threads=torch.get_num_threads(),
        device=str(next(predictor.network.parameters()).device),
    )


def _predict(predictor: Predictor, picture: Picture, source: InputName) -> Prediction:
    seen = picture.observation
    if source == "cloud":
        return predictor.predict_cloud(seen.cloud.points, seen.cloud.viewpoint, seen.table_height)
    return predictor.predict_depth(seen.depth, seen.intrinsics, seen.T_world_camera, seen.table_height)


def _extract_meshes(prediction: Prediction) -> float:
    """Extracts all meshes; returns the time that it took [ms]."""
    start = time.perf_counter()
    for item in prediction.objects:
        item.mesh()
    return 1e3 * (time.perf_counter() - start)
