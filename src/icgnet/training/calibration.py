"""Makes scores mean shares of success: a line through the logits, fitted on held-out scenes and put into the weights.

Platt scaling: the score of a grasp with logit z becomes the sigmoid of scale * z + offset. The scale is positive, so no
grasp overtakes another. The last layer of the affordance decoder is linear and takes the line up, so that calibrated
weights are weights like any other.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.optimize import minimize
from scipy.special import expit

from icgnet.errors import DataError, InputError
from icgnet.network.icgnet import IcgNet
from icgnet.network.threads import set_threads
from icgnet.network.weights import is_stored_in_half, load_weights, save_weights
from icgnet.network.weights_header import stored_checksum
from icgnet.training.config import TRAININGS, MatchingCosts
from icgnet.training.metrics import queries_of_instances
from icgnet.training.reliability import Reliability, reliability
from icgnet.training.sample import Sample
from icgnet.training.validation import known_recipes, load_object_sets, validation_samples

GOOD_SCORE = 0.5
METADATA_KEY = "calibration"
"""Where the metadata of calibrated weights say what was done."""

Report = Callable[[str], None]


@dataclass(frozen=True)
class Calibration:
    """The line that maps the logits of the grasps to calibrated ones; the scale is above 0."""

    scale: float = 1.0
    offset: float = 0.0

    def __call__(self, logits: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """The calibrated logits."""
        return self.scale * logits + self.offset

    def after(self, earlier: "Calibration") -> "Calibration":
        """The line that has the same effect as the earlier one followed by this one."""
        return Calibration(self.scale * earlier.scale, self.scale * earlier.offset + self.offset)


@dataclass(frozen=True, eq=False)
class SceneGrasps:
    """All contacts and angles of one scene.

    Attributes:
        logits: [g a] what the network says.
        labels: [g a] whether the grasp succeeded.
        seen: [g] whether the cloud has a point next to the contact.
        own_hand: whether the hand is the one that the weights name.
    """

    logits: Float[np.ndarray, "g a"]
    labels: Bool[np.ndarray, "g a"]
    seen: Bool[np.ndarray, "g"]
    own_hand: bool = True


@dataclass(frozen=True, eq=False)
class ScoreReport:
    """What the scores of some scenes are worth.

    Attributes:
        scenes: number of scenes.
        grasps: number of grasps.
        ece: expected calibration error, bins with equally many grasps.
        ece_equal_width: the same with bins of equal width.
        ece_good: the same among grasps with a score of at least 0.5, bins with equally many; most grasps are plain
            failures, and what is said of them makes `ece` small.
        log_loss: mean negative logarithm of the probability given to what happened.
        best_score: mean score of each scene's best grasp at a seen contact, which is about the one a robot would try.
            None where nothing is seen.
        best_success: share of scenes where that grasp succeeds.
        diagram: the grasps in bins of equal width.
    """

    scenes: int
    grasps: int
    ece: float
    ece_equal_width: float
    ece_good: float
    log_loss: float
    best_score: float | None
    best_success: float | None
    diagram: Reliability


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """A calibration, and what it does to scenes that it was not fitted on.

    Attributes:
        calibration: fitted on all scenes.
        before: the scores of every other scene as the network gives them.
        after: the scores of the same scenes with a calibration that was fitted on the rest.
        by_hand: `after`, of the hand that the weights name and of all others apart, where there are both.
    """

    calibration: Calibration
    before: ScoreReport
    after: ScoreReport
    by_hand: dict[str, ScoreReport]


def calibrate_weights(
    weights: Path,
    data: Sequence[Path],
    objects: Sequence[str | Path],
    out: Path,
    scenes: int | None = None,
    threads: int | None = None,
    report: Report = lambda line: None,
) -> CalibrationResult:
    """Writes weights whose scores are calibrated on validation scenes, seen as in every validation.

    Weights that were calibrated before are calibrated again; the metadata then hold both lines as one.

    Args:
        weights: file that training wrote.
        data: folders of recipes, of which those of split "val" are used.
        objects: sources of the object sets that the recipes name.
        out: file to write.
        scenes: at most so many; all of them if None.
        threads: CPU threads, for the whole process; as many as torch takes if None.
        report: gets a line of text now and then.

    Raises:
        InputError: fewer than two scenes wanted, a number of threads below 1, a folder in the place of `out`, or scenes
            of a hand that the weights do not know.
        DataError: unusable weights, no or too few validation scenes, a missing object set, or scores that nothing can
            be learnt from (see `fit_calibration`).
    """
    if scenes is not None and scenes < 2:
        raise InputError(f"scenes must be at least 2, half to fit and half to judge, got {scenes}")
    if out.is_dir():
        raise InputError(f"{out} is a folder, give the name of a file")
    set_threads(threads)
    network, metadata = load_weights(weights)
    earlier = _earlier(metadata)
    if earlier is not None:
        report(f"{weights} was calibrated before ({_describe(earlier)}); this calibration comes on top")
    recipes = known_recipes(network.config, data, "val")
    wanted = min(scenes or len(recipes), len(recipes))
    report(f"rendering {wanted} of {len(recipes)} validation scenes")
    preset, object_sets = TRAININGS["cpu"], load_object_sets(objects)
    samples = validation_samples(network.config, preset.sampling, wanted, recipes, object_sets)
    report("decoding all contacts")
    result = calibrate(decode_scenes(network, samples, preset.matching))
    names = fold(network, result.calibration)
    total = result.calibration.after(earlier or Calibration())
    record = _record(result, total, data, len(samples)) | {"weights": stored_checksum(weights)}
    out.parent.mkdir(parents=True, exist_ok=True)
    save_weights(out, network, metadata | {METADATA_KEY: record}, half=is_stored_in_half(weights), full=names)
    return result


@torch.no_grad()
def decode_scenes(network: IcgNet, samples: Sequence[Sample], costs: MatchingCosts) -> list[SceneGrasps]:
    """The grasps of all samples that have any, decoded with the query of the contact's own instance.

    Args:
        network: in evaluation mode.
        samples: scenes with their answers.
        costs: of the assignment between queries and instances.
    """
    scenes, own_numbers = [], network.hand_input(network.config.gripper).numbers
    for sample in samples:
        if len(sample.contacts) == 0:
            continue
        embedding = network.encode([sample.input])[0]
        own = queries_of_instances(network, embedding, sample, costs)[sample.contact_instances]
        logits = network.decode_affordance(embedding, own, sample.contacts, sample.normals, sample.hand).logits
        labels, seen = sample.labels > 0.5, sample.contact_seen
        own_hand = torch.equal(sample.hand.numbers, own_numbers)
        scenes.append(SceneGrasps(logits.double().cpu().numpy(), labels.cpu().numpy(), seen.cpu().numpy(), own_hand))
    return scenes


def calibrate(scenes: Sequence[SceneGrasps]) -> CalibrationResult:
    """Fits on one half of the scenes and judges on the other, then fits on all.

    Raises:
        DataError: fewer than two scenes, or see `fit_calibration`.
    """
    if len(scenes) < 2:
        raise DataError(
            f"calibration needs 2 scenes with contacts or more, half to fit and half to judge: {len(scenes)}"
        )
    half, judged = fit_calibration(scenes[::2]), scenes[1::2]
    by_hand = {
        name: judge(chosen, half)
        for name, own in (("its own hand", True), ("other hands", False))
        if (chosen := [scene for scene in judged if scene.own_hand == own]) and len(chosen) < len(judged)
    }
    return CalibrationResult(fit_calibration(scenes), judge(judged), judge(judged, half), by_hand)


def fit_calibration(scenes: Sequence[SceneGrasps]) -> Calibration:
    """The scale and offset under which the labels are most likely.

    Raises:
        DataError: all grasps succeed or none does, or higher logits do not mean more successes.
    """
    logits = np.concatenate([scene.logits.ravel() for scene in scenes]).astype(np.float64)
    labels = np.concatenate([scene.labels.ravel() for scene in scenes])
    good, spread = int(labels.sum()), float(logits.std()) if len(logits) else 0.0
    if good in (0, len(labels)):
        raise DataError(
            f"calibration needs grasps that succeed and grasps that fail; {good} of the {len(labels)} grasps in "
            f"{len(scenes)} scenes succeed"
        )
    if not spread > 0.0:
        raise DataError(f"all {len(logits)} grasps have the same score, or scores that are not finite")
    # Platt's targets, a little inside of 0 and 1, keep the scale finite where the scores separate the labels.
    targets = np.where(labels, (good + 1) / (good + 2), 1 / (len(labels) - good + 2))
    unit = logits / spread

    def loss(line: Float[np.ndarray, "2"]) -> tuple[float, Float[np.ndarray, "2"]]:
        mapped = line[0] * unit + line[1]
        error = expit(mapped) - targets
        return float(np.mean(np.logaddexp(0.0, mapped) - targets * mapped)), np.array(
            [(error * unit).mean(), error.mean()]
        )

    scale, offset = minimize(loss, np.array([spread, 0.0]), jac=True, method="BFGS", options={"gtol": 1e-8}).x
    if not scale > 0.0:
        raise DataError(f"higher scores do not mean more successes (best scale {scale / spread:.3g}): train longer")
    return Calibration(float(scale / spread), float(offset))


def fold(network: IcgNet, calibration: Calibration) -> tuple[str, ...]:
    """Puts a calibration into the last affordance layer, in place, and returns the names of the changed tensors."""
    layer = network.affordance.success_layer
    with torch.no_grad():
        layer.weight.mul_(calibration.scale)
        layer.bias.mul_(calibration.scale).add_(calibration.offset)
    return tuple(name for name, value in network.named_parameters() if value is layer.weight or value is layer.bias)


def judge(scenes: Sequence[SceneGrasps], calibration: Calibration | None = None) -> ScoreReport:
    """What the scores of some scenes are worth, as they are or calibrated."""
    line = calibration or Calibration()
    logits = [line(scene.logits) for scene in scenes]
    flat = np.concatenate([each.ravel() for each in logits])
    labels = np.concatenate([scene.labels.ravel() for scene in scenes])
    scores = expit(flat)
    good = scores >= GOOD_SCORE
    diagram = reliability(scores, labels, "width")
    best = [_best_seen(each, scene) for each, scene in zip(logits, scenes, strict=True) if scene.seen.any()]
    return ScoreReport(
        scenes=len(scenes),
        grasps=len(flat),
        ece=reliability(scores, labels).error,
        ece_equal_width=diagram.error,
        ece_good=reliability(scores[good], labels[good]).error,
        log_loss=float(np.mean(np.logaddexp(0.0, flat) - labels * flat)),
        best_score=float(np.mean([score for score, _ in best])) if best else None,
        best_success=float(np.mean([success for _, success in best])) if best else None,
        diagram=diagram,
    )


def _best_seen(logits: Float[np.ndarray, "g a"], scene: SceneGrasps) -> tuple[float, bool]:
    """Score of the best grasp at a seen contact, and whether it succeeds."""
    best = int(logits[scene.seen].argmax())
    return float(expit(logits[scene.seen].flat[best])), bool(scene.labels[scene.seen].flat[best])


def _earlier(metadata: dict[str, Any]) -> Calibration | None:
    record = metadata.get(METADATA_KEY)
    return None if record is None else Calibration(record["scale"], record["offset"])


def _describe(calibration: Calibration) -> str:
    return f"scale {calibration.scale:.3f}, offset {calibration.offset:+.3f}"


def _record(result: CalibrationResult, total: Calibration, data: Sequence[Path], scenes: int) -> dict[str, Any]:
    return {
        **asdict(total),
        "data": [Path(folder).resolve().name for folder in data],
        "scenes": scenes,
        "ece_before": result.before.ece,
        "ece_after": result.after.ece,
        "ece_by_hand": {name: each.ece for name, each in result.by_hand.items()},
    }
