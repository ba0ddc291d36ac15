"""Where the objects could be grasped, how well that would go, and what the hand would hit."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
import trimesh
from jaxtyping import Bool, Float, Int, Int8

from icgnet.geometry.clouds import estimate_normals, voxel_downsample
from icgnet.geometry.workspace import TABLE_HEIGHT, above_table
from icgnet.grasping.collision import POINT_SPACING, Occupancy, Reason, check_collisions, draw_back
from icgnet.grasping.frame import APPROACH_ANGLES, grasp_poses
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.grasping.selection import SCORE_LADDER, ranked
from icgnet.inference.grasp_search import GraspSearch
from icgnet.inference.instances import Instance
from icgnet.inference.rejections import COLLISIONS, KEPT, LOW_SCORE, REASONS, TOO_WIDE, UNCHECKED, Rejections
from icgnet.inference.shapes import SceneOccupancy, Shape
from icgnet.inference.tabletop import Tabletop
from icgnet.network.icgnet import IcgNet

CONTACT_VOXEL = 0.003
"""Contacts are the points of an object thinned to this [m]."""
STEEP = 0.5
"""Normals with |z| above this need a hand that comes from the side; the training contacts are mostly others, too."""
STEEP_WEIGHT = 0.2
FEWEST_CONTACTS = 128
"""Contacts of every object at least, where there are many."""
CONTACTS_AT_ONCE = 512
CHECKS_AT_ONCE = 48
CHECKS_PER_WANTED = 4
"""Where few free grasps are wanted, so many times as many candidates are checked at once."""


@dataclass(frozen=True, eq=False)
class GraspContacts:
    """Points on the objects, table frame.

    Attributes:
        points: where the +y finger would touch [m].
        normals: outward unit normals there.
        instances: index of the object.
    """

    points: Float[np.ndarray, "c 3"]
    normals: Float[np.ndarray, "c 3"]
    instances: Int[np.ndarray, "c"]

    def select(self, index: Int[np.ndarray, "k"]) -> "GraspContacts":
        """The contacts at these indices."""
        return GraspContacts(self.points[index], self.normals[index], self.instances[index])

    @staticmethod
    def concatenate(parts: Sequence["GraspContacts"]) -> "GraspContacts":
        """All contacts of the parts; at least one."""
        return GraspContacts(
            np.concatenate([part.points for part in parts]),
            np.concatenate([part.normals for part in parts]),
            np.concatenate([part.instances for part in parts]),
        )


def seen_contacts(
    tabletop: Tabletop, instances: Sequence[Instance], budget: int, rng: np.random.Generator
) -> GraspContacts:
    """Contacts among the points that the camera saw.

    Args:
        tabletop: the scene.
        instances: its objects.
        budget: contacts for all objects together, shared evenly; each gets `FEWEST_CONTACTS` at least.
        rng: draws the contacts.
    """
    parts, share = [], _share(budget, len(instances))
    for number, instance in enumerate(instances):
        points, _ = voxel_downsample(tabletop.cloud.points[instance.rows], CONTACT_VOXEL)
        # Normals only for points that have a chance, but from all neighbours.
        tried = points[rng.permutation(len(points))[: 2 * share]]
        normals = estimate_normals(points, tabletop.cloud.viewpoint, queries=tried)
        parts.append(_draw(GraspContacts(tried, normals, np.full(len(tried), number)), share, rng))
    return GraspContacts.concatenate(parts)


def surface_contacts(
    occupancy: SceneOccupancy, chosen: Int[np.ndarray, "k"], budget: int, rng: np.random.Generator
) -> GraspContacts:
    """Contacts on the predicted surfaces of some shapes, also where the camera saw nothing.

    Paper: resampling of unobserved points for views from above. Differs: points are drawn evenly from the surface in
    the lattice, instead of being moved onto it by gradient descent from the seen points.
    """
    none = GraspContacts(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0, dtype=np.int64))
    parts, share = [none], _share(budget, len(chosen))
    for number, mesh in zip(chosen.tolist(), occupancy.rough_meshes(chosen.tolist()), strict=True):
        if len(mesh.faces) == 0:
            continue
        drawn, faces, *_ = trimesh.sample.sample_surface(mesh, 2 * share, seed=int(rng.integers(2**31)))
        points, normals = np.asarray(drawn, dtype=np.float64), np.asarray(mesh.face_normals[faces])
        usable = above_table(points)
        contacts = GraspContacts(points[usable], normals[usable], np.full(usable.sum(), number))
        parts.append(_draw(contacts, share, rng))
    return GraspContacts.concatenate(parts)


def _share(budget: int, objects: int) -> int:
    """Contacts of each object."""
    return max(budget // max(1, objects), min(budget, FEWEST_CONTACTS))


def _draw(contacts: GraspContacts, count: int, rng: np.random.Generator) -> GraspContacts:
    """At most `count` of the contacts, those that a hand from above can use preferred."""
    if len(contacts.points) <= count:
        return contacts
    weight = np.where(np.abs(contacts.normals[:, 2]) > STEEP, STEEP_WEIGHT, 1.0)
    return contacts.select(rng.choice(len(weight), count, replace=False, p=weight / weight.sum()))


@torch.no_grad()
def score_contacts(
    network: IcgNet, shapes: Sequence[Shape], contacts: GraspContacts, gripper: Gripper, search: GraspSearch
) -> tuple[Grasps, Rejections]:
    """The grasps that the network believes in, best first, and those that were dropped, by index of the shape.

    Paper: each contact is decoded for the twelve approach angles, with the query of its own object. Differs: what the
    decoder says holds for an object, so it is multiplied with how sure the network is that this is one.

    Args:
        network: decodes the contacts.
        shapes: the objects; their instances know the encoded scene and their query.
        contacts: where to grasp, table frame.
        gripper: the hand.
        search: the settings.
    """
    probabilities = np.zeros((len(contacts.points), len(APPROACH_ANGLES)))
    widths = np.zeros(len(contacts.points))
    queries = np.array([shape.instance.query for shape in shapes])[contacts.instances]
    objectness = np.array([shape.instance.score for shape in shapes])[contacts.instances]
    hand = network.hand_input(gripper)
    for start in range(0, len(queries), CONTACTS_AT_ONCE):
        part = slice(start, start + CONTACTS_AT_ONCE)
        affordance = network.decode_affordance(
            shapes[0].instance.scene.embedding,
            torch.from_numpy(queries[part]).to(network.device),
            _tensor(contacts.points[part]).to(network.device),
            _tensor(contacts.normals[part]).to(network.device),
            hand,
        )
        probabilities[part] = objectness[part, None] * torch.sigmoid(affordance.logits).cpu().numpy()
        widths[part] = affordance.widths.cpu().numpy()
    if search.width_from == "shape":
        widths = _shape_widths(shapes, contacts, widths, gripper)
    return _believed(probabilities, np.maximum(widths, 0.0), contacts, len(shapes), gripper, search)


def _shape_widths(
    shapes: Sequence[Shape], contacts: GraspContacts, predicted: Float[np.ndarray, "c"], gripper: Gripper
) -> Float[np.ndarray, "c"]:
    """Widths by rays through the shapes; where a ray misses its shape the predicted width stays."""
    widths = predicted.copy()
    for number, shape in enumerate(shapes):
        own = np.flatnonzero(contacts.instances == number)
        measured = shape.widths(contacts.points[own], contacts.normals[own], gripper.max_opening)
        widths[own] = np.where(np.isnan(measured), predicted[own], measured)
    return widths


def _believed(
    probabilities: Float[np.ndarray, "c a"],
    widths: Float[np.ndarray, "c"],
    contacts: GraspContacts,
    shapes: int,
    gripper: Gripper,
    search: GraspSearch,
) -> tuple[Grasps, Rejections]:
    likely = probabilities >= search.min_score
    if search.select == "highest":
        likely &= probabilities > SCORE_LADDER[-1]
    fits = (widths <= gripper.max_opening)[:, None]
    given = (contacts, widths, probabilities, gripper, search.opening == "full")
    counts = np.zeros((shapes, len(REASONS)), dtype=np.int64)
    shown, reasons = [], []
    for name, dropped in ((LOW_SCORE, ~likely), (TOO_WIDE, likely & ~fits)):
        reason = REASONS.index(name)
        np.add.at(counts[:, reason], contacts.instances, dropped.sum(axis=1))
        grasps = _grasps_at(*_best_of_each(dropped, probabilities, contacts), *given)
        shown.append(grasps)
        reasons.append(np.full(len(grasps), reason))
    rejected = Rejections(counts, Grasps.concatenate(shown), np.concatenate(reasons))
    contact, angle = np.nonzero(likely & fits)
    return ranked(_grasps_at(contact, angle, *given), search.select), rejected


def _best_of_each(
    dropped: Bool[np.ndarray, "c a"], probabilities: Float[np.ndarray, "c a"], contacts: GraspContacts
) -> tuple[Int[np.ndarray, "g"], Int[np.ndarray, "g"]]:
    """Contact and approach angle of the best dropped candidates of each object, one at a contact."""
    scores = np.where(dropped, probabilities, -1.0)
    angle = scores.argmax(axis=1)
    best = scores.max(axis=1)
    order = np.argsort(-best, kind="stable")
    order = order[best[order] >= 0.0]
    own = [order[contacts.instances[order] == instance][:KEPT] for instance in np.unique(contacts.instances[order])]
    contact = np.concatenate([np.zeros(0, dtype=np.int64), *own])
    return contact, angle[contact]


def _grasps_at(
    contact: Int[np.ndarray, "g"],
    angle: Int[np.ndarray, "g"],
    contacts: GraspContacts,
    widths: Float[np.ndarray, "c"],
    probabilities: Float[np.ndarray, "c a"],
    gripper: Gripper,
    fully_open: bool,
) -> Grasps:
    """The candidates at these contacts and approach angles; the hand is open as far as each needs, or fully."""
    used, position = np.unique(contact, return_inverse=True)
    poses = grasp_poses(contacts.points[used], contacts.normals[used], widths[used], gripper.finger_reach)
    wide = widths[contact]
    openings = np.full(len(wide), gripper.max_opening) if fully_open else gripper.opening(wide)
    return Grasps(
        poses=draw_back(poses[position, angle], openings, gripper, TABLE_HEIGHT),
        widths=wide,
        openings=openings,
        scores=probabilities[contact, angle],
        instances=contacts.instances[contact],
        contacts=contacts.points[contact],
        angles=angle,
    )


def keep_free(
    grasps: Grasps,
    occupancy: Occupancy,
    objects: int,
    tabletop: Tabletop,
    gripper: Gripper,
    search: GraspSearch,
    is_over: Callable[[], bool] = lambda: False,
) -> tuple[Grasps, Rejections]:
    """The best grasps whose hand touches nothing on its way, and those that were dropped, and for what.

    Candidates are checked in the order in which they would be tried, until every object has enough, or all together.
    Those that are kept are opened wider by `search.spare_opening` where the hand then touches nothing either.

    Args:
        grasps: candidates, table frame, in the order in which they would be tried.
        occupancy: all shapes that stand on the table; the hand may hit any of them.
        objects: how many objects there are; `instances` of the grasps are their numbers.
        tabletop: the measured points.
        gripper: the hand.
        search: the settings.
        is_over: asked after every batch of checks; the candidates that are left are not checked.
    """
    points, _ = voxel_downsample(tabletop.cloud.points[tabletop.above], POINT_SPACING)

    def reasons_of(rows: Int[np.ndarray, "k"], openings: Float[np.ndarray, "g"]) -> Int8[np.ndarray, "k"]:
        poses = grasps.poses[rows]
        return check_collisions(poses, openings[rows], gripper, occupancy, TABLE_HEIGHT, points=points).reason

    found = np.zeros(objects, dtype=np.int64)
    checked = np.zeros(len(grasps), dtype=bool)
    met = np.full(len(grasps), Reason.FREE, dtype=np.int8)
    free: list[Int[np.ndarray, "k"]] = []
    at_once = CHECKS_AT_ONCE if search.most is None else min(CHECKS_AT_ONCE, CHECKS_PER_WANTED * search.most)
    while checked.sum() < search.max_checked and (search.most is None or found.sum() < search.most):
        # Those of an object that has enough are left, without having been looked at; the highest one may be any.
        has_enough = (found >= search.per_object) & (search.select == "best")
        wanted = ~checked & ~has_enough[grasps.instances]
        batch = np.flatnonzero(wanted)[: min(at_once, search.max_checked - checked.sum())]
        if len(batch) == 0:
            break
        met[batch] = reasons_of(batch, grasps.openings)
        checked[batch] = True
        free.append(batch[met[batch] == Reason.FREE])
        found += np.bincount(grasps.instances[free[-1]], minlength=objects)
        if is_over():
            break
    dropped = ~checked | (met != Reason.FREE)
    reasons = np.where(checked, REASONS.index(COLLISIONS[0]) + met - 1, REASONS.index(UNCHECKED))[dropped]
    rejected = Rejections.of_grasps(grasps.select(dropped), reasons.astype(np.int64), objects)
    rows = np.concatenate([np.zeros(0, dtype=np.int64), *free])
    wider = np.minimum(grasps.openings + search.spare_opening, gripper.max_opening)
    to_widen = rows[wider[rows] > grasps.openings[rows]]
    roomy = to_widen[reasons_of(to_widen, wider) == Reason.FREE]
    openings = grasps.openings.copy()
    openings[roomy] = wider[roomy]
    return ranked(replace(grasps, openings=openings).select(rows), search.select), rejected


def keep_unchecked(grasps: Grasps, objects: int, per_object: int) -> Grasps:
    """The first so many candidates of each object, in their order, whatever their hand touches.

    Args:
        grasps: candidates in the order in which they would be tried.
        objects: how many objects there are.
        per_object: how many of each are kept.
    """
    rows = [np.flatnonzero(grasps.instances == number)[:per_object] for number in range(objects)]
    return grasps.select(np.sort(np.concatenate([np.zeros(0, dtype=np.int64), *rows])))


def _tensor(values: Float[np.ndarray, "..."]) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
