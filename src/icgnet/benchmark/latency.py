"""How long a prediction takes, stage by stage, and how large the network is."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
import torch

from icgnet.benchmark.config import LatencyConfig
from icgnet.benchmark.pictures import Picture, load_pictures
from icgnet.benchmark.record import origin
from icgnet.benchmark.tables import Table
from icgnet.errors import InputError
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.prediction import Prediction
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.threads import set_threads
from icgnet.network.weights_header import DEFAULT_WEIGHTS
from icgnet.predictor import Predictor
from icgnet.settings import check_choice

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
        model: size of the network.
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
    model: "ModelSize"


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


def untrained_predictor(preset: str, threads: int | None = None, gripper: str | Path = "franka") -> Predictor:
    """A predictor with random weights, to time a network that nobody has trained.

    Raises:
        InputError: no such preset or gripper, or a number of threads below 1.
        DataError: the gripper cannot be used.
    """
    check_choice("preset", preset, tuple(NETWORKS))
    set_threads(threads)
    torch.manual_seed(0)
    return Predictor(IcgNet(replace(NETWORKS[preset], gripper=load_gripper(gripper))))


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
    if config.preset is None:
        predictor, file = Predictor.load(config.weights, config.threads, config.gripper), config.weights
        file = DEFAULT_WEIGHTS if file is None else file
    else:
        predictor, file = untrained_predictor(config.preset, config.threads, config.gripper), None
    pictures = list(load_pictures(config, predictor.gripper))
    return time_predictions(predictor, pictures, config.repeats, config.input, file)


def tables(numbers: LatencyNumbers) -> list[Table]:
    """What is printed."""
    rows = [_row(numbers, stage, stage) for stage in numbers.stages_ms if stage != MESHES]
    whole = f"{numbers.p10_ms:.0f} to {numbers.p90_ms:.0f}"
    rows.append(("whole, to ranked grasps", f"{numbers.median_ms:.0f}", whole))
    rows.append(_row(numbers, MESHES, "then: meshes of all objects"))
    size = numbers.model
    file = "" if size.file_bytes is None else f", {size.file_bytes / 1e6:.1f} MB on disk"
    note = (
        f"{numbers.calls} calls; {numbers.points:.0f} points, {numbers.objects:.1f} objects, "
        f"{numbers.grasps:.0f} grasps; {numbers.device}, {numbers.threads} threads, {origin().processor}; "
        f"{size.parameters / 1e6:.2f} M parameters, {size.bytes / 1e6:.1f} MB in memory{file}"
    )
    return [Table(("stage, ms", "median", "10th to 90th percentile"), rows, notes=(note,))]


def _row(numbers: LatencyNumbers, stage: str, name: str) -> tuple[str, str, str]:
    spread = f"{numbers.stages_p10_ms[stage]:.0f} to {numbers.stages_p90_ms[stage]:.0f}"
    return name, f"{numbers.stages_ms[stage]:.0f}", spread


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
        device=str(predictor.network.device),
        model=model_size(predictor.network, weights),
    )


def _predict(predictor: Predictor, picture: Picture, source: str) -> Prediction:
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
