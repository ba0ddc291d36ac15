"""A film strip of a planned pick: the arm, what stands around and what it carries, at the end of every phase."""

import numpy as np
from jaxtyping import Float
from PIL import Image

from icgnet.arm.animation import motion_of
from icgnet.arm.arm import Arm
from icgnet.arm.motion import Motion
from icgnet.arm.plan import PickPlan
from icgnet.errors import InputError
from icgnet.viewer.motion_scene import part_colour, support_height
from icgnet.viewer.picture import SceneDrawing, draw_scene
from icgnet.viewer.render import TableSurface
from icgnet.viewer.triangles import Triangles, join, mesh_triangles
from icgnet.viewer.view import framing_view

PANEL = (420, 520)
"""Height and width of one picture [pixels]."""
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
    names, times = ["start"], [0.0]
    ends = np.cumsum([phase.trajectory.duration for phase in plan.phases])
    for phase, end in zip(plan.phases, ends, strict=True):
        if phase.name == "carry":
            times.append(end - phase.trajectory.duration / 2)
            names.append(f"{times[-1]:.1f} s, carry, half way")
        times.append(end)
        names.append(f"{end:.1f} s, {phase.caption}")
    motion = motion_of(plan, arm, np.array(times))
    drawn = [_moment(motion, moment) for moment in range(len(times))]
    points = np.concatenate([triangles.corners.reshape(-1, 3) for triangles in drawn])
    view = framing_view(points, AZIMUTH, ELEVATION, panel, margin=0.04)
    table = _table(motion, points)
    return {
        name: draw_scene(SceneDrawing(triangles, (), view, table), panel)
        for name, triangles in zip(names, drawn, strict=True)
    }


def _moment(motion: Motion, moment: int) -> Triangles:
    """Everything that is there at a moment, in the world."""
    placed = [(part, part.at(moment)) for part in motion.parts if part.kind != "support"]
    return join(
        [
            mesh_triangles(part.mesh.copy().apply_transform(pose), part_colour(part))
            for part, pose in placed
            if pose is not None
        ]
    )


def _table(motion: Motion, points: Float[np.ndarray, "n 3"]) -> TableSurface:
    """The support under everything."""
    lower, upper = points.min(axis=0), points.max(axis=0)
    x, y = ((lower + upper) / 2)[:2]
    return TableSurface(support_height(motion), (float(x), float(y)), 0.7 * float(np.linalg.norm((upper - lower)[:2])))
