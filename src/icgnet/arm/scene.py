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

ROOM = 0.011
"""About how much room one test asks for, to be true for the positions around it [m]."""
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
        padding: distance that the carried body keeps from everything, beside any margin [m].
        unpadded: what it need not keep that distance from.
    """

    low: float
    high: float
    carried: CollisionBody | None = None
    T_base_gripped: Float[np.ndarray, "4 4"] | None = None
    untested: frozenset[Meeting] = frozenset()
    absent: frozenset[str] = frozenset()
    padding: float = 0.0
    unpadded: frozenset[Meeting] = frozenset()

    @property
    def key(self) -> tuple[object, ...]:
        """The same for loads that are the same."""
        gripped = None if self.T_base_gripped is None else self.T_base_gripped.tobytes()
        others = (self.untested, self.absent, self.padding, self.unpadded)
        return (self.low, self.high, self.carried, gripped, *others)


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
        of_last = np.append(np.zeros(len(arm.joint_names) - 1), reach)
        self.reaches = np.maximum(arm.reaches, arm.farthest(of_last))
        """How much farther than each joint anything that moves with the arm moves, at most; see `Arm.farthest`."""

        self._paddings: list[float] = []
        moving = [link for link in links if arm.link_shapes[link].joint > 0]
        gone = load.absent | ({load.carried.name} if load.carried is not None else set())
        for body in bodies:
            if body.name in gone:
                continue
            other = self._add(body.name, 0, pin.SE3.Identity(), body.geometry)
            for part in (*moving, *hand, *carried):
                meeting = Meeting(self._names[part], body.name)
                if meeting not in load.untested:
                    padded = part in carried and meeting not in load.unpadded
                    self._pair(part, other, load.padding if padded else 0.0)
        self._outer = len(self._paddings)
        for first, second in arm.link_pairs:
            self._pair(first, second)
        # A hand does not meet the link before its own, but what it carries may.
        held, before = arm.mount_joint, list(arm.model.parents)[arm.mount_joint]
        for link in links:
            for part in (*hand, *carried):
                if arm.link_shapes[link].joint not in ({held, before} if part in hand else {held}):
                    self._pair(part, link)
        self._results = self._shapes.createData()
        self._requests = self._results.collisionRequests
        self._tree = pin.TreeBroadPhaseManager_DynamicAABBTreeCollisionManager(arm.model, self._shapes, self._results)
        self._margins = (float("nan"), float("nan"), 0.0)
        self._set_margins(0.0)

    def _add(self, name: str, joint: int, placement: "pin.SE3", geometry: object) -> int:
        self._names.append(name)
        shape = pin.GeometryObject(f"{name} {len(self._names)}", joint, 0, placement, geometry)
        return self._shapes.addGeometryObject(shape)

    def _pair(self, first: int, second: int, padding: float = 0.0) -> None:
        self._shapes.addCollisionPair(pin.CollisionPair(first, second))
        self._paddings.append(padding)

    def collides(self, joints: Float[np.ndarray, "j"], margin: float = 0.0) -> bool:
        """Whether anything meets at these joint positions.

        Args:
            joints: [rad].
            margin: everything is met from this distance on [m], the arm by itself as well.
        """
        self._set_margins(margin)
        return self._meets(joints)

    def first_collision(self, path: Float[np.ndarray, "n j"], margin: float = 0.0) -> int | None:
        """Index of the first of several joint positions at which anything meets; None if nothing does."""
        self._set_margins(margin)
        return next((index for index, joints in enumerate(path) if self._meets(joints)), None)

    def is_free(self, path: Float[np.ndarray, "n j"], margin: float, step: float) -> bool:
        """Whether nothing meets at any of several joint positions.

        Where the middle one of several has more room than anything moves from it to the others, those are not tested.

        Args:
            path: joint positions [rad].
            margin: as in `collides` [m].
            step: no point moves farther than this from one position to the next [m].
        """
        reach = max(1, int(ROOM / step))
        blocks = [path[first : first + 2 * reach + 1] for first in range(0, len(path), 2 * reach + 1)]
        doubtful = [block for block in blocks if self.collides(block[len(block) // 2], margin + reach * step)]
        return all(self.first_collision(block, margin) is None for block in doubtful)

    def meetings(self, joints: Float[np.ndarray, "j"], margin: float = 0.0) -> tuple[Meeting, ...]:
        """Everything that meets at these joint positions, each pair of names once."""
        self._set_margins(margin)
        return self._met(joints)

    def _meets(self, joints: Float[np.ndarray, "j"]) -> bool:
        return bool(pin.computeCollisions(self.arm.model, self.arm.data, self._tree, joints, True))

    def _met(self, joints: Float[np.ndarray, "j"]) -> tuple[Meeting, ...]:
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
        self._set_margins(0.0)
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
            if not self._is_near(joints, near):
                continue
            clear, nearest = 0.0, joints
            while near - clear > CLEARANCE_STEP:
                middle = (clear + near) / 2
                clear, near = (clear, middle) if self._is_near(joints, middle) else (middle, near)
            near = clear
            if near == 0.0:
                break
        if nearest is None:
            return FARTHEST_CLEARANCE, None
        self._set_margins(near + CLEARANCE_STEP, 0.0, 0.0)
        return near, self._met(nearest)[0]

    def _is_near(self, joints: Float[np.ndarray, "j"], distance: float) -> bool:
        """Whether anything that moves is nearer to anything that stands around than a distance [m]."""
        self._set_margins(distance, 0.0, 0.0)
        return self._meets(joints)

    def _set_margins(self, margin: float, own: float | None = None, share: float = 1.0) -> None:
        """Distances from which on things meet: those that stand around, the arm by itself, and how much of paddings."""
        margins = (margin, margin if own is None else own, share)
        if margins != self._margins:
            for index, padding in enumerate(self._paddings):
                self._requests[index].security_margin = margins[index >= self._outer] + share * padding
            self._margins = margins


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
