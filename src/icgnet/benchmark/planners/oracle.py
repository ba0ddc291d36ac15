"""A planner that knows everything: the ceiling of what protocol, grasp frame and selection allow.

Its grasps lie on the true shapes and are ranked by how far they may be off. The first one that succeeds in a simulated
trial, as those that make the training labels, is executed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from jaxtyping import Bool, Float, Int
from scipy.spatial import KDTree

from icgnet.benchmark.observation import Observation
from icgnet.benchmark.planner import Plan
from icgnet.errors import InputError
from icgnet.geometry.transforms import transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.collision import draw_back
from icgnet.grasping.frame import APPROACH_ANGLES, grasp_poses
from icgnet.grasping.gripper import Gripper
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.approach import ApproachChecker
from icgnet.simulation.config import Jitter, Physics, default_physics
from icgnet.simulation.contacts import sample_contacts
from icgnet.simulation.physics import Body, scene_bodies
from icgnet.simulation.scene import Scene
from icgnet.simulation.surroundings import Surroundings
from icgnet.simulation.trials import Trials

CONTACTS = 200  # that are tried on every object
THINNEST, SPARE = 0.008, 0.002  # no object is thinner; so much of the opening is left beside it [m]
SURFACE_SAMPLES = 2000  # of an object, to look up the normal where a ray leaves it
FAR_MIDDLE = 0.1  # a closing line this far from the centre of mass is as bad as no robustness [m]
DOWNWARDS = 0.25  # how much an approach from above is worth against a level one
CANDIDATES = 96  # free grasps whose robustness is tested
JITTER, DRAWS = Jitter(contact=0.0025, normal=float(np.deg2rad(5.0))), 8
CHECKED_AT_ONCE, HANDS = 480, 24  # candidates looked at before the next decision, and in one pass of the engine
TRIALS = 32  # of the best grasps, until one succeeds
ANGLES = len(APPROACH_ANGLES)


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines through objects along which the hand could close, its surroundings aside.

    Attributes:
        starts: contacts [m].
        normals: outward unit normals there.
        widths: of the object along the line [m].
        objects: indices of the objects.
        preference: the more, the better: squarely met at the other end, and near the middle of the object.
    """

    starts: Float[np.ndarray, "k 3"]
    normals: Float[np.ndarray, "k 3"]
    widths: Float[np.ndarray, "k"]
    objects: Int[np.ndarray, "k"]
    preference: Float[np.ndarray, "k"]


@dataclass(frozen=True, eq=False)
class _FreeGrasps:
    """The most promising grasps that touch nothing on their way.

    Attributes:
        lines: all lines.
        numbers: of the grasps, line by line and angle by angle.
        poses: T_world_grasp [m].
        openings: of the hand on its way [m].
        preference: of the lines, and for coming from above.
        checker: of the ways.
    """

    lines: _Lines
    numbers: Int[np.ndarray, "g"]
    poses: Float[np.ndarray, "g 4 4"]
    openings: Float[np.ndarray, "g"]
    preference: Float[np.ndarray, "g"]
    checker: ApproachChecker

    @property
    def objects(self) -> Int[np.ndarray, "g"]:
        """What each grasp is for."""
        return self.lines.objects[self.numbers // ANGLES]


Openings = Callable[[Float[np.ndarray, "g"]], Float[np.ndarray, "g"]]


class OraclePlanner:
    """Contacts on the true shapes, at the network's approach angles, that leave the hand free even when it is off."""

    needs_truth = True

    def plan(self, observation: Observation) -> Plan:
        """Grasps, the most robust one that held the object in a trial first.

        Raises:
            InputError: the observation holds no truth.
        """
        if observation.truth is None:
            raise InputError("the planner oracle needs the true scene in the observation")
        scene, gripper, rng = observation.truth.scene, observation.gripper, observation.rng
        bodies = scene_bodies(scene, observation.truth.object_set)
        if not bodies:
            return Plan.nothing()
        free = _free_grasps(bodies, scene.surroundings, gripper, observation.openings, rng, observation.truth.target)
        scores = _robustness(free, gripper, observation.openings, rng) + free.preference
        order = _tried_first(np.argsort(-scores, kind="stable"), free, bodies, scene, observation)
        # The trial outweighs the score, and scores descend in every plan.
        scores[order[:1]] = scores.max(initial=-np.inf)
        return Plan(free.poses[order], free.openings[order], scores[order])


def can_hold(scene: Scene, index: int, object_set: ObjectSet, gripper: Gripper, rng: np.random.Generator) -> bool:
    """Whether a hand can hold an object where it stands, if nothing but the support and the structures were there.

    It can if one of the oracle's grasps on the object alone, with a free way in, holds it in a simulated trial.
    """
    bodies = scene_bodies(replace(scene, objects=(scene.objects[index],)), object_set)
    free = _free_grasps(bodies, scene.surroundings, gripper, gripper.opening, rng)
    trials = Trials(bodies, gripper, default_physics(scene.kind), scene.surroundings)
    return any(trials.run(pose, float(free.openings[i]), 0).success for i, pose in enumerate(free.poses))


@dataclass(frozen=True, eq=False)
class HeldGrasps:
    """Grasps that held their object in a simulated trial.

    Attributes:
        poses: T_world_grasp [m].
        widths: of the object between the pads [m].
        openings: of the hand on its way [m].
        objects: index of the object of each.
        disturbs: whether the trial moved another object.
    """

    poses: Float[np.ndarray, "g 4 4"]
    widths: Float[np.ndarray, "g"]
    openings: Float[np.ndarray, "g"]
    objects: Int[np.ndarray, "g"]
    disturbs: Bool[np.ndarray, "g"]


def held_grasps(
    scene: Scene, object_set: ObjectSet, gripper: Gripper, rng: np.random.Generator, most: int, tries: int
) -> HeldGrasps:
    """Grasps on every object of a scene with a free way in that hold it in a trial, the most robust ones tried first.

    Args:
        scene: what stands there.
        object_set: of the scene.
        gripper: the hand.
        rng: source of the draws.
        most: grasps of one object after which there are enough.
        tries: trials of one object at most.
    """
    bodies = scene_bodies(scene, object_set)
    trials = Trials(bodies, gripper, default_physics(scene.kind), scene.surroundings)
    rows: list[tuple[Float[np.ndarray, "4 4"], float, float, int, bool]] = []
    for index in range(len(bodies)):
        free = _free_grasps(bodies, scene.surroundings, gripper, gripper.opening, rng, index)
        order = np.argsort(-(_robustness(free, gripper, gripper.opening, rng) + free.preference), kind="stable")
        found = 0
        for grasp in order[:tries].tolist():
            opening = float(free.openings[grasp])
            outcome = trials.run(free.poses[grasp], opening, index)
            if outcome.success:
                width = float(free.lines.widths[free.numbers[grasp] // ANGLES])
                rows.append((free.poses[grasp], width, opening, index, outcome.disturbed))
                found += not outcome.disturbed
            if found == most:
                break
    poses, widths, openings, objects, disturbs = zip(*rows, strict=True) if rows else ((), (), (), (), ())
    return HeldGrasps(
        np.array(poses, float).reshape(-1, 4, 4),
        np.array(widths, float),
        np.array(openings, float),
        np.array(objects, np.int64),
        np.array(disturbs, bool),
    )


def _free_grasps(
    bodies: list[Body],
    surroundings: Surroundings,
    gripper: Gripper,
    openings_of: Openings,
    rng: np.random.Generator,
    target: int | None = None,
) -> _FreeGrasps:
    """The first grasps by preference that are free; all of them are of the target, if there is one."""
    lines = _lines(bodies, gripper, rng, target)
    openings = np.repeat(openings_of(lines.widths), ANGLES)
    poses = grasp_poses(lines.starts, lines.normals, lines.widths, gripper.finger_reach).reshape(-1, 4, 4)
    poses = draw_back(poses, openings, gripper, TABLE_HEIGHT)
    checker = ApproachChecker(bodies, gripper, Physics(), HANDS, surroundings)
    preference = np.repeat(lines.preference, ANGLES) - DOWNWARDS * poses[:, 2, 2]
    best = _first_free(np.argsort(-preference, kind="stable"), poses, openings, checker)
    return _FreeGrasps(lines, best, poses[best], openings[best], preference[best], checker)


def _lines(bodies: list[Body], gripper: Gripper, rng: np.random.Generator, target: int | None) -> _Lines:
    """Lines from sampled contacts that fit into the hand and leave the object inside the friction cone.

    All of them are on the target, if there is one.
    """
    graspable = list(range(len(bodies))) if target is None else [target]
    contact_count, bodies = CONTACTS * len(bodies), [bodies[index] for index in graspable]
    meshes = [touchable(body) for body in bodies]
    contacts = sample_contacts(meshes, contact_count, rng)
    fits = (contacts.widths > THINNEST) & (contacts.widths < gripper.max_opening - SPARE)
    contact, number = np.nonzero(fits)
    starts, normals, widths = contacts.positions[contact], contacts.normals[contact], contacts.widths[contact, number]
    squareness, distance = np.zeros(len(contact)), np.zeros(len(contact))
    for index, (body, mesh) in enumerate(zip(bodies, meshes, strict=True)):
        own = np.flatnonzero(contacts.objects[contact] == index)
        ends = starts[own] - widths[own, None] * normals[own]
        squareness[own] = -(_normals_at(mesh, ends, rng) * normals[own]).sum(axis=1)
        distance[own] = np.linalg.norm(np.cross(_centre_of_mass(body) - starts[own], normals[own]), axis=1)
    firm = squareness > np.cos(np.arctan(gripper.friction))
    preference = squareness - distance / FAR_MIDDLE
    objects = np.array(graspable)[contacts.objects[contact]]
    return _Lines(starts[firm], normals[firm], widths[firm], objects[firm], preference[firm])


def _first_free(
    order: Int[np.ndarray, "g"],
    poses: Float[np.ndarray, "g 4 4"],
    openings: Float[np.ndarray, "g"],
    checker: ApproachChecker,
) -> Int[np.ndarray, "k"]:
    """The first grasps of this order that touch nothing."""
    found = np.zeros(0, dtype=np.int64)
    for start in range(0, len(order), CHECKED_AT_ONCE):
        part = order[start : start + CHECKED_AT_ONCE]
        found = np.concatenate([found, part[~checker.collides(poses[part], openings[part])]])
        if len(found) >= CANDIDATES:
            break
    return found[:CANDIDATES]


def _robustness(
    free: _FreeGrasps, gripper: Gripper, openings_of: Openings, rng: np.random.Generator
) -> Float[np.ndarray, "g"]:
    """Share of slightly misplaced copies of each grasp that touch nothing."""
    lines = free.lines
    line, angle = (np.repeat(each, DRAWS) for each in np.divmod(free.numbers, ANGLES))
    starts, normals = JITTER.apply(lines.starts[line], lines.normals[line], rng)
    openings = openings_of(lines.widths[line])
    poses = grasp_poses(starts, normals, lines.widths[line], gripper.finger_reach)
    poses = draw_back(poses[np.arange(len(angle)), angle], openings, gripper, TABLE_HEIGHT)
    return 1.0 - free.checker.collides(poses, openings).reshape(-1, DRAWS).mean(axis=1)


def _tried_first(
    order: Int[np.ndarray, "g"], free: _FreeGrasps, bodies: list[Body], scene: Scene, observation: Observation
) -> Int[np.ndarray, "k"]:
    """The order with the first grasp in front that succeeds in a trial; unchanged if none of the best ones does.

    In wide scenes and for a target all are tried, and it must leave the neighbours, some of which may lie on it, where
    they are. If none does, a target is worth one that moves them; without a target there is nothing to grasp.
    """
    trials = Trials(bodies, observation.gripper, default_physics(scene.kind), scene.surroundings)
    is_careful = observation.is_wide or observation.target is not None
    first = order[:0]
    for grasp in (order if is_careful else order[:TRIALS]).tolist():
        outcome = trials.run(free.poses[grasp], float(free.openings[grasp]), int(free.objects[grasp]))
        if outcome.success and not (is_careful and outcome.disturbed):
            return np.concatenate([[grasp], order[order != grasp]])
        if outcome.success and not len(first):
            first = np.array([grasp])
    if observation.is_wide and observation.target is None:
        return order[:0]
    return np.concatenate([first, order[~np.isin(order, first)]])


def touchable(body: Body) -> trimesh.Trimesh:
    """What the physics touches of a body, in the world [m]; the visual mesh may be hollow where this is not."""
    corners = np.concatenate([part.triangles for part in body.model.parts]).reshape(-1, 3)
    corners = transform_points(body.T_world_object, corners * body.factors)
    return trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)


def _centre_of_mass(body: Body) -> Float[np.ndarray, "3"]:
    volumes = np.array([abs(part.volume) for part in body.model.parts])
    centre = volumes @ np.array([part.center_mass for part in body.model.parts]) / volumes.sum()
    return transform_points(body.T_world_object, centre[None] * body.factors)[0]


def _normals_at(
    mesh: trimesh.Trimesh, points: Float[np.ndarray, "n 3"], rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Normals of the surface near points on it."""
    samples, faces, *_ = trimesh.sample.sample_surface(mesh, SURFACE_SAMPLES, seed=int(rng.integers(2**31)))
    _, nearest = KDTree(samples).query(points)
    return np.asarray(mesh.face_normals)[faces[nearest]]
