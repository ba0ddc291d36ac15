"""A film strip of a planned pick: the arm, what stands around and what it carries, at the end of every phase."""

import numpy as np
from jaxtyping import Float
from PIL import Image

from icgnet.arm.arm import Arm
from icgnet.arm.bodies import SUPPORT, CollisionBody
from icgnet.arm.plan import Phase, PickPlan
from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform
from icgnet.viewer.palette import UNASSIGNED, instance_colour
from icgnet.viewer.picture import SceneDrawing, draw_scene
from icgnet.viewer.render import TableSurface
from icgnet.viewer.triangles import Colour, Triangles, join, mesh_triangles, whole_hand_triangles
from icgnet.viewer.view import framing_view

PANEL = (420, 520)
"""Height and width of one picture [pixels]."""
ARM_COLOUR, HAND_COLOUR = (0.80, 0.82, 0.85), (0.24, 0.66, 0.30)
AZIMUTH, ELEVATION = np.deg2rad(-50.0), np.deg2rad(24.0)


def pick_panels(plan: PickPlan, arm: Arm, panel: tuple[int, int] = PANEL) -> dict[str, Image.Image]:
    """Pictures by their captions: the start, the end of every phase, and the middle of the way with the object.

    Args:
        plan: a plan with phases.
        arm: the arm that it is for.
        panel: height and width of each [pixels].

    Raises:
        InputError: a plan without phases.
    """
    if not plan.is_found:
        raise InputError("a plan without phases cannot be drawn")
    first = plan.phases[0]
    moments = [("start", first, 0.0)]
    now = 0.0
    for phase in plan.phases:
        if phase.name == "carry":
            moments.append((f"{now + phase.trajectory.duration / 2:.1f} s, carry, half way", phase, 0.5))
        now += phase.trajectory.duration
        moments.append((f"{now:.1f} s, {caption(phase)}", phase, 1.0))
    drawn = [(name, _moment(plan, arm, phase, share)) for name, phase, share in moments]
    points = np.concatenate([triangles.corners.reshape(-1, 3) for _, triangles in drawn])
    view = framing_view(points, AZIMUTH, ELEVATION, panel, margin=0.04)
    table = _table(plan, arm, points)
    return {name: draw_scene(SceneDrawing(triangles, (), view, table), panel) for name, triangles in drawn}


def caption(phase: Phase) -> str:
    """Name of a phase, how near it came to what."""
    if phase.nearest is None:
        return phase.name
    return f"{phase.name}, {1e3 * phase.clearance:.0f} mm from {phase.nearest.body}"


def _moment(plan: PickPlan, arm: Arm, phase: Phase, share: float) -> Triangles:
    """The arm at a share of a phase, with everything around, in the world."""
    trajectory = phase.trajectory
    joints = trajectory.at(np.array([share * trajectory.duration]))[0]
    T_world_base, T_base_grasp = arm.description.T_world_base, arm.grasp_pose(joints, plan.gripper)
    load = phase.load
    bodies = [(body, np.eye(4)) for body in (*plan.bodies, *phase.extra) if _stands(body, phase)]
    if load.carried is not None and load.T_base_gripped is not None:
        bodies.append((load.carried, T_base_grasp @ invert_transform(load.T_base_gripped)))
    opening = phase.opening if share == 1.0 else load.high
    return join(
        [
            *(mesh_triangles(mesh.apply_transform(T_world_base), ARM_COLOUR) for mesh in arm.link_meshes(joints)),
            *(
                mesh_triangles(body.mesh.copy().apply_transform(T_world_base @ moved), _colour(body))
                for body, moved in bodies
            ),
            whole_hand_triangles(plan.gripper, T_world_base @ T_base_grasp, opening, HAND_COLOUR, 1.0),
        ]
    )


def _stands(body: CollisionBody, phase: Phase) -> bool:
    carried = None if phase.load.carried is None else phase.load.carried.name
    return body.name not in {SUPPORT, carried, *phase.load.absent}


def _colour(body: CollisionBody) -> Colour:
    return UNASSIGNED if body.instance < 0 else instance_colour(body.instance)


def _table(plan: PickPlan, arm: Arm, points: Float[np.ndarray, "n 3"]) -> TableSurface:
    """The support under everything, as high as in the middle of its upper side."""
    support = next(body for body in plan.bodies if body.name == SUPPORT)
    corners = support.mesh.copy().apply_transform(arm.description.T_world_base).vertices
    height = float(np.sort(corners[:, 2])[-4:].mean())
    lower, upper = points.min(axis=0), points.max(axis=0)
    x, y = ((lower + upper) / 2)[:2]
    return TableSurface(height, (float(x), float(y)), 0.7 * float(np.linalg.norm((upper - lower)[:2])))
