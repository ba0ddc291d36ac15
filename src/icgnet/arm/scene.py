"""Whether the arm with its hand, and with what it carries, meets anything, and how near it comes.

Built on pinocchio and coal: a tree of bounding boxes over everything, exact tests only where boxes meet.
"""

# The compiled modules of pinocchio and coal carry no types.
# pyright: reportAttributeAccessIssue=false

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from icgnet.arm.arm import Arm
from icgnet.arm.bodies import CollisionBody
from icgnet.arm.libraries import coal, pin
from icgnet.geometry.transforms import make_transform
from icgnet.grasping.gripper import Box, Gripper

FARTHEST_CLEARANCE = 0.05
"""Clearances are measured up to here [m]."""
CLEARANCE_STEP = 0.0005
"""As finely as this [m]."""

MOST_CONTACTS = 10_000
"""So many pairs of triangles are looked at to tell how deep two things are in each other."""

HAND, CARRIED = "hand", "carried object"


@dataclass(frozen=True)
class Meeting:
    """Two things that touch, or come nearer than they may: a part of the arm and what it meets."""

    part: str
    body: str


@dataclass(frozen=True, eq=False)
class Load:
    """What the hand holds or does.

    Attributes:
        low: smallest distance between the finger tips at this time [m].
        high: largest one [m]: between both the fingers move.
        carried: the body that moves with the hand, where it was when it was gripped; None if there is none.
        T_base_gripped: pose of the grasp frame when that body was gripped.
        untested: what may meet: a part of the arm, `HAND` or `CARRIED`, and the name of a body.
        absent: names of the bodies that are not there.
    """

    low: float
    high: float
    carried: CollisionBody | None = None
    T_base_gripped: Float[np.ndarray, "4 4"] | None = None
    untested: frozenset[Meeting] = frozenset()
    absent: frozenset[str] = frozenset()


class CollisionChecker:
    """The arm with one load among the bodies of a scene.

    Args:
        arm: the arm.
        gripper: its hand.
        bodies: everything that stands around.
        load: what the hand holds.
    """

    def __init__(self, arm: Arm, gripper: Gripper, bodies: Sequence[CollisionBody], load: Load) -> None:
        self.arm, self.load = arm, load
        self._shapes = pin.GeometryModel()
        self._names: list[str] = []
        links = [self._add(shape.link, shape.joint, shape.placement, shape.geometry) for shape in arm.link_shapes]
        T_joint_grasp = arm.T_joint_mount @ arm.T_mount_grasp(gripper)
        hand = [
            self._add(HAND, arm.mount_joint, _se3(T_joint_grasp @ _centre(box)), coal.Box(*box.size))
            for box in hand_boxes(gripper, load.low, load.high)
        ]
        carried = []
        reach = max(
            float(np.linalg.norm(np.abs(box.centre) + np.array(box.size) / 2)) for box in gripper.boxes(load.high)
        )
        reach += float(np.linalg.norm(T_joint_grasp[:3, 3]))
        if load.carried is not None and load.T_base_gripped is not None:
            T_joint_base = T_joint_grasp @ np.linalg.inv(load.T_base_gripped)
            carried = [self._add(CARRIED, arm.mount_joint, _se3(T_joint_base), load.carried.geometry)]
            points = load.carried.mesh.vertices @ T_joint_base[:3, :3].T + T_joint_base[:3, 3]
            reach = max(reach, float(np.linalg.norm(points, axis=1).max()))
        self.reaches = np.maximum(arm.reaches, _reaches_to_mount(arm) + reach)
        """How far anything that moves with the arm can be from the axis of each joint [m]."""

        moving = [link for link in links if arm.link_shapes[link].joint > 0]
        gone = load.absent | ({load.carried.name} if load.carried is not None else set())
        for body in bodies:
            if body.name in gone:
                continue
            other = self._add(body.name, 0, pin.SE3.Identity(), body.geometry)
            for part in (*moving, *hand, *carried):
                if Meeting(self._names[part], body.name) not in load.untested:
                    self._pair(part, other)
        outer = len(self._shapes.collisionPairs)
        for first, second in arm.link_pairs:
            self._pair(first, second)
        parents = list(arm.model.parents)
        near = {arm.mount_joint, parents[arm.mount_joint]}
        for part in (*hand, *carried):
            for link in links:
                if arm.link_shapes[link].joint not in near:
                    self._pair(part, link)
        self._outer = outer
        self._results = self._shapes.createData()
        self._requests = self._results.collisionRequests
        self._tree = pin.TreeBroadPhaseManager_DynamicAABBTreeCollisionManager(arm.model, self._shapes, self._results)
        self._margin = 0.0

    def _add(self, name: str, joint: int, placement: "pin.SE3", geometry: object) -> int:
        self._names.append(name)
        shape = pin.GeometryObject(f"{name} {len(self._names)}", joint, 0, placement, geometry)
        return self._shapes.addGeometryObject(shape)

    def _pair(self, first: int, second: int) -> None:
        self._shapes.addCollisionPair(pin.CollisionPair(first, second))

    def collides(self, joints: Float[np.ndarray, "j"], margin: float = 0.0) -> bool:
        """Whether anything meets at these joint positions.

        Args:
            joints: [rad].
            margin: what stands around is met from this distance on [m]; the arm itself on touch.
        """
        self._set_margin(margin)
        return bool(pin.computeCollisions(self.arm.model, self.arm.data, self._tree, joints, True))

    def first_collision(self, path: Float[np.ndarray, "n j"], margin: float = 0.0) -> int | None:
        """Index of the first of several joint positions at which anything meets; None if nothing does."""
        self._set_margin(margin)
        model, data, tree = self.arm.model, self.arm.data, self._tree
        for index, joints in enumerate(path):
            if pin.computeCollisions(model, data, tree, joints, True):
                return index
        return None

    def meetings(self, joints: Float[np.ndarray, "j"], margin: float = 0.0) -> tuple[Meeting, ...]:
        """Everything that meets at these joint positions, each pair of names once."""
        self._set_margin(margin)
        pin.computeCollisions(self.arm.model, self.arm.data, self._shapes, self._results, joints, False)
        found = {}
        for pair, result in zip(self._shapes.collisionPairs, self._results.collisionResults, strict=True):
            if result.isCollision():
                found[Meeting(self._names[pair.first], self._names[pair.second])] = None
        return tuple(found)

    def deepest(self, joints: Float[np.ndarray, "j"]) -> tuple[float, Meeting | None]:
        """How deep anything is in something else at these joint positions [m], and what; 0 if nothing meets.

        The depth is that of the deepest triangle of a mesh in the convex part of the arm that it meets.
        """
        self._set_margin(0.0)
        pin.computeCollisions(self.arm.model, self.arm.data, self._shapes, self._results, joints, False)
        request = coal.CollisionRequest(coal.CONTACT, MOST_CONTACTS)
        deepest, meeting = 0.0, None
        for pair, found in zip(self._shapes.collisionPairs, self._results.collisionResults, strict=True):
            if not found.isCollision():
                continue
            shapes = [self._shapes.geometryObjects[index].geometry for index in (pair.first, pair.second)]
            first, second = (_transform(self._results.oMg[index]) for index in (pair.first, pair.second))
            result = coal.CollisionResult()
            coal.collide(shapes[0], first, shapes[1], second, request, result)
            depth = max((-contact.penetration_depth for contact in result.getContacts()), default=0.0)
            if depth > deepest:
                deepest, meeting = depth, Meeting(self._names[pair.first], self._names[pair.second])
        return deepest, meeting

    def clearance(self, path: Float[np.ndarray, "n j"]) -> tuple[float, Meeting | None]:
        """Least distance of anything that moves to what stands around [m], and between what it is.

        Args:
            path: joint positions.

        Returns:
            The distance to within `CLEARANCE_STEP`, at most `FARTHEST_CLEARANCE`: then nothing is near. 0 if it meets.
        """
        near, nearest = FARTHEST_CLEARANCE, None
        # The ends of a phase are where things are near; then each position need only be tested for being nearer.
        for joints in (path[-1], path[0], *path[1:-1]):
            if not self.collides(joints, near):
                continue
            clear, nearest = 0.0, joints
            while near - clear > CLEARANCE_STEP:
                middle = (clear + near) / 2
                clear, near = (clear, middle) if self.collides(joints, middle) else (middle, near)
            near = clear
            if near == 0.0:
                break
        if nearest is None:
            return FARTHEST_CLEARANCE, None
        return near, self.meetings(nearest, near + CLEARANCE_STEP)[0]

    def _set_margin(self, margin: float) -> None:
        if margin != self._margin:
            for index in range(self._outer):
                self._requests[index].security_margin = margin
            self._margin = margin


def _reaches_to_mount(arm: Arm) -> Float[np.ndarray, "j"]:
    """How far the last joint can be from the axis of each [m], at most."""
    lengths = [float(np.linalg.norm(placement.translation)) for placement in list(arm.model.jointPlacements)[1:]]
    return np.array([sum(lengths[i + 1 :]) for i in range(len(lengths))])


def hand_boxes(gripper: Gripper, low: float, high: float) -> tuple[Box, ...]:
    """What the hand covers while its fingers move between two openings [m]: palm, +y finger, -y finger."""
    finger = tuple(box.shifted(low / 2).opened((high - low) / 2) for box in gripper.finger)
    return gripper.palm + finger + tuple(box.mirrored() for box in finger)


def _centre(box: Box) -> Float[np.ndarray, "4 4"]:
    return make_transform(np.eye(3), np.array(box.centre))


def _transform(placement: "pin.SE3") -> "coal.Transform3s":
    return coal.Transform3s(placement.rotation, placement.translation)


def _se3(T: Float[np.ndarray, "4 4"]) -> "pin.SE3":
    return pin.SE3(T[:3, :3], T[:3, 3])
