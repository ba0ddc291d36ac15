"""What happened in an attempt, in words: the cause, and what the true shapes say about it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.benchmark.observation import Observation
from icgnet.benchmark.planner import Plan
from icgnet.benchmark.rounds import Attempt, Shot
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.geometry.clouds import voxel_downsample
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import Prediction
from icgnet.simulation.approach import APPROACH_LENGTH
from icgnet.simulation.workcell import Cause

REACH, SAMPLES = 0.08, 641  # how far and how finely a line through an object is looked at [m]
GRADIENT_STEP = 0.002  # a little more than the pitch of the distance grids [m]
APPROACH_STEPS = 11
DEEP = 0.0005  # a hand this far inside an object meets it [m]
MARK_SPACING, MOST_MARKS = 0.006, 60  # of the points where it does [m]; more of them hide what they mark
SAME_POSE = 1e-6

EXPLANATIONS = {
    Cause.TOUCHED.value: "The open hand touched {touched} on its way, which ended the attempt.",
    Cause.TOO_WIDE.value: "{target} is wider than the hand was open.",
    Cause.MISSED.value: "The hand closed without touching {target}, the object nearest to its pads.",
    Cause.SLIPPED_CLOSING.value: "The hand touched {target} while it closed, but both fingers did not hold it.",
    Cause.SLIPPED_LIFTING.value: "Both fingers held {target}, but it was gone after the lift.",
    Cause.WRONG_OBJECT.value: "It was for {target}, but {held} came up.",
    Cause.TWO_OBJECTS.value: "{target} came up, but together with other things: {held}.",
    Cause.UNSTABLE.value: "The simulation became unstable, which is no fault of the grasp; everything was put back.",
}
REASONS = {
    "low_score": "scored too low",
    "too_wide": "too wide for the hand",
    "table": "hit the table",
    "points": "hit what was seen",
    "object": "hit a predicted shape",
    "unchecked": "not checked",
}
"""Why the predictor drops candidates."""
CHANGED = "Planned again, the planner decides otherwise: it has changed, and its predictions here are new ones."


@dataclass(frozen=True)
class GripLine:
    """The line between the middles of the pads, and what it meets of an object.

    Attributes:
        width: of the object along the line [m]; 0 if the line passes it.
        angles_deg: between the line and the surface's normals where it goes in and out [degrees].
        lever: distance of the object's middle from the line [m].
    """

    width: float
    angles_deg: tuple[float, float]
    lever: float


def target_index(attempt: Attempt, truth: TrueShapes, gripper: Gripper) -> int:
    """The object that an attempt was for; of several with its name, the one nearest to the pads."""
    middle = _pads_middle(attempt, gripper)[None]
    named = [index for index, name in enumerate(attempt.scene) if name == attempt.target]
    return min(named, key=lambda index: truth.distance(index, middle)[0])


def grip_line(attempt: Attempt, truth: TrueShapes, index: int, gripper: Gripper) -> GripLine:
    """What the line between the pads meets of an object, before anything moved."""
    middle, closing = _pads_middle(attempt, gripper), np.array(attempt.pose)[:3, 1]
    offsets = np.linspace(-REACH, REACH, SAMPLES)
    inside = offsets[truth.distance(index, middle + offsets[:, None] * closing) < 0.0]
    lever = float(np.linalg.norm(np.cross(truth.meshes[index].bounds.mean(axis=0) - middle, closing)))
    if len(inside) == 0:
        return GripLine(0.0, (float("nan"), float("nan")), lever)
    first, last = (
        _angle_deg(truth, index, middle + end * closing, side * closing)
        for end, side in ((inside.min(), -1.0), (inside.max(), 1.0))
    )
    return GripLine(float(np.ptp(inside)), (first, last), lever)


def meeting_points(attempt: Attempt, truth: TrueShapes, observation: Observation) -> Float[np.ndarray, "k 3"]:
    """Points of the open hand [m, world] inside of an object or the table at the grasp, or else on the way there."""
    pose = np.array(attempt.pose)
    hand = observation.gripper.surface_points(attempt.opening) @ pose[:3, :3].T + pose[:3, 3]
    way = np.linspace(0.0, APPROACH_LENGTH, APPROACH_STEPS)[1:, None, None] * pose[:3, 2]
    for points in (hand, (hand - way).reshape(-1, 3)):
        below = points[:, 2] < observation.table_height
        inside = (truth.distances(points) < -DEEP).any(axis=0)
        if (below | inside).any():
            meeting, _ = voxel_downsample(points[below | inside], MARK_SPACING)
            return meeting[:: -(-len(meeting) // MOST_MARKS)]
    return np.zeros((0, 3))


def title(shot: Shot) -> str:
    """The cause, and which attempt it was."""
    what, trust = "nothing found", ""
    if isinstance(shot, Attempt):
        what, trust = shot.cause, f", score {shot.score:.2f}: {plain(shot.target)} ({shot.target_class})"
    count = len(shot.scene)
    where = f"run {shot.run}, round {shot.round}, picture {shot.attempt}, {count} object{'s' * (count != 1)} left"
    return f"{what[0].upper()}{what[1:]}{trust}  \u00b7  {where}"


def story(
    shot: Shot,
    truth: TrueShapes,
    observation: Observation,
    plan: Plan,
    believed: Plan | None = None,
    left_out: Attempt | None = None,
) -> tuple[str, ...]:
    """What happened, what the true shapes say about the grasp, and what the planner thought of it.

    Args:
        shot: the attempt, or the picture in which nothing was found.
        truth: what stood there.
        observation: what the planner saw.
        plan: what it made of that.
        believed: where nothing was found, what it would make of it if it took any score.
        left_out: what would have come of the first grasp of that.
    """
    prediction = plan.details if isinstance(plan.details, Prediction) else None
    if not isinstance(shot, Attempt):
        if len(plan):
            return (CHANGED,)
        lines = [_nothing_found(observation, prediction, len(shot.scene))]
        if left_out is not None:
            lines += [_left_out_words(left_out), _grip_words(left_out, truth, observation.gripper)]
        elif believed is not None and isinstance(believed.details, Prediction):
            lines.append(f"With any score, no candidate is free either: {_dropped(believed.details)}.")
        return tuple(lines)
    lines = [_happened(shot), _grip_words(shot, truth, observation.gripper)]
    if not is_same(shot, plan):
        lines.append(CHANGED)
    elif prediction is not None:
        lines.append(_planned(shot, prediction))
    return tuple(lines)


def is_same(attempt: Attempt, plan: Plan) -> bool:
    """Whether a plan's first grasp is the one that was executed."""
    return len(plan) > 0 and bool(np.allclose(plan.poses[0], attempt.pose, rtol=0.0, atol=SAME_POSE))


def plain(name: str) -> str:
    """The name of an object without its folder."""
    return name.rpartition("/")[2]


def _happened(attempt: Attempt) -> str:
    words = {
        "target": plain(attempt.target),
        "touched": _names(attempt.touched) or "nothing",
        "held": _names(attempt.held) or "nothing",
    }
    parts = [EXPLANATIONS[attempt.cause].format(**words)]
    if attempt.touched and attempt.cause != Cause.TOUCHED.value:
        parts.append(f"On its way the open hand had touched {words['touched']}.")
    if attempt.lost:
        parts.append(f"Pushed out of the workspace: {_names(attempt.lost)}.")
    return " ".join(parts)


def _grip_words(attempt: Attempt, truth: TrueShapes, gripper: Gripper) -> str:
    line = grip_line(attempt, truth, target_index(attempt, truth, gripper), gripper)
    opening = f"{1e3 * attempt.opening:.0f} mm open"
    if line.width == 0.0:
        return f"In truth: the line between the pads ({opening}) does not meet the target."
    cone = np.degrees(np.arctan(gripper.friction))
    first, last = line.angles_deg
    return (
        f"In truth: the target is {1e3 * line.width:.0f} mm wide between the pads ({opening}), which meet its surface "
        f"{first:.0f} and {last:.0f} degrees off the normal (friction holds {cone:.0f}); "
        f"its middle is {1e3 * line.lever:.0f} mm off their line."
    )


def _planned(attempt: Attempt, prediction: Prediction) -> str:
    grasps = prediction.grasps
    item = prediction.objects[int(grasps.instances[0])]
    return (
        f"Planned: a width of {1e3 * grasps.widths[0]:.0f} mm on what is taken for '{item.class_name}' "
        f"({100 * item.class_score:.0f} %); {_found(prediction, len(attempt.scene))}."
    )


def _left_out_words(left_out: Attempt) -> str:
    """What would have come of a grasp that was not believed in."""
    name, end = plain(left_out.target), left_out.cause
    if left_out.success:
        end = f"{end}, a success"
    return (
        f"The best free grasp that it left out has a score of {left_out.score:.2f}, on {name} ({left_out.target_class})"
        f"; carried out, it would have ended as: {end}."
    )


def _nothing_found(observation: Observation, prediction: Prediction | None, standing: int) -> str:
    if len(observation.cloud) == 0:
        return "The camera saw too little: the cloud is empty."
    if prediction is None:
        return f"The planner found no grasp in a cloud of {len(observation.cloud)} points."
    return f"{_found(prediction, standing)}; candidates: {_dropped(prediction)}."


def _dropped(prediction: Prediction) -> str:
    parts = [f"{count} {REASONS.get(reason, reason)}" for reason, count in prediction.rejected.items() if count]
    return ", ".join(parts) or "none"


def _found(prediction: Prediction, standing: int) -> str:
    count = len(prediction.objects)
    shapeless = sum(len(item.mesh().faces) == 0 for item in prediction.objects)
    without = f" ({shapeless} without a shape)" if shapeless else ""
    return f"{count} object{'s' * (count != 1)}{without} found where {standing} stand{'s' * (standing == 1)}"


def _names(names: Sequence[str]) -> str:
    said = ["the table" if name == "table" else plain(name) for name in names]
    return " and ".join([", ".join(said[:-1]), said[-1]] if len(said) > 1 else said)


def _pads_middle(attempt: Attempt, gripper: Gripper) -> Float[np.ndarray, "3"]:
    pose = np.array(attempt.pose)
    return pose[:3, 3] - gripper.finger_reach * pose[:3, 2]


def _angle_deg(truth: TrueShapes, index: int, point: Float[np.ndarray, "3"], outward: Float[np.ndarray, "3"]) -> float:
    """Angle between a direction and the normal of an object's surface near a point [degrees]."""
    steps = GRADIENT_STEP * np.eye(3)
    gradient = truth.distance(index, point + steps) - truth.distance(index, point - steps)
    cosine = gradient @ outward / max(float(np.linalg.norm(gradient)), 1e-12)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
