"""What is around the objects on the page: the plane they stand on, points of no object, and the axes of the frame."""

from dataclasses import dataclass

import numpy as np
import viser
from jaxtyping import Float

from icgnet.geometry.transforms import matrix_to_quaternion, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.prediction import NO_INSTANCE, SupportPlane
from icgnet.viewer.page.objects import add_points
from icgnet.viewer.page.stage import Stage
from icgnet.viewer.palette import UNASSIGNED

LARGEST_CLOUD = 60_000
"""More points of no object than this are thinned out."""
ON_PLANE = 0.01
"""Points nearer to a plane than this are on it [m]."""
SMALLEST_PATCH, LARGEST_PATCH = 0.3, 3.0
"""Edges of the piece of a plane that is drawn [m]."""
CELL = 0.05
AXES = 0.08
PLANE, RIVAL = (214, 224, 238), (244, 177, 131)
LINES, SECTIONS = (196, 202, 212), (160, 168, 182)


@dataclass(frozen=True, eq=False)
class Patch:
    """The piece of a plane on which points were measured, in the frame of the scene.

    Attributes:
        middle: [m].
        rotation: its axes as columns; the third is the normal.
        size: edges along the first two [m].
    """

    middle: Float[np.ndarray, "3"]
    rotation: Float[np.ndarray, "3 3"]
    size: tuple[float, float]


class SurroundingsPanel:
    """Switches for all that is not a grasp."""

    def __init__(self, stage: Stage) -> None:
        server, prediction, T_table_frame = stage.server, stage.prediction, stage.T_table_frame
        gui, supports = server.gui, prediction.supports
        points = transform_points(T_table_frame, prediction.cloud.points)
        with gui.add_folder("Scene", expand_by_default=False):
            self._points = gui.add_checkbox("Points", True)
            self._background = gui.add_checkbox("Background", True)
            self._shapes = gui.add_checkbox("Shapes", True)
            self._names = gui.add_checkbox("Names", True)
            self._plane = gui.add_checkbox("Support plane", True)
            self._rivals = gui.add_checkbox("Rival planes", False, visible=len(supports) > 1)
            self._axes = gui.add_checkbox("Frame axes", True)
            gui.add_markdown(_told_of(supports))
        stage.watch(self._points, self._background, self._shapes, self._names, self._plane, self._rivals, self._axes)

        stray = points[prediction.cloud_instances == NO_INSTANCE]
        self._cloud = add_points(server, "/background", stray[:: max(1, -(-len(stray) // LARGEST_CLOUD))], UNASSIGNED)
        table = plane_patch(points, np.array([0.0, 0.0, 1.0]), TABLE_HEIGHT)
        self._table = _add_plane(server, "/support/0", table, PLANE)
        self._others = [
            _add_plane(server, f"/support/{number}", plane_patch(points, *_in_scene(each, T_table_frame)), RIVAL)
            for number, each in enumerate(supports[1:], start=1)
        ]
        self._frame = (
            server.scene.add_frame(
                "/frame",
                axes_length=AXES,
                axes_radius=AXES / 25,
                wxyz=matrix_to_quaternion(T_table_frame[:3, :3]),
                position=T_table_frame[:3, 3],
            ),
            server.scene.add_label("/frame/name", prediction.frame_id, anchor="top-center"),
        )

    @property
    def of_objects(self) -> tuple[bool, bool, bool]:
        """Whether points, shapes and names of objects are shown."""
        return bool(self._points.value), bool(self._shapes.value), bool(self._names.value)

    def update(self) -> None:
        """Shows what is switched on."""
        self._cloud.visible = self._background.value
        self._table.visible = self._plane.value
        for each in self._others:
            each.visible = self._rivals.value
        for each in self._frame:
            each.visible = self._axes.value


def plane_patch(points: Float[np.ndarray, "n 3"], normal: Float[np.ndarray, "3"], height: float) -> Patch:
    """The piece of the plane `normal @ x = height` on which points [m] lie; its first axis is nearest to x, or y."""
    across = np.eye(3)[0 if abs(normal[0]) < 0.8 else 1]
    x = across - normal * (across @ normal)
    x /= np.linalg.norm(x)
    rotation = np.column_stack([x, np.cross(normal, x), normal])
    own = points[np.abs(points @ normal - height) < ON_PLANE]
    places = (own if len(own) else points) @ rotation[:, :2]
    lower, upper = np.percentile(places, (1, 99), axis=0) if len(places) else (np.zeros(2), np.full(2, SMALLEST_PATCH))
    width, length = np.clip(upper - lower, SMALLEST_PATCH, LARGEST_PATCH).tolist()
    middle = rotation @ np.array([*((lower + upper) / 2), height])
    return Patch(middle, rotation, (width, length))


def _in_scene(plane: SupportPlane, T_table_frame: Float[np.ndarray, "4 4"]) -> tuple[Float[np.ndarray, "3"], float]:
    """Normal and height [m] of a plane in the frame of the scene."""
    normal = T_table_frame[:3, :3] @ np.array(plane.normal)
    return normal, plane.height + float(normal @ T_table_frame[:3, 3])


def _add_plane(server: viser.ViserServer, name: str, patch: Patch, colour: tuple[int, int, int]) -> viser.GridHandle:
    return server.scene.add_grid(
        name,
        width=patch.size[0],
        height=patch.size[1],
        cell_size=CELL,
        section_size=5 * CELL,
        cell_color=LINES,
        section_color=SECTIONS,
        plane_color=colour,
        plane_opacity=0.5,
        wxyz=matrix_to_quaternion(patch.rotation),
        position=patch.middle,
    )


def _told_of(supports: tuple[SupportPlane, ...]) -> str:
    if not supports:
        return "the height of the table was given"
    lines = [
        f"{name}: {plane.share:.0%} of the points, tilt {plane.tilt_deg:.1f}\u00b0"
        for name, plane in zip(("support", *("rival",) * len(supports)), supports, strict=False)
    ]
    return "  \n".join(lines)
