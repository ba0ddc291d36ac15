"""The model of an arm: joints, limits, where its links are, and which of them may meet."""

# The compiled modules of pinocchio carry no types.
# pyright: reportAttributeAccessIssue=false

import warnings
import xml.etree.ElementTree as ElementTree
from functools import cached_property
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float

from icgnet.arm.description import ArmDescription, read_description
from icgnet.arm.libraries import pin
from icgnet.errors import DataError, InputError
from icgnet.geometry.arrays import real_array
from icgnet.geometry.transforms import invert_transform
from icgnet.grasping.gripper import Gripper

SLACK = 1e-6
"""Joint positions may be outside of their limits by rounding [rad]."""


class Arm:
    """An arm without a hand: its own, if the URDF has one, is left out, and the hand of the grasps takes its place.

    Args:
        description: of the arm.

    Raises:
        DataError: the URDF cannot be read, has no such link, or the description does not fit its joints.
    """

    def __init__(self, description: ArmDescription) -> None:
        self.description = description
        self.name = description.name
        self.model, self.link_shapes = _read_urdf(description)
        self.data = self.model.createData()
        self.joint_names: tuple[str, ...] = tuple(self.model.names)[1:]
        count = len(self.joint_names)
        if len(description.home) != count:
            raise DataError(
                f"arm {self.name}: home has {len(description.home)} joints, the URDF {count} up to the hand"
            )
        self._mount = self.model.getFrameId(description.mount_link)
        self.lower = self._limit("lower", self.model.lowerPositionLimit, np.greater_equal)
        self.upper = self._limit("upper", self.model.upperPositionLimit, np.less_equal)
        speeds = np.array(self.model.velocityLimit)
        self.velocity = self._limit("velocity", np.where(speeds > 0, speeds, np.inf), np.less_equal)
        self.acceleration = description.acceleration
        if not (self.lower < self.upper).all() or not (self.velocity > 0).all():
            raise DataError(f"arm {self.name}: every joint needs lower < upper and a velocity above 0")
        self.home = self.check_joints(description.home, "home")

    def _limit(self, name: str, of_urdf: Float[np.ndarray, "j"], is_within: np.ufunc) -> Float[np.ndarray, "j"]:
        """Limits of the arm file, which may be narrower than those of the URDF, or the latter.

        Raises:
            DataError: neither says them, or those of the file are wider.
        """
        given: Float[np.ndarray, "j"] | None = getattr(self.description, name)
        values = np.array(of_urdf if given is None else given, float)
        if not np.isfinite(values).all():
            raise DataError(f"the URDF has no limits for all joints: give {name} in the arm file")
        wider = np.isfinite(of_urdf) & ~is_within(values, of_urdf)
        if wider.any():
            worst = int(np.argmax(wider))
            raise DataError(
                f"arm {self.name}: {name} of {self.joint_names[worst]} is {values[worst]:g}, beyond the "
                f"{of_urdf[worst]:g} of the URDF"
            )
        return values

    @staticmethod
    def load(source: str | Path = "fr3") -> "Arm":
        """The arm of a file, or one that ships with the package, by name.

        Raises:
            DataError: see `read_description` and `Arm`.
        """
        return Arm(read_description(source))

    @property
    def shoulder(self) -> Float[np.ndarray, "3"]:
        """Where the first joint is, in the frame of the base [m]."""
        return np.array(self.model.jointPlacements[1].translation)

    @property
    def up(self) -> Float[np.ndarray, "3"]:
        """The direction away from the ground in the frame of the base: not its z if the arm hangs or leans."""
        return self.description.T_world_base[2, :3].copy()

    @property
    def mount_joint(self) -> int:
        """Number of the joint that moves the link which the hand is mounted on."""
        return self.model.frames[self._mount].parentJoint

    def T_mount_grasp(self, gripper: Gripper) -> Float[np.ndarray, "4 4"]:
        """The grasp frame of a hand in the frame of the link that it is mounted on."""
        return self.description.T_link_mount @ invert_transform(gripper.T_grasp_base)

    @cached_property
    def T_joint_mount(self) -> Float[np.ndarray, "4 4"]:
        """The mount's link in the frame of the joint that moves it."""
        return np.array(self.model.frames[self._mount].placement.homogeneous)

    @cached_property
    def joint_frames(self) -> Float[np.ndarray, "j 4 4"]:
        """Where each joint sits in the frame of the joint before it, the first in that of the base, at position 0."""
        return np.array([placement.homogeneous for placement in list(self.model.jointPlacements)[1:]])

    @cached_property
    def joint_motions(self) -> Float[np.ndarray, "j 6"]:
        """How each joint moves what is behind it, in its own frame: a unit axis it slides along, or one it turns about.

        The first three numbers are the axis of a sliding joint, the last three that of a turning one; the others are 0.
        """
        pin.computeJointJacobians(self.model, self.data, self.home)
        columns = [pin.getJointJacobian(self.model, self.data, j + 1, pin.LOCAL)[:, j] for j in range(self.model.nv)]
        return np.array(columns).round(9)

    @property
    def efforts(self) -> Float[np.ndarray, "j"]:
        """Largest effort of each joint [N m], of the URDF."""
        return np.array(self.model.upperEffortLimit)

    def check_joints(self, joints: object, name: str) -> Float[np.ndarray, "j"]:
        """Joint positions [rad] as an array, after making sure that they are within the limits.

        Raises:
            InputError: not one finite number for each joint, or one outside of its limits.
        """
        values = real_array(joints, name, (len(self.joint_names),))
        if not self.within_limits(values):
            worst = int(np.argmax(np.maximum(self.lower - values, values - self.upper)))
            raise InputError(
                f"{name}: {self.joint_names[worst]} must be between {self.lower[worst]:g} and {self.upper[worst]:g} "
                f"rad, got {values[worst]:g}"
            )
        return values

    def within_limits(self, joints: Float[np.ndarray, "*n j"]) -> bool:
        """Whether all joint positions are within their limits."""
        return bool(((joints >= self.lower - SLACK) & (joints <= self.upper + SLACK)).all())

    def mount_pose(self, joints: Float[np.ndarray, "j"]) -> Float[np.ndarray, "4 4"]:
        """T_base_mount: where the link is that the hand is mounted on."""
        pin.framesForwardKinematics(self.model, self.data, joints)
        return np.array(self.data.oMf[self._mount].homogeneous)

    def grasp_pose(self, joints: Float[np.ndarray, "j"], gripper: Gripper) -> Float[np.ndarray, "4 4"]:
        """T_base_grasp: where the grasp frame of this hand is."""
        return self.mount_pose(joints) @ self.T_mount_grasp(gripper)

    def mount_jacobian(self, joints: Float[np.ndarray, "j"]) -> Float[np.ndarray, "6 j"]:
        """How the mount's link moves with the joints, in its own frame: three rows of translation, three of turning."""
        return np.array(pin.computeFrameJacobian(self.model, self.data, joints, self._mount, pin.LOCAL))

    def link_poses(self, joints: Float[np.ndarray, "j"]) -> Float[np.ndarray, "l 4 4"]:
        """Poses of the collision shapes of the links in the frame of the base."""
        pin.forwardKinematics(self.model, self.data, joints)
        placed = [self.data.oMi[shape.joint] * shape.placement for shape in self.link_shapes]
        return np.array([each.homogeneous for each in placed]).reshape(-1, 4, 4)

    @cached_property
    def link_pairs(self) -> tuple[tuple[int, int], ...]:
        """Pairs of link shapes, by number, that could meet: not neighbours, and not told by the SRDF never to."""
        never = _never_meeting(self.description)
        parents = list(self.model.parents)

        def may_meet(first: "LinkShape", second: "LinkShape") -> bool:
            if (
                first.joint == second.joint
                or first.joint == parents[second.joint]
                or second.joint == parents[first.joint]
            ):
                return False
            return frozenset((first.link, second.link)) not in never

        shapes = list(enumerate(self.link_shapes))
        return tuple((i, j) for i, first in shapes for j, second in shapes[i + 1 :] if may_meet(first, second))

    @cached_property
    def reaches(self) -> Float[np.ndarray, "j"]:
        """How far a point of the arm, without the hand, can be from the axis of each joint [m]; see `farthest`."""
        extents = np.zeros(len(self.joint_names) + 1)
        for shape in self.link_shapes:
            points = shape.mesh.vertices @ shape.placement.rotation.T + shape.placement.translation
            extents[shape.joint] = max(extents[shape.joint], np.linalg.norm(points, axis=1).max())
        extents[-1] = max(extents[-1], float(np.linalg.norm(self.T_joint_mount[:3, 3])))
        return self.farthest(extents[1:])

    def farthest(self, extents: Float[np.ndarray, "j"]) -> Float[np.ndarray, "j"]:
        """How far a point moves at most, by how far each joint does: its distance from the axis [m], 1 if it slides.

        Args:
            extents: how far what each joint moves extends from the frame of that joint [m].
        """
        slides = np.abs(self.joint_motions[:, :3]).any(axis=1)
        lengths = np.linalg.norm(self.joint_frames[:, :3, 3], axis=1)
        lengths += slides * np.maximum(np.abs(self.lower), np.abs(self.upper))
        found = [
            max(lengths[first + 1 : last + 1].sum() + extents[last] for last in range(first, len(extents)))
            for first in range(len(extents))
        ]
        return np.where(slides, 1.0, found)


class LinkShape:
    """One convex collision shape of a link.

    Attributes:
        link: name of the link.
        joint: number of the joint that moves it; 0 for the base.
        placement: in the frame of that joint.
        geometry: of coal.
        mesh: the same as triangles, in its own frame [m].
    """

    def __init__(self, link: str, shape: "pin.GeometryObject") -> None:
        self.link, self.joint, self.placement = link, shape.parentJoint, shape.placement
        self.geometry, self.mesh = _convex(shape)


def _convex(shape: "pin.GeometryObject") -> tuple[object, trimesh.Trimesh]:
    """The geometry of a URDF as coal's, meshes by their convex hull, and as triangles."""
    geometry = shape.geometry
    kind = type(geometry).__name__
    if kind == "Box":
        return geometry, trimesh.creation.box(2.0 * np.array(geometry.halfSide))
    if kind == "Sphere":
        return geometry, trimesh.creation.icosphere(subdivisions=2, radius=geometry.radius)
    if kind == "Cylinder":
        return geometry, trimesh.creation.cylinder(geometry.radius, 2.0 * geometry.halfLength, sections=24)
    if kind == "Capsule":
        return geometry, trimesh.creation.capsule(2.0 * geometry.halfLength, geometry.radius, count=[16, 16])
    geometry.buildConvexHull(False, "Qt")
    return geometry.convex, trimesh.PointCloud(np.array(geometry.convex.points())).convex_hull


def _read_urdf(description: ArmDescription) -> tuple["pin.Model", list[LinkShape]]:
    """Joints and collision shapes from the base to the hand's mount; whatever else moves is fixed where it is.

    Raises:
        DataError: see `Arm`.
    """
    where = f"arm {description.name}, {description.urdf.name}"
    try:
        with warnings.catch_warnings():  # of the bindings, about their own default arguments
            warnings.simplefilter("ignore")
            model = pin.buildModelFromUrdf(str(description.urdf))
            shapes = pin.buildGeomFromUrdf(
                model, str(description.urdf), pin.GeometryType.COLLISION, [str(each) for each in description.packages]
            )
    except (ValueError, RuntimeError) as error:
        raise DataError(f"{where}: {' '.join(str(error).split())[:200]}") from error
    if not model.existFrame(description.mount_link):
        raise DataError(f"{where}: there is no link {description.mount_link!r} to mount the hand on")
    mount = model.frames[model.getFrameId(description.mount_link)].parentJoint
    chain = list(model.supports[mount])
    locked = [joint for joint in range(1, model.njoints) if joint not in chain]
    beyond = _links_beyond(description)
    kept = [shape.name for shape in shapes.geometryObjects if model.frames[shape.parentFrame].name not in beyond]
    links = {shape.name: model.frames[shape.parentFrame].name for shape in shapes.geometryObjects}
    model, shapes = pin.buildReducedModel(model, shapes, locked, pin.neutral(model))
    if model.nq != model.nv or model.njoints != model.nq + 1:
        raise DataError(f"{where}: joints without limits and joints of several axes are not supported")
    return model, [LinkShape(links[each.name], each) for each in shapes.geometryObjects if each.name in kept]


def _links_beyond(description: ArmDescription) -> set[str]:
    """The links that hang on the mount: a hand of the URDF."""
    children: dict[str, list[str]] = {}
    for joint in ElementTree.parse(description.urdf).getroot().iter("joint"):
        parent, child = joint.find("parent"), joint.find("child")
        if parent is not None and child is not None:
            children.setdefault(parent.attrib["link"], []).append(child.attrib["link"])
    found, waiting = set(), [description.mount_link]
    while waiting:
        new = children.get(waiting.pop(), [])
        found.update(new)
        waiting.extend(new)
    return found


def _never_meeting(description: ArmDescription) -> set[frozenset[str]]:
    """Pairs of links that the SRDF tells not to check.

    Raises:
        DataError: it cannot be read.
    """
    if description.srdf is None:
        return set()
    try:
        entries = ElementTree.parse(description.srdf).getroot().iter("disable_collisions")
        return {frozenset((each.attrib["link1"], each.attrib["link2"])) for each in entries}
    except (ElementTree.ParseError, KeyError, OSError) as error:
        raise DataError(f"arm {description.name}: {description.srdf.name} cannot be read: {error}") from error
