"""Whether the open hand can come to a grasp without touching anything on its way.

The hand approaches in a straight line along its own z axis, so the space that it passes is its boxes drawn out
backwards. That space is tested against the table, the points that the camera measured, and a field of occupancy,
which may come from a network, from meshes or from a formula.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int, Int8

from icgnet.geometry.clouds import voxel_downsample
from icgnet.geometry.transforms import invert_transform
from icgnet.geometry.workspace import TABLE_MARGIN
from icgnet.grasping.gripper import Box, Gripper

Occupancy = Callable[[Float[np.ndarray, "n 3"]], Float[np.ndarray, "n"]]
"""From points [m] to the probability that they are inside of some object, in the frame of the grasps."""

FINGER_SPACING = 0.006
"""Distance of sample points on the fingers [m]: the wall of a cup must not slip between them."""
PALM_SPACING = 0.012
"""Distance of sample points on the palm [m]."""
INNER_SPACING = 0.02
"""Distance of sample points inside the palm and the space behind it [m]: no object may hide there unseen."""
POINT_SPACING = 0.004
"""Measured points are thinned to one in a cube of this edge [m]."""
POINT_COUNT = 2
"""So many of the thinned points inside the hand are a collision; a single one may be a stray."""
DRAW_BACK_LIMIT, DRAW_BACK_MARGIN = 0.008, 0.001
"""How far a hand may be drawn back to clear the table, and by how much it must clear it [m]."""
BLOCK = 0.3
"""Points are compared with the hands near their square of this size only [m]."""
BATCH = 200_000
"""Points that the occupancy is asked for at once."""


class Reason(IntEnum):
    """Why a grasp was rejected, or FREE."""

    FREE = 0
    TABLE = 1
    OBJECT = 2
    POINTS = 3


@dataclass(frozen=True, eq=False)
class Collisions:
    """What the hand meets at each grasp.

    Attributes:
        reason: the first `Reason` that was found: TABLE before POINTS before OBJECT.
    """

    reason: Int8[np.ndarray, "g"]

    @property
    def free(self) -> Bool[np.ndarray, "g"]:
        """Which grasps meet nothing."""
        return self.reason == Reason.FREE

    @property
    def counts(self) -> dict[str, int]:
        """How many grasps each reason holds for, by its name in lower case, "free" included."""
        return {reason.name.lower(): int((self.reason == reason).sum()) for reason in Reason}


def check_collisions(
    poses: Float[np.ndarray, "g 4 4"],
    openings: Float[np.ndarray, "g"],
    gripper: Gripper,
    occupancy: Occupancy,
    table_height: float,
    points: Float[np.ndarray, "n 3"] | None = None,
    approach: float = 0.05,
    threshold: float = 0.5,
    margin: float = 0.001,
) -> Collisions:
    """What the open hand meets on the last stretch of its approach and at the grasp itself.

    The object that is to be grasped counts like every other: only the space between the fingers may be occupied.

    Args:
        poses: T_world_grasp.
        openings: distance between the pads while approaching [m].
        gripper: the hand.
        occupancy: probability that a point of the world is inside an object; asked for points above the table only.
        table_height: height of the table plane [m].
        points: measured points in the world [m], those of the table included or not; None if there are none.
        approach: length of the stretch [m].
        threshold: probability from which a point counts as occupied.
        margin: measured points nearer to the hand than this are in it [m].

    Returns:
        The reason for every grasp. Cheap tests come first, and a grasp is only tested until a reason is found.
    """
    swept = _swept(gripper, approach)
    reason = np.full(len(poses), Reason.FREE, dtype=np.int8)
    reason[hits_table(poses, openings, swept, table_height)] = Reason.TABLE
    if points is not None:
        free = np.flatnonzero(reason == Reason.FREE)
        above = points[points[:, 2] > table_height + TABLE_MARGIN]
        thinned, _ = voxel_downsample(above, POINT_SPACING)
        reason[free[hits_points(poses[free], openings[free], swept, thinned, margin)]] = Reason.POINTS
    # The fingers stand between the objects and have fewer points, so they decide most cases.
    for part in _sample_parts(swept):
        free = np.flatnonzero(reason == Reason.FREE)
        hit = _hits_objects(poses[free], openings[free], part, occupancy, table_height, threshold)
        reason[free[hit]] = Reason.OBJECT
    return Collisions(reason)


def hits_table(
    poses: Float[np.ndarray, "g 4 4"], openings: Float[np.ndarray, "g"], gripper: Gripper, table_height: float
) -> Bool[np.ndarray, "g"]:
    """Whether any part of the hand is below the table plane.

    Args:
        poses: T_world_grasp.
        openings: distance between the pads [m].
        gripper: the hand.
        table_height: height of the table plane [m].
    """
    return _lowest_points(poses, openings, gripper) < table_height


def draw_back(
    poses: Float[np.ndarray, "g 4 4"],
    openings: Float[np.ndarray, "g"],
    gripper: Gripper,
    table_height: float,
    limit: float = DRAW_BACK_LIMIT,
    margin: float = DRAW_BACK_MARGIN,
) -> Float[np.ndarray, "g 4 4"]:
    """The same grasps, those that reach a little too low drawn back along their approach until they clear the table.

    The finger tips reach past the contact, which is too far for whatever lies flat: there less must do.

    Args:
        poses: T_world_grasp.
        openings: distance between the pads [m].
        gripper: the hand.
        table_height: height of the table plane [m].
        limit: the farthest that a hand is drawn back [m]; grasps that need more stay as they are.
        margin: distance from the table that is wanted [m].
    """
    missing = table_height + margin - _lowest_points(poses, openings, gripper)
    downwards = -poses[:, 2, 2]
    # A hand that comes in level does not get higher on its way back.
    way = np.where(missing > 0.0, missing / np.maximum(downwards, 1e-6), 0.0)
    way[way > limit] = 0.0
    drawn = poses.copy()
    drawn[:, :3, 3] -= way[:, None] * poses[:, :3, 2]
    return drawn


def _lowest_points(
    poses: Float[np.ndarray, "g 4 4"], openings: Float[np.ndarray, "g"], gripper: Gripper
) -> Float[np.ndarray, "g"]:
    """Height of the lowest point of the hand [m]."""
    hand = _HandBoxes.of(gripper)
    upward = poses[:, 2, :3]
    centres = poses[:, 2, 3, None] + np.einsum("gbd,gd->gb", hand.centres_at(openings), upward)
    lowest = centres - np.abs(upward) @ hand.halves.T
    return lowest.min(axis=1, initial=np.inf)


def hits_points(
    poses: Float[np.ndarray, "g 4 4"],
    openings: Float[np.ndarray, "g"],
    gripper: Gripper,
    points: Float[np.ndarray, "n 3"],
    margin: float = 0.001,
) -> Bool[np.ndarray, "g"]:
    """Whether at least `POINT_COUNT` points lie inside the hand's boxes.

    Args:
        poses: T_world_grasp.
        openings: distance between the pads [m].
        gripper: the hand.
        points: points in the world [m]; hundreds to thousands, thinned by the caller.
        margin: points nearer to a box than this are in it [m].
    """
    hand = _HandBoxes.of(gripper)
    halves = hand.halves + margin
    centres = hand.centres_at(openings)
    reach = (np.linalg.norm(centres, axis=2) + np.linalg.norm(halves, axis=1)).max(axis=1, initial=0.0)
    counts = np.zeros(len(poses), dtype=np.int64)
    for block in _blocks(points):
        middle = (block.min(axis=0) + block.max(axis=0)) / 2
        radius = np.linalg.norm(block - middle, axis=1).max()
        near = np.flatnonzero(np.linalg.norm(poses[:, :3, 3] - middle, axis=1) <= reach + radius)
        for part in _batches(len(near), len(block)):
            index = near[part]
            counts[index] += _count_inside(poses[index], centres[index], hand.closed, halves, block)
    return counts >= POINT_COUNT


def _count_inside(
    poses: Float[np.ndarray, "g 4 4"],
    centres: Float[np.ndarray, "g b 3"],
    closed: Float[np.ndarray, "b 3"],
    halves: Float[np.ndarray, "b 3"],
    points: Float[np.ndarray, "n 3"],
) -> Int[np.ndarray, "g"]:
    """How many of the points lie inside of the boxes at each grasp."""
    T_grasp_world = invert_transform(poses).astype(np.float32)
    columns = points.T.astype(np.float32)
    lower, upper = (centres - halves).min(axis=1), (centres + halves).max(axis=1)
    # One axis and one box at a time, in single precision: small reductions would take ten times as long.
    local = [T_grasp_world[:, axis, :3] @ columns + T_grasp_world[:, axis, 3:] for axis in range(3)]
    near = np.ones((len(poses), len(points)), dtype=bool)
    for axis in range(3):
        near &= (local[axis] >= lower[:, axis, None]) & (local[axis] <= upper[:, axis, None])
    grasp, point = np.nonzero(near)
    x, y, z = (values[grasp, point] for values in local)
    inside = np.zeros(len(grasp), dtype=bool)
    for box, (half_x, half_y, half_z) in enumerate(halves):
        from_middle = y - centres[:, box, 1].astype(np.float32)[grasp]
        inside |= (
            (np.abs(x - closed[box, 0]) <= half_x)
            & (np.abs(from_middle) <= half_y)
            & (np.abs(z - closed[box, 2]) <= half_z)
        )
    return np.bincount(grasp[inside], minlength=len(poses))


def _blocks(points: Float[np.ndarray, "n 3"]) -> list[Float[np.ndarray, "_ 3"]]:
    """The points by squares of `BLOCK`, seen from above."""
    if len(points) == 0:
        return []
    cells = np.floor((points[:, :2] - points[:, :2].min(axis=0)) / BLOCK).astype(np.int64)
    order = np.lexsort(cells.T)
    ends = np.flatnonzero((np.diff(cells[order], axis=0) != 0).any(axis=1)) + 1
    return np.split(points[order], ends)


def _hits_objects(
    poses: Float[np.ndarray, "g 4 4"],
    openings: Float[np.ndarray, "g"],
    part: "_SamplePoints",
    occupancy: Occupancy,
    table_height: float,
    threshold: float,
) -> Bool[np.ndarray, "g"]:
    """Whether any sample point of this part of the hand is occupied."""
    hit = np.zeros(len(poses), dtype=bool)
    for index in _batches(len(poses), len(part.closed)):
        local = part.closed + openings[index, None, None] * part.slides
        world = local @ poses[index, :3, :3].transpose(0, 2, 1) + poses[index, None, :3, 3]
        grasp, point = np.nonzero(world[..., 2] > table_height)
        occupied = occupancy(world[grasp, point]) > threshold
        hit[index] = np.bincount(grasp[occupied], minlength=len(world)) > 0
    return hit


@dataclass(frozen=True, eq=False)
class _HandBoxes:
    """The boxes of a hand as arrays, in the grasp frame.

    Attributes:
        closed: centres with the jaw closed [m].
        slides: how far a centre moves per metre of opening; along y only.
        halves: half of the edge lengths [m].
    """

    closed: Float[np.ndarray, "b 3"]
    slides: Float[np.ndarray, "b 3"]
    halves: Float[np.ndarray, "b 3"]

    @staticmethod
    def of(gripper: Gripper) -> "_HandBoxes":
        closed = np.array([box.centre for box in gripper.boxes(0.0)])
        opened = np.array([box.centre for box in gripper.boxes(1.0)])
        return _HandBoxes(closed, opened - closed, np.array([box.size for box in gripper.boxes(0.0)]) / 2)

    def centres_at(self, openings: Float[np.ndarray, "g"]) -> Float[np.ndarray, "g b 3"]:
        """Centres of all boxes at each opening [m]."""
        return self.closed + openings[:, None, None] * self.slides


@dataclass(frozen=True, eq=False)
class _SamplePoints:
    """Points on a part of the hand: where they are when it is closed [m], and how far they move per metre."""

    closed: Float[np.ndarray, "h 3"]
    slides: Float[np.ndarray, "h 3"]


def _sample_parts(gripper: Gripper) -> tuple[_SamplePoints, _SamplePoints]:
    """Sample points of the fingers and of the palm; finger points that lie inside the palm are left out."""
    fingers, palm = replace(gripper, palm=()), replace(gripper, finger=())
    closed = fingers.surface_points(0.0, FINGER_SPACING)
    slides = fingers.surface_points(1.0, FINGER_SPACING) - closed
    hidden = _inside_any(closed, gripper.palm) & _inside_any(closed + gripper.max_opening * slides, gripper.palm)
    inner = [_inner_points(box, INNER_SPACING) for box in gripper.palm]
    palm_points = np.concatenate([palm.surface_points(0.0, PALM_SPACING), *inner])
    return (
        _SamplePoints(closed[~hidden], slides[~hidden]),
        _SamplePoints(palm_points, np.zeros_like(palm_points)),
    )


def _inside_any(points: Float[np.ndarray, "n 3"], boxes: tuple[Box, ...]) -> Bool[np.ndarray, "n"]:
    inside = np.zeros(len(points), dtype=bool)
    for box in boxes:
        inside |= (np.abs(points - box.centre) <= np.array(box.size) / 2).all(axis=1)
    return inside


def _inner_points(box: Box, spacing: float) -> Float[np.ndarray, "n 3"]:
    """Points inside a box, at most `spacing` [m] from each other and from its faces."""
    steps = [np.arange(1, n) / n - 0.5 for n in np.ceil(np.array(box.size) / spacing)]
    lattice = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.array(box.centre) + lattice * np.array(box.size)


def _swept(gripper: Gripper, approach: float) -> Gripper:
    """The gripper whose boxes cover a straight approach over this distance [m]."""
    palm, finger = (tuple(box.swept(approach) for box in boxes) for boxes in (gripper.palm, gripper.finger))
    return replace(gripper, palm=palm, finger=finger)


def _batches(grasps: int, points: int) -> list[np.ndarray]:
    """Indices of the grasps in parts whose grasps times points stay within `BATCH`."""
    if grasps == 0:
        return []
    return np.array_split(np.arange(grasps), -(-grasps * max(points, 1) // BATCH))
