"""Where things are in the workcell: arm, camera on its wrist, places to look from, drop-off box."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from icgnet.arm.arm import Arm
from icgnet.arm.bodies import SUPPORT, CollisionBody
from icgnet.arm.description import read_description
from icgnet.arm.kinematics import make_solver
from icgnet.arm.move import plan_move
from icgnet.arm.plan import Phase
from icgnet.arm.scene import CollisionChecker, Load
from icgnet.arm.settings import PickSettings
from icgnet.errors import InputError
from icgnet.geometry.camera import sphere_pose
from icgnet.geometry.transforms import invert_transform, make_transform, rotation_z, transform_points
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT
from icgnet.grasping.gripper import Gripper
from icgnet.sensors.config import CAMERAS
from icgnet.simulation.arm import ArmModel
from icgnet.simulation.robot_cell import BOX_NAME, Command, DropBox
from icgnet.simulation.surroundings import Surroundings

BASE = (-0.35, CENTRE[1], TABLE_HEIGHT)
"""Where the arm stands in the world, its x axis over the middle of the workspace, half a metre away [m]."""
BOX = DropBox(centre=(BASE[0] + 0.30, BASE[1] + 0.48))
DROP_ABOVE = 0.03
"""The lowest point of an object is this far above the walls of the box when it is let go of [m]."""
CAMERA = CAMERAS["d415_vga"]
T_GRASP_CAMERA = make_transform(
    np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), np.array([0.07, 0.0, -0.10])
)
"""The camera looks along the approach, beside the palm: rows of the picture lie along the closing axis."""
VIEWS_DEG = ((30.0, 180.0), (45.0, 90.0), (45.0, -90.0), (15.0, 0.0), (0.0, 180.0))
"""Places to look from, in their order: angle from the vertical, and azimuth about the middle of the workspace (0: from
beyond it, 180: from the arm's side) [degrees]."""
VIEW_DISTANCE, PER_EDGE, VIEW_HEIGHT = 0.5, 1.2, 0.05
"""Distance of the camera: at least the first [m], and the second times the longer edge of the support; from a point
this far above its middle [m]."""
ROLLS = 8
"""So many turns of the camera about its axis are tried; the picture is turned, no more."""
HAND_EYE_SHIFT, HAND_EYE_TURN = 0.002, float(np.deg2rad(0.3))
"""How far the camera is from where it is believed to be [m], [rad]."""
HOLDING = ("close", "lift", "carry", "lower")
"""Phases in which the fingers close with full force."""
TALLEST = 0.22
"""While nothing has been seen yet, the arm keeps out of the space over the support up to this height [m]."""


@dataclass(frozen=True, eq=False)
class Station:
    """An arm with its hand in the workcell.

    Attributes:
        arm: the arm, standing where `standing_arm` puts it.
        gripper: its hand.
        surroundings: of the scene.
    """

    arm: Arm
    gripper: Gripper
    surroundings: Surroundings

    @property
    def T_world_base(self) -> Float[np.ndarray, "4 4"]:
        """Where the arm stands."""
        return self.arm.description.T_world_base

    @property
    def T_base_world(self) -> Float[np.ndarray, "4 4"]:
        """The world in the frame of the arm's base."""
        return invert_transform(self.T_world_base)

    @cached_property
    def T_mount_camera(self) -> Float[np.ndarray, "4 4"]:
        """Where the camera is on the link that carries the hand."""
        return self.arm.T_mount_grasp(self.gripper) @ T_GRASP_CAMERA

    @cached_property
    def drop(self) -> Float[np.ndarray, "3"]:
        """Where objects are let go of, in the frame of the base [m]."""
        above = np.array([*BOX.centre, TABLE_HEIGHT + BOX.height + DROP_ABOVE])
        return transform_points(self.T_base_world, above)

    @cached_property
    def box(self) -> CollisionBody:
        """The drop-off box for the planner, in the frame of the base."""
        walls = [each.mesh() for each in BOX.structures()]
        return CollisionBody(BOX_NAME, trimesh.util.concatenate(walls).apply_transform(self.T_base_world))

    @cached_property
    def walls(self) -> tuple[CollisionBody, ...]:
        """What stands around the objects, for those who know it, in the frame of the base."""
        return tuple(
            CollisionBody(each.name, each.mesh().apply_transform(self.T_base_world))
            for each in self.surroundings.structures
        )

    @cached_property
    def unseen(self) -> tuple[CollisionBody, ...]:
        """What the empty arm keeps away from before it has seen anything: the box, and the space over the support."""
        lower, upper = self.surroundings.bounds
        size = np.array([*(upper - lower), TALLEST])
        space = trimesh.creation.box(size).apply_translation([*(lower + upper) / 2, TABLE_HEIGHT + TALLEST / 2])
        slab = trimesh.creation.box((4.0, 4.0, 0.2)).apply_translation([*(lower + upper) / 2, TABLE_HEIGHT - 0.1])
        named = {"space over the support": space, SUPPORT: slab}
        bodies = (CollisionBody(name, mesh.apply_transform(self.T_base_world)) for name, mesh in named.items())
        return (*bodies, self.box)

    @cached_property
    def model(self) -> ArmModel:
        """The arm for the engine."""
        arm = self.arm
        parts = tuple(
            (shape.joint, shape.mesh.copy().apply_transform(np.array(shape.placement.homogeneous)))
            for shape in arm.link_shapes
        )
        ranges = np.stack([arm.model.lowerPositionLimit, arm.model.upperPositionLimit], axis=1)
        T_joint_grasp = arm.T_joint_mount @ arm.T_mount_grasp(self.gripper)
        frames, motions = arm.joint_frames, arm.joint_motions
        return ArmModel(self.T_world_base, frames, motions, ranges, arm.efforts, parts, T_joint_grasp)

    @cached_property
    def views(self) -> tuple[Float[np.ndarray, "j"], ...]:
        """Joint positions from which the support is seen, those of `VIEWS_DEG` that the arm can reach.

        Raises:
            InputError: it can reach none.
        """
        found = []
        lower, upper = self.surroundings.bounds
        target = np.array([*(lower + upper) / 2, TABLE_HEIGHT + VIEW_HEIGHT])
        distance = max(VIEW_DISTANCE, PER_EDGE * float((upper - lower).max()))
        opened = Load(self.gripper.max_opening, self.gripper.max_opening)
        checker = CollisionChecker(self.arm, self.gripper, self.unseen, opened)
        solver, margin = make_solver(self.arm), PickSettings().margin
        for polar, azimuth in np.deg2rad(VIEWS_DEG):
            looking = sphere_pose(target, distance, polar, azimuth)
            solutions = [np.zeros((0, len(self.arm.home)))]
            for roll in 2 * np.pi * np.arange(ROLLS) / ROLLS:
                T_world_camera = looking @ make_transform(rotation_z(roll), np.zeros(3))
                solutions.append(
                    solver.solutions(self.T_base_world @ T_world_camera @ invert_transform(self.T_mount_camera))
                )
            joints = np.concatenate(solutions)
            order = np.argsort(np.abs(joints - self.arm.home).max(axis=1), kind="stable")
            free = (row for row in order if not checker.collides(joints[row], 2 * margin))
            best = next(free, None)
            if best is not None:
                found.append(joints[best])
        if not found:
            raise InputError(
                f"arm {self.arm.name} reaches none of the places to look from: it is built too differently"
            )
        return tuple(found)

    def move(self, start: Float[np.ndarray, "j"], goal: Float[np.ndarray, "j"]) -> Phase | None:
        """A movement from one place to look from to another; None if none was found."""
        return plan_move(self.arm, self.gripper, start, goal, self.unseen)


def standing_arm(source: str) -> Arm:
    """The arm of a name or file, upright in its place in the workcell, wherever it stands by its file.

    Raises:
        DataError: see `Arm`.
    """
    return Arm(replace(read_description(source), T_world_base=make_transform(np.eye(3), np.array(BASE))))


def command_of(phase: Phase, step: float) -> Command:
    """What the controllers get of a phase, one position every `step` [s]."""
    duration = phase.trajectory.duration
    times = np.linspace(0.0, duration, max(2, int(np.ceil(duration / step)) + 1))
    opening = None if phase.name in HOLDING else phase.opening
    return Command(phase.name, times, phase.trajectory.at(times), opening)


def misplaced(T_mount_camera: Float[np.ndarray, "4 4"], rng: np.random.Generator) -> Float[np.ndarray, "4 4"]:
    """The camera where it is believed to be: off by `HAND_EYE_SHIFT` and `HAND_EYE_TURN` in drawn directions."""
    shift, axis = (each / np.linalg.norm(each) for each in rng.normal(size=(2, 3)))
    turn = Rotation.from_rotvec(HAND_EYE_TURN * axis).as_matrix()
    return T_mount_camera @ make_transform(turn, HAND_EYE_SHIFT * shift)
