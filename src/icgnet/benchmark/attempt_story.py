"""What happened in an attempt, in words: the cause, and what the true shapes say about it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.benchmark.config import NOTHING_FOUND
from icgnet.benchmark.observation import Observation
from icgnet.benchmark.planner import Plan
from icgnet.benchmark.rounds import Attempt, Shot
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.geometry.clouds import voxel_downsample
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import Prediction
from icgnet.simulation.approach import APPROACH_LENGTH

REACH, SAMPLES = 0.08, 641  # how far and how finely a line through an object is looked at [m]
GRADIENT_STEP = 0.002  # a little more than the pitch of the distance grids [m]
APPROACH_STEPS = 11
DEEP = 0.0005  # a hand this far inside an object meets it [m]
MARK_SPACING, MOST_MARKS = 0.006, 60  # of the points where it does [m]; more of them hide what they mark
SAME_POSE = 1e-6
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


def structures_between(attempt: Attempt, truth: TrueShapes, gripper: Gripper) -> list[str]:
    """Names of what is no object, such as a wall, and lies between the pads before they close."""
    closing, reach = np.array(attempt.pose)[:3, 1], attempt.opening / 2
    line = _pads_middle(attempt, gripper) + np.linspace(-reach, reach, SAMPLES)[:, None] * closing
    found: dict[str, None] = {}
    for structure in truth.scene.surroundings.structures:
        mesh = structure.mesh()
        outside = np.einsum("pfk,fk->pf", line[:, None] - mesh.triangles[:, 0], mesh.face_normals).max(axis=1)
        if (outside < 0.0).any():
            found[structure.name] = None
    return list(found)


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
    what, trust = NOTHING_FOUND, ""
    if isinstance(shot, Attempt):
        what, trust = shot.cause, f", score {shot.score:.2f}: {plain(shot.target)} ({shot.target_class})"
    count = len(shot.scene)
    where = f"run {shot.run}, round {shot.round}, picture {shot.attempt}, {count} object{'s' * (count != 1)} left"
    return f"{what[0].upper()}{what[1:]}{trust}  \u00b7  {where}"


def story(shot: Shot, truth: TrueShapes, observation: Observation, plan: Plan) -> tuple[str, ...]:
    """One line of what the true shapes say about the grasp and what the hand met; another if the plan differs now.

    Args:
        shot: the attempt, or the picture in which nothing was found.
        truth: what stood there.
        observation: what the planner saw.
        plan: what it makes of that now.
    """
    if not isinstance(shot, Attempt):
        return (CHANGED if len(plan) else _nothing_found(observation, plan),)
    line = grip_line(shot, truth, target_index(shot, truth, observation.gripper), observation.gripper)
    first, last = line.angles_deg
    cone = np.degrees(np.arctan(observation.gripper.friction))
    measured = (
        f"{1e3 * line.width:.0f} mm wide between pads {1e3 * shot.opening:.0f} mm apart, "
        f"{first:.0f} and {last:.0f} degrees off the normals (friction holds {cone:.0f}), "
        f"middle {1e3 * line.lever:.0f} mm off the line"
        if line.width
        else f"the line between the pads ({1e3 * shot.opening:.0f} mm apart) does not meet it"
    )
    between = structures_between(shot, truth, observation.gripper)
    names = {
        "between the pads, though no object": between,
        "touched on the way": shot.touched,
        "held": shot.held,
        "pushed out": shot.lost,
    }
    met = [f"{what}: {', '.join(map(plain, of))}" for what, of in names.items() if of]
    told = f"Target in truth: {'; '.join([measured, *met])}."
    return (told,) if is_same(shot, plan) else (told, CHANGED)


def is_same(attempt: Attempt, plan: Plan) -> bool:
    """Whether a plan's first grasp is the one that was executed."""
    return len(plan) > 0 and bool(np.allclose(plan.poses[0], attempt.pose, rtol=0.0, atol=SAME_POSE))


def plain(name: str) -> str:
    """The name of an object without its folder."""
    return name.rpartition("/")[2]


def _nothing_found(observation: Observation, plan: Plan) -> str:
    told = f"{len(observation.cloud)} points seen"
    if isinstance(plan.details, Prediction):
        dropped = [f"{count} {reason}" for reason, count in plan.details.rejected.items() if count]
        told += f", {len(plan.details.objects)} objects predicted; candidates dropped: {', '.join(dropped) or 'none'}"
    return f"{told}."


def _pads_middle(attempt: Attempt, gripper: Gripper) -> Float[np.ndarray, "3"]:
    pose = np.array(attempt.pose)
    return pose[:3, 3] - gripper.finger_reach * pose[:3, 2]


def _angle_deg(truth: TrueShapes, index: int, point: Float[np.ndarray, "3"], outward: Float[np.ndarray, "3"]) -> float:
    """Angle between a direction and the normal of an object's surface near a point [degrees]."""
    steps = GRADIENT_STEP * np.eye(3)
    gradient = truth.distance(index, point + steps) - truth.distance(index, point - steps)
    cosine = gradient @ outward / max(float(np.linalg.norm(gradient)), 1e-12)
    return float(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))
