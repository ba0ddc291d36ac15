"""The objects of a scene as training needs them: what is rendered, and what is inside."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from jaxtyping import Float

from icgnet.datagen.recipe import Recipe
from icgnet.errors import DataError
from icgnet.geometry.cells import CellGrid
from icgnet.geometry.signed_distance import SignedDistanceGrid
from icgnet.geometry.transforms import transform_points
from icgnet.geometry.workspace import SIZE
from icgnet.objects.object_set import ObjectSet
from icgnet.training.config import Sampling

SURFACE_SAMPLES = 4096
NEAR_SIGMA = 0.007
FAR_SIGMA = 0.020
ROOM = 0.02
"""How far beyond the objects the box around them reaches [m]."""


@dataclass(frozen=True, eq=False)
class ObjectAssets:
    """What a sample needs of an object, at scale 1 in its own frame [m]; `corners` are those of the box around it."""

    triangles: Float[np.ndarray, "t 3 3"]
    corners: Float[np.ndarray, "c 3"]
    surface: Float[np.ndarray, "s 3"]
    distance: SignedDistanceGrid
    class_name: str


@dataclass(frozen=True, eq=False)
class Placement:
    """An object of a scene and the map from its own frame at scale 1 to the world; one scale, or one for each axis."""

    assets: ObjectAssets
    scale: float | Float[np.ndarray, "3"]
    T_world_object: Float[np.ndarray, "4 4"]

    def to_world(self, points: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
        """Points of the object at scale 1 in the world [m]."""
        return transform_points(self.T_world_object, points * self.scale)

    def corners(self) -> Float[np.ndarray, "c 3"]:
        """Corners of the box around the object in the world [m]; the box is turned with it."""
        return self.to_world(self.assets.corners)

    def distance(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
        """Signed distance of points [m, world frame] from the object's surface [m], below 0 inside."""
        return self.assets.distance.distance_from(points, self.T_world_object, self.scale)


def load_assets(recipes: Sequence[Recipe], object_sets: dict[str, ObjectSet]) -> dict[tuple[str, str], ObjectAssets]:
    """Assets of every object in the recipes, by object set and name.

    Raises:
        DataError: an object set is missing.
    """
    keys = sorted({(recipe.object_set, each.name) for recipe in recipes for each in recipe.scene().objects})
    missing = sorted({name for name, _ in keys} - object_sets.keys())
    if missing:
        raise DataError(
            f"the recipes need the object sets {', '.join(missing)}; given: {', '.join(object_sets) or 'none'}"
        )
    return {(set_name, key): _load_object(object_sets[set_name], key) for set_name, key in keys}


def _load_object(object_set: ObjectSet, key: str) -> ObjectAssets:
    mesh = object_set.model(key).visual
    # The samples serve as starting points of noisy ones: the same few thousand for everybody are enough.
    rng = np.random.default_rng(0)
    face = rng.choice(len(mesh.faces), SURFACE_SAMPLES, p=mesh.area_faces / mesh.area_faces.sum())
    weights = rng.dirichlet((1.0, 1.0, 1.0), SURFACE_SAMPLES)
    surface = np.einsum("sc,scd->sd", weights, mesh.triangles[face])
    return ObjectAssets(
        np.asarray(mesh.triangles, np.float32),
        trimesh.bounds.corners(mesh.bounds),
        surface.astype(np.float32),
        object_set.signed_distance(key),
        object_set.class_name(key),
    )


def _surface_inside(
    placement: Placement, T_work_world: Float[np.ndarray, "4 4"], region: CellGrid
) -> Float[np.ndarray, "3 n"]:
    """Coordinates x, y and z [m, workspace frame] of the points of an object's surface that lie in a region."""
    T_work_object = T_work_world @ placement.T_world_object
    points = (T_work_object[:3, :3] * placement.scale) @ placement.assets.surface.T + T_work_object[:3, 3:]
    # Numpy is several times faster with long rows than with rows of three.
    lower, upper = np.array(region.origin)[:, None], np.array(region.end)[:, None]
    return points[:, ((points >= lower) & (points <= upper)).all(axis=0)]


def stands_in(points: Float[np.ndarray, "n 3"], region: CellGrid) -> bool:
    """Whether something may stand over the floor of a region, by the box around it.

    Args:
        points: whose box holds all of it, workspace frame [m].
        region: part of the workspace frame.
    """
    lower, upper = points.min(axis=0), points.max(axis=0)
    return bool((lower[:2] < np.array(region.end)[:2]).all() and (upper[:2] > np.array(region.origin)[:2]).all())


def occupancy_points_in_crop(
    placements: list[Placement],
    sampling: Sampling,
    T_work_world: Float[np.ndarray, "4 4"],
    region: CellGrid,
    rng: np.random.Generator,
) -> Float[np.ndarray, "n 3"]:
    """The same points for the part of a wide scene that lies in a region of the workspace frame.

    They are near and around the surfaces there, each object as often as the others, and uniform in the box around them.
    """
    surfaces = [
        _surface_inside(each, T_work_world, region)
        for each in placements
        if stands_in(transform_points(T_work_world, each.corners()), region)
    ]
    surfaces = [points for points in surfaces if points.shape[1]]
    count = sampling.occupancy_points
    if not surfaces:  # but for a few points that errors of the sensor brought in
        surfaces = [rng.uniform(region.origin, region.end)[:, None]]
    near, far = round(sampling.near_share * count), round(sampling.far_share * count)
    chosen = rng.integers(len(surfaces), size=near + far)
    place = rng.random(near + far)
    surface = np.zeros((near + far, 3))
    for number, points in enumerate(surfaces):
        mine = chosen == number
        surface[mine] = points[:, (place[mine] * points.shape[1]).astype(int)].T
    sigma = np.where(np.arange(near + far) < near, NEAR_SIGMA, FAR_SIGMA)[:, None]
    surface += sigma * rng.standard_normal(surface.shape)
    lower = np.min([points.min(axis=1) for points in surfaces], axis=0) - ROOM
    upper = np.max([points.max(axis=1) for points in surfaces], axis=0) + ROOM
    uniform = rng.uniform(lower, upper, (count - near - far, 3))
    inside = np.clip(np.concatenate([surface, uniform]), region.origin, region.end)
    return (inside - T_work_world[:3, 3]) @ T_work_world[:3, :3]


def occupancy_points(
    placements: list[Placement], sampling: Sampling, T_work_world: Float[np.ndarray, "4 4"], rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Points [m, world frame] where the shapes are asked for: near and around surfaces, and uniform."""
    count = sampling.occupancy_points
    near, far = round(sampling.near_share * count), round(sampling.far_share * count)
    chosen = rng.integers(len(placements), size=near + far)
    index = rng.integers(SURFACE_SAMPLES, size=near + far)
    surface = np.zeros((near + far, 3))
    for number, placement in enumerate(placements):
        mine = chosen == number
        surface[mine] = placement.to_world(placement.assets.surface[index[mine]].astype(np.float64))
    sigma = np.where(np.arange(near + far) < near, NEAR_SIGMA, FAR_SIGMA)[:, None]
    surface += sigma * rng.standard_normal(surface.shape)
    lower, upper = np.zeros(3), np.full(3, SIZE)
    if sampling.points_near_objects:
        corners = [placement.to_world(placement.assets.surface.astype(np.float64)) for placement in placements]
        lower = np.min([part.min(axis=0) for part in corners], axis=0) - ROOM
        upper = np.max([part.max(axis=0) for part in corners], axis=0) + ROOM
        return np.concatenate([surface, rng.uniform(lower, upper, (count - near - far, 3))])
    uniform = rng.uniform(lower, upper, (count - near - far, 3))
    # The cube is that of the workspace, so its points come back through the turn and the shift.
    return np.concatenate([surface, (uniform - T_work_world[:3, 3]) @ T_work_world[:3, :3]])
