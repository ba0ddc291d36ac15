"""What an arm must not touch: the predicted shapes, measured points, the support, in the frame of the arm's base."""

# The compiled modules of coal carry no types.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import Float, Int
from scipy.spatial import Delaunay, KDTree, QhullError

from icgnet.arm.libraries import coal
from icgnet.arm.settings import Source
from icgnet.geometry.transforms import invert_transform, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.prediction import NO_INSTANCE, Prediction

SUPPORT, BACKGROUND = "support", "background"
"""Names of the bodies that are no objects."""
POINT_CELL = 0.006
"""Edge of the cubes that stand for measured points [m]."""
BACKGROUND_CELL = 0.01
"""The same for points that belong to no object [m]; a cube that holds a single one is taken for noise."""
FEWEST_POINTS = 2
EDGE, NEAR, NEAR_CELL = 0.012, 0.06, 0.004
"""Points that belong to no object and are nearer to the body of one than this are a part of it that was not told, or a
smear at its edge; that body stands for them. Those within the second distance have small cubes [m]: beside an object a
hand must be able to come where it touches neither shapes nor measured points."""
ABOVE_SUPPORT = 0.01
"""Points that belong to no object and are nearer to the support than this belong to the support [m]."""
SUPPORT_EDGE, SUPPORT_DEPTH = 4.0, 0.2
"""Size of the block that stands for the support [m]."""


@dataclass(frozen=True, eq=False)
class CollisionBody:
    """Something in the scene that an arm can meet.

    Attributes:
        name: "object 3", "support", "background".
        mesh: its surface [m], in the frame of the base.
        instance: id of the object, `NO_INSTANCE` for what is none.
        from_points: whether it is made of measured points and not of a predicted shape.
        geometry: the same for coal.
    """

    name: str
    mesh: trimesh.Trimesh
    instance: int = NO_INSTANCE
    from_points: bool = False
    geometry: object = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "geometry", mesh_geometry(self.mesh))

    @cached_property
    def hull(self) -> object:
        """Its convex hull for coal."""
        geometry = coal.BVHModelOBB(self.geometry)
        geometry.buildConvexHull(False, "Qt")
        return geometry.convex


def mesh_geometry(mesh: trimesh.Trimesh) -> object:
    """A triangle mesh as coal's geometry."""
    model = coal.BVHModelOBB()
    model.beginModel(len(mesh.faces), len(mesh.vertices))
    model.addVertices(np.asarray(mesh.vertices, np.float64))
    model.addTriangles(np.asarray(mesh.faces, np.int64))
    model.endModel()
    model.computeLocalAABB()
    return model


def object_name(instance: int) -> str:
    """What the body of an object is called."""
    return f"object {instance}"


def bodies_of(
    prediction: Prediction, T_base_frame: Float[np.ndarray, "4 4"], source: Source = "shapes"
) -> tuple[CollisionBody, ...]:
    """All bodies of a scene: the support, the objects, and measured points above the support that belong to none.

    Args:
        prediction: what was found in the scene.
        T_base_frame: pose of the prediction's frame in that of the base.
        source: what stands for an object; one whose predicted shape is empty is made of its points in any case, and
            one that has neither is left out.
    """
    objects = []
    for item in prediction.objects:
        mesh = item.mesh() if source == "shapes" else trimesh.Trimesh()
        from_points = len(mesh.faces) == 0
        if from_points:
            mesh = cubes_around(item.points, POINT_CELL)
        if len(mesh.faces) == 0:
            continue
        placed = mesh.copy().apply_transform(T_base_frame)
        objects.append(CollisionBody(object_name(item.instance_id), placed, item.instance_id, from_points))
    return (_support(prediction, T_base_frame), *objects, *_background(prediction, T_base_frame, objects))


def _support(prediction: Prediction, T_base_frame: Float[np.ndarray, "4 4"]) -> CollisionBody:
    block = trimesh.creation.box((SUPPORT_EDGE, SUPPORT_EDGE, SUPPORT_DEPTH))
    block.apply_translation([0.15, 0.15, TABLE_HEIGHT - SUPPORT_DEPTH / 2])
    return CollisionBody(SUPPORT, block.apply_transform(T_base_frame @ prediction.T_frame_table))


def _background(
    prediction: Prediction, T_base_frame: Float[np.ndarray, "4 4"], objects: Sequence[CollisionBody]
) -> tuple[CollisionBody, ...]:
    points = prediction.cloud.points[prediction.cloud_instances == NO_INSTANCE]
    on_table = transform_points(invert_transform(prediction.T_frame_table), points)
    points = points[on_table[:, 2] > TABLE_HEIGHT + ABOVE_SUPPORT]
    points = transform_points(T_base_frame, points[_company(points, BACKGROUND_CELL) >= FEWEST_POINTS])
    seen = prediction.cloud.points[prediction.cloud_instances != NO_INSTANCE]
    of_objects = np.concatenate([transform_points(T_base_frame, seen), *(body.mesh.vertices for body in objects)])
    distance = np.full(len(points), np.inf)
    if len(of_objects):
        distance = KDTree(of_objects).query(points, distance_upper_bound=NEAR)[0]
    beside, far = points[(distance > EDGE) & (distance < NEAR)], points[distance >= NEAR]
    mesh = cubes_around(beside, NEAR_CELL) + cubes_around(far, BACKGROUND_CELL)
    return (CollisionBody(BACKGROUND, mesh, from_points=True),) if len(mesh.faces) else ()


def _company(points: Float[np.ndarray, "n 3"], edge: float) -> Int[np.ndarray, "n"]:
    """How many points there are in the cube of a grid in which each lies, itself included; the edge in [m]."""
    _, cell, counts = np.unique(
        np.floor(points / edge).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    return counts[cell]


def is_over_support(prediction: Prediction, place: Float[np.ndarray, "2"]) -> bool:
    """Whether a place lies within the convex outline of what was measured of the support and of what stands on it.

    Args:
        prediction: of the scene.
        place: x and y in the frame of the table [m].
    """
    on_table = transform_points(invert_transform(prediction.T_frame_table), prediction.cloud.points)
    belongs = (np.abs(on_table[:, 2] - TABLE_HEIGHT) < ABOVE_SUPPORT) | (prediction.cloud_instances != NO_INSTANCE)
    try:
        return bool(Delaunay(on_table[belongs, :2]).find_simplex(place) >= 0)
    except (QhullError, ValueError):  # too few points to enclose anything
        return False


def cubes_around(points: Float[np.ndarray, "n 3"], edge: float) -> trimesh.Trimesh:
    """The surface of all cubes of a grid that hold a point.

    Args:
        points: [m].
        edge: of the cubes [m].
    """
    cells = np.unique(np.floor(points / edge).astype(np.int64), axis=0)
    corners: list[Float[np.ndarray, "_ 4 3"]] = [np.zeros((0, 4, 3))]
    taken = set(map(tuple, cells.tolist()))
    for axis in range(3):
        for side in (0, 1):
            step = np.zeros(3, np.int64)
            step[axis] = 2 * side - 1
            is_open = [tuple(cell) not in taken for cell in (cells + step).tolist()]
            corners.append(edge * (cells[is_open, None] + _square(axis, side)))
    quads = np.concatenate(corners)
    first = 4 * np.arange(len(quads))[:, None]
    faces = np.concatenate([first + [0, 1, 2], first + [0, 2, 3]])
    return trimesh.Trimesh(quads.reshape(-1, 3), faces, process=False)


def _square(axis: int, side: int) -> Int[np.ndarray, "4 3"]:
    """The corners of one side of the unit cube, counter-clockwise from outside."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    square = np.zeros((4, 3), np.int64)
    square[:, axis] = side
    square[[1, 2], first] = 1
    square[[2, 3], second] = 1
    return square if side else square[::-1]
