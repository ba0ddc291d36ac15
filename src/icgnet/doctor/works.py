"""What the processor can, what the weights know, and whether a prediction works, and how fast."""

import statistics
import time
from pathlib import Path

from icgnet.doctor.finding import Finding
from icgnet.errors import DataError, IcgnetError
from icgnet.machine import processor

USUAL_MS = 700.0
"""Of the workspace that ships with the package: two threads of an AMD EPYC, little else running (docs/log.md)."""
SLOW = 3.0
"""More than so many times as long is called slow."""
STARVED = 0.6
"""A process that computes for a smaller share of the time waits for others."""


def processor_findings() -> list[Finding]:
    """The processor, the threads that torch takes, and the precision that `auto` stands for."""
    try:
        from icgnet.network.precision import describe_auto
        from icgnet.network.threads import thread_count
    except (ImportError, OSError) as error:
        return [Finding("torch", f"cannot be imported: {_line(error)}", True, "pip install --force-reinstall torch")]
    return [
        Finding("processor", processor()),
        Finding("threads", str(thread_count()), hint="" if thread_count() > 1 else "is OMP_NUM_THREADS set to 1?"),
        Finding("precision", f"float32 unless asked for; auto takes {describe_auto()}"),
    ]


def weights_finding(path: Path | None = None) -> Finding:
    """Checksum and classes of the weights; the shipped ones if None."""
    from icgnet.network.weights_header import DEFAULT_WEIGHTS, read_header

    try:
        header = read_header(path or DEFAULT_WEIGHTS)
    except IcgnetError as error:
        return Finding("weights", _line(error), True, "install icgnet anew, or give --weights")
    classes = ", ".join(header.config.classes)
    return Finding("weights", f"sha256 {header.sha256[:8]}..., hand {header.config.gripper.name}, classes {classes}")


def prediction_finding(
    capture: Path, weights: Path | None = None, threads: int | None = None, repeat: int = 3
) -> Finding:
    """Whether the bundled capture is understood, and how long that takes.

    Args:
        capture: the bundled capture.
        weights: file; the shipped one if None.
        threads: CPU threads; as many as torch takes if None.
        repeat: the median of so many predictions is told, after one that is not counted.
    """
    try:
        wall, share, objects, grasps = _timed(capture, weights, threads, repeat)
    except Exception as error:  # whatever is wrong with an installation comes out here
        return Finding("prediction", f"failed: {type(error).__name__} {_line(error)}", True)
    value = f"{objects} objects, {grasps} grasps in {wall:.0f} ms (usual: about {USUAL_MS:.0f} ms with two threads)"
    if not objects or not grasps:
        return Finding("prediction", value, True, "the weights do not know the bundled scene: are they the right ones?")
    if wall <= SLOW * USUAL_MS:
        return Finding("prediction", value)
    if share < STARVED:
        return Finding("prediction", value, hint=f"slow: other programs hold the processor, {share:.0%} was left")
    return Finding("prediction", value, hint="slow: more --threads, or a processor with AVX2 or AVX-512")


def _timed(capture: Path, weights: Path | None, threads: int | None, repeat: int) -> tuple[float, float, int, int]:
    """Median time [ms], the share of it that a thread computed, and what was found."""
    from icgnet.inference.capture import DepthCapture, read_capture
    from icgnet.predictor import Predictor

    content = read_capture(capture)
    if not isinstance(content, DepthCapture):
        raise DataError(f"{capture} is not a depth capture")
    predictor = Predictor.load(weights, threads)
    walls, shares, result = [], [], None
    for _ in range(repeat + 1):
        begun, computed = time.perf_counter(), time.process_time()
        result = predictor.predict_depth(content.depth, content.intrinsics, content.camera_pose)
        walls.append(1e3 * (time.perf_counter() - begun))
        shares.append(1e3 * (time.process_time() - computed) / walls[-1])
    assert result is not None
    return statistics.median(walls[1:]), statistics.median(shares[1:]), len(result.objects), len(result.grasps)


def _line(error: BaseException) -> str:
    return " ".join(str(error).split())[:300]
