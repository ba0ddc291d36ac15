"""Scenes held against the meshes and distance grids of their objects: the faults of a data set, as numbers.

Labels come from the physics, which touches convex pieces; the network learns from visual meshes and their distance
grids. A fault of either shows where they disagree. Every check measures a length, which is compared with a limit.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

from icgnet.datagen.recipe import Recipe, unpack_bits
from icgnet.datagen.sight import Sight, look_at
from icgnet.geometry.signed_distance import SignedDistanceGrid
from icgnet.geometry.transforms import transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.collision import draw_back
from icgnet.grasping.frame import APPROACH_ANGLES, grasp_poses
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.scene import PlacedObject, world_mesh
from icgnet.simulation.surroundings import Structure, Surroundings

SLACK = 0.002
"""Visual meshes and the convex pieces that the physics touches differ by up to about this [m]."""
PROBE = 0.001
"""How far before and behind a contact the distance is asked, to tell on which side the object is [m]."""
LIMITS = {
    "contact off its mesh": 0.001,
    "normal points inward": 0.0,
    "far side of the width off the mesh": 0.001,
    "object below the table": SLACK,
    "object floating": SLACK,
    "object outside the workspace": 0.0,
    "object inside another": SLACK,
    "object inside a structure": SLACK,
    "hand inside an object": SLACK,
    "hand inside the table": SLACK,
    "hand inside a structure": SLACK,
}
"""Check -> the largest length [m] that passes. `check_scene` says what is measured."""
SURFACE_POINTS = 2000
"""Samples of each object's surface that are asked for their distance to the other objects."""
HAND_SPACING = 0.005
"""Between the points on a hand that are asked for their distance to objects [m]."""
PERCENTILES = (5, 50, 95)
STACKED_SLACK = 0.01
"""What lies on another object begins at most this far below its top [m]: tops are uneven."""
NEIGHBOURS = 2
"""A grasp counts as the safer, the more of the this many next angles on either side succeed too."""


@dataclass(frozen=True, eq=False)
class Measured:
    """What one check measured.

    Attributes:
        amounts: a length for each object, contact or grasp [m].
        names: the object that each is about.
    """

    amounts: Float[np.ndarray, "k"]
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class SceneChecks:
    """The measurements on one scene.

    Attributes:
        scene_id: of the recipe.
        measured: by check.
        top: how far the highest object rises above the table [m].
        touching_pairs: pairs of objects within 2 mm of each other.
        stacked_pairs: those of them of which one begins about where the other ends, or higher.
        lengths: longest side of each object as it lies [m].
        seen: what a camera sees of it.
    """

    scene_id: int
    measured: dict[str, Measured]
    top: float
    touching_pairs: int
    stacked_pairs: int
    lengths: Float[np.ndarray, "i"]
    seen: Sight


@dataclass(frozen=True)
class CheckResult:
    """One check on all scenes that were looked at.

    Attributes:
        number: objects, contacts or grasps that were measured.
        limit: largest length that passes [m].
        failed: share beyond the limit.
        worst: largest length measured [m]; below 0 there was no fault at all.
        worst_scene: the scene where that was, None if nothing was measured.
        worst_name: the object there.
    """

    number: int
    limit: float
    failed: float
    worst: float
    worst_scene: int | None
    worst_name: str | None


@dataclass(frozen=True)
class Checks:
    """All checks on a sample of scenes.

    Attributes:
        scenes: number of scenes looked at.
        results: by check.
        touching_pairs: pairs of objects within 2 mm of each other, a scene.
        stacked_pairs: pairs of which one lies on the other, a scene.
        tops: percentile -> how far the highest object of a scene rises above the table [m].
        lengths: percentile -> longest side of an object as it lies [m].
        visible: percentile -> share of an object's pixels that others and structures leave free.
        background: share of the pixels above the table that show structures.
    """

    scenes: int
    results: dict[str, CheckResult]
    touching_pairs: float
    stacked_pairs: float
    tops: dict[int, float]
    lengths: dict[int, float]
    visible: dict[int, float]
    background: float


def check_scenes(recipes: Sequence[Recipe], object_set: ObjectSet) -> Checks:
    """All checks on some scenes.

    Args:
        recipes: the scenes, at least one.
        object_set: the set that they were made of.

    Raises:
        InputError: the set lacks an object.
        DataError: an object's files are broken.
    """
    scenes = [check_scene(recipe, object_set) for recipe in recipes]
    return Checks(
        scenes=len(scenes),
        results={check: _result(check, scenes) for check in LIMITS},
        touching_pairs=float(np.mean([scene.touching_pairs for scene in scenes])),
        stacked_pairs=float(np.mean([scene.stacked_pairs for scene in scenes])),
        tops=_percentiles([scene.top for scene in scenes]),
        lengths=_percentiles(np.concatenate([scene.lengths for scene in scenes])),
        visible=_percentiles(np.concatenate([scene.seen.visible for scene in scenes])),
        background=float(np.mean([scene.seen.background for scene in scenes])),
    )


def check_scene(recipe: Recipe, object_set: ObjectSet) -> SceneChecks:
    """The measurements on one scene, with its hand at their nominal poses, without the jitter of the trials.

    - contact off its mesh: distance from the contact to the visual mesh of its object.
    - normal points inward: distance to the object 1 mm behind the contact, less that 1 mm before it; about -2 mm where
      all is well.
    - far side of the width off the mesh: as for contacts, at c - w n.
    - object below the table, object outside the workspace: how far its lowest point over the table, its centre of mass
      is.
    - object floating: the smallest gap that any way from the object down to the table or to a structure, over other
      objects, has.
    - object inside another, inside a structure: depth of its surface in the other, or of the other's in it.
    - hand inside an object, the table, a structure: depth of the open hand of each successful grasp.

    Raises:
        InputError: the set lacks an object.
        DataError: an object's files are broken.
    """
    scene = recipe.scene()
    placed = [_Placed(each, object_set) for each in scene.objects]
    structures = [_Structure(each) for each in scene.surroundings.structures]
    owners, names = recipe.contacts.objects, tuple(each.name for each in recipe.objects)
    positions, normals = recipe.contacts.positions.astype(np.float64), recipe.contacts.normals.astype(np.float64)
    widths = recipe.contacts.widths.astype(np.float64)
    grasps = successful_grasps(recipe)
    hands = _hand_points(recipe.gripper, grasps)
    bottoms = np.array([-_depth_in_table(each.surface, scene.surroundings) for each in placed])
    centres = np.array([each.T_world_object[:3, 3] for each in placed])
    lower, upper = scene.surroundings.bounds
    beyond = np.concatenate([lower - centres[:, :2], -centres[:, 2:], centres[:, :2] - upper], axis=1).max(axis=1)
    gaps = _gaps(placed)
    to_structures = np.array(
        [min((far.distance(each.surface).min() for far in structures), default=np.inf) for each in placed]
    )
    wide = widths > 0.0

    def of_contacts(amounts: Float[np.ndarray, "g"], rows: np.ndarray) -> Measured:
        return Measured(amounts, tuple(names[owner] for owner in rows))

    measured = {
        "contact off its mesh": of_contacts(_off_mesh(placed, owners, positions), owners),
        "normal points inward": of_contacts(_inwardness(placed, owners, positions, normals), owners),
        "far side of the width off the mesh": of_contacts(
            _off_mesh(placed, owners[wide], (positions - widths[:, None] * normals)[wide]), owners[wide]
        ),
        "object below the table": Measured(-bottoms, names),
        "object floating": Measured(_drops(np.minimum(bottoms, to_structures), gaps), names),
        "object outside the workspace": Measured(beyond, names),
        "object inside another": Measured(-gaps.min(axis=1, initial=np.inf), names),
        "object inside a structure": Measured(-to_structures[np.isfinite(to_structures)], names),
        "hand inside an object": of_contacts(_depths(placed, hands), grasps.instances),
        "hand inside the table": of_contacts(
            np.array([_depth_in_table(points, scene.surroundings) for points in hands]), grasps.instances
        ),
        "hand inside a structure": of_contacts(
            _depths(structures, hands) if structures else np.zeros(0),
            grasps.instances if structures else np.zeros(0, int),
        ),
    }
    top = max(each.mesh.bounds[1, 2] for each in placed) - TABLE_HEIGHT
    tops = np.array([each.mesh.bounds[1, 2] - TABLE_HEIGHT for each in placed])
    on_other = (gaps < SLACK) & (bottoms[:, None] > tops[None, :] - STACKED_SLACK)
    lengths = np.array([each.mesh.extents.max() for each in placed])
    pairs, stacked = int((gaps < SLACK).sum()) // 2, int((on_other | on_other.T).sum()) // 2
    return SceneChecks(recipe.scene_id, measured, float(top), pairs, stacked, lengths, look_at(scene, object_set))


def successful_grasps(recipe: Recipe) -> Grasps:
    """The successful grasps of a scene, world frame.

    Scores say how safe a grasp is: the share of successes among its angle and the two next ones on either side.

    Args:
        recipe: the labelled scene.
    """
    contacts, gripper = recipe.contacts, recipe.gripper
    success = unpack_bits(contacts.success)
    rows, angles = np.nonzero(success)
    padded = np.pad(success, ((0, 0), (NEIGHBOURS, NEIGHBOURS)))
    safety = np.mean([padded[:, shift : shift + len(APPROACH_ANGLES)] for shift in range(2 * NEIGHBOURS + 1)], axis=0)
    positions, widths = contacts.positions.astype(np.float64), contacts.widths.astype(np.float64)
    poses = grasp_poses(positions, contacts.normals.astype(np.float64), widths, gripper.finger_reach)[rows, angles]
    openings = gripper.opening(widths[rows])
    poses = draw_back(poses, openings, gripper, TABLE_HEIGHT)
    return Grasps(poses, widths[rows], openings, safety[rows, angles], contacts.objects[rows], positions[rows], angles)


class _Placed:
    """A placed object: its mesh in the world, points on it, and its signed distance."""

    def __init__(self, placed: PlacedObject, object_set: ObjectSet) -> None:
        self.mesh: trimesh.Trimesh = world_mesh(placed, object_set)
        self.T_world_object = placed.T_world_object
        self._scale = placed.factors
        self._grid: SignedDistanceGrid = object_set.signed_distance(placed.name)
        samples = trimesh.sample.sample_surface(self.mesh, SURFACE_POINTS, seed=0)[0]
        # Objects rest on their corners, which random samples miss.
        self.surface = np.concatenate([self.mesh.vertices, np.asarray(samples)])

    def distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Signed distance of points in the world frame [m]."""
        return self._grid.distance_from(points, self.T_world_object, self._scale)


class _Structure:
    """A structure in the world, and the signed distance of points from it."""

    def __init__(self, structure: Structure) -> None:
        mesh = structure.mesh()
        self._normals = mesh.face_normals
        self._offsets = np.einsum("fk,fk->f", mesh.face_normals, mesh.triangles[:, 0])

    def distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Signed distance of points in the world frame [m]; too small around edges."""
        return (points @ self._normals.T - self._offsets).max(axis=1)


def _percentiles(values: Sequence[float] | Float[np.ndarray, "k"]) -> dict[int, float]:
    return {each: float(np.percentile(values, each)) for each in PERCENTILES}


def _result(check: str, scenes: Sequence[SceneChecks]) -> CheckResult:
    amounts = np.concatenate([scene.measured[check].amounts for scene in scenes])
    if not len(amounts):
        return CheckResult(0, LIMITS[check], 0.0, 0.0, None, None)
    cases = [(scene.scene_id, name) for scene in scenes for name in scene.measured[check].names]
    worst = int(amounts.argmax())
    failed = float((amounts > LIMITS[check]).mean())
    return CheckResult(len(amounts), LIMITS[check], failed, float(amounts[worst]), *cases[worst])


def _off_mesh(
    placed: Sequence[_Placed], owners: np.ndarray, points: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n"]:
    """Exact distance of each point from the mesh of its object [m]: grids are too coarse at thin walls."""
    distances = np.zeros(len(points))
    for index, each in enumerate(placed):
        for row in np.flatnonzero(owners == index):
            triangles = each.mesh.triangles
            feet = trimesh.triangles.closest_point(triangles, np.broadcast_to(points[row], (len(triangles), 3)))
            distances[row] = np.linalg.norm(feet - points[row], axis=1).min()
    return distances


def _inwardness(
    placed: Sequence[_Placed],
    owners: np.ndarray,
    positions: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
) -> Float[np.ndarray, "n"]:
    result = np.zeros(len(positions))
    for index, each in enumerate(placed):
        own = owners == index
        before, behind = positions[own] + PROBE * normals[own], positions[own] - PROBE * normals[own]
        result[own] = each.distance(behind) - each.distance(before)
    return result


def _gaps(placed: Sequence[_Placed]) -> Float[np.ndarray, "i i"]:
    """Gaps between objects [m], negative where they overlap; infinite on the diagonal."""
    gaps = np.full((len(placed), len(placed)), np.inf)
    for i, one in enumerate(placed):
        for j, other in enumerate(placed):
            if i != j:
                gaps[i, j] = one.distance(other.surface).min()
    return np.minimum(gaps, gaps.T)


def _drops(bottoms: Float[np.ndarray, "i"], gaps: Float[np.ndarray, "i i"]) -> Float[np.ndarray, "i"]:
    """How far each object would have to fall [m]: the largest step of its easiest way to the table."""
    drops = bottoms.copy()
    for _ in range(len(drops)):
        drops = np.minimum(drops, np.maximum(gaps, drops[None, :]).min(axis=1, initial=np.inf))
    return drops


def _hand_points(gripper: Gripper, grasps: Grasps) -> list[Float[np.ndarray, "n 3"]]:
    """Points all over the open hand of each grasp, world frame [m]."""
    return [
        transform_points(pose, gripper.surface_points(float(opening), HAND_SPACING))
        for pose, opening in zip(grasps.poses, grasps.openings, strict=True)
    ]


def _depth_in_table(points: Float[np.ndarray, "n 3"], surroundings: Surroundings) -> float:
    """How far points over the table reach below its top [m]; beyond its edges a hand may be lower."""
    if surroundings.extent is not None:
        extent = np.array(surroundings.extent)
        points = points[((points[:, :2] > extent[:2]) & (points[:, :2] < extent[2:])).all(axis=1)]
    return TABLE_HEIGHT - float(points[:, 2].min(initial=np.inf))


def _depths(
    placed: Sequence[_Placed | _Structure], hands: Sequence[Float[np.ndarray, "n 3"]]
) -> Float[np.ndarray, "k"]:
    """Depth of each hand's deepest point in any object or structure [m], negative for hands that are free."""
    return np.array([max(-each.distance(points).min() for each in placed) for points in hands])
