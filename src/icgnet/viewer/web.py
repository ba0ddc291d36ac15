"""A prediction in the browser: turn it, hide objects, move the score threshold. The only file that uses viser."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import viser
from jaxtyping import Float

from icgnet.geometry.transforms import invert_transform, matrix_to_quaternion, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import NO_INSTANCE, DetectedObject, Prediction
from icgnet.viewer.describe import best_per_object, object_name, object_top, points_on_table, summary
from icgnet.viewer.palette import instance_colour, score_colours, to_bytes
from icgnet.viewer.triangles import hand_mesh, slim_hand_mesh
from icgnet.viewer.view import framing_view

HANDS_PER_OBJECT = 20
LARGEST_CLOUD = 100_000
SHOWN_AT_FIRST = 2
POINT_SIZE = 0.002
VIEW_AZIMUTH, VIEW_ELEVATION = np.deg2rad(-60.0), np.deg2rad(40.0)


def open_viewer(source: str | Path | Prediction, port: int = 8080, host: str = "127.0.0.1") -> "WebViewer":
    """Starts a viewer of a prediction and returns at once; the page is served until `stop` is called.

    Args:
        source: a prediction, or a folder that `Prediction.save` wrote.
        port: of the web page; the next free one if it is taken.
        host: address to listen on; "0.0.0.0" lets other machines look.

    Raises:
        DataError: the folder is not a saved prediction.
    """
    prediction = source if isinstance(source, Prediction) else Prediction.load(source)
    return WebViewer(prediction, viser.ViserServer(host=host, port=port, label="icgnet", verbose=False))


@dataclass(frozen=True)
class _Parts:
    """What belongs to one object on the page."""

    switch: viser.GuiCheckboxHandle
    cloud: viser.PointCloudHandle
    shape: viser.MeshHandle
    label: viser.LabelHandle


@dataclass(frozen=True)
class _Hand:
    """One grasp on the page; `rank` counts from 0 within its object."""

    score: float
    instance: int
    rank: int
    slim: viser.MeshHandle
    whole: viser.MeshHandle


class WebViewer:
    """A page with the clouds, shapes and hands of a prediction, all in its table frame (z up)."""

    def __init__(self, prediction: Prediction, server: viser.ViserServer) -> None:
        self.server = server
        self._T_table_frame = invert_transform(prediction.T_frame_table)
        self._set_up_page(prediction)
        self._add_controls(prediction)
        with server.gui.add_folder("Objects"):
            self._parts = {item.instance_id: self._add_object(item) for item in prediction.objects}
        self._add_stray_points(prediction)
        self._hands = self._add_hands(prediction.grasps.transformed(self._T_table_frame), prediction.gripper)
        self._update()

    @property
    def url(self) -> str:
        """Address of the page."""
        host = self.server.get_host()
        return f"http://{'localhost' if host == '0.0.0.0' else host}:{self.server.get_port()}"

    def wait(self) -> None:
        """Blocks until the process is interrupted."""
        self.server.sleep_forever()

    def stop(self) -> None:
        """Closes the page and frees the port."""
        self.server.stop()

    def visible_hands(self) -> int:
        """How many hands the page shows at the moment."""
        return sum(hand.slim.visible or hand.whole.visible for hand in self._hands)

    def _set_up_page(self, prediction: Prediction) -> None:
        server, (points, _) = self.server, points_on_table(prediction, LARGEST_CLOUD)
        if not len(points):
            points = np.array([[0.0, 0.0, TABLE_HEIGHT], [0.3, 0.3, 0.2]])
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        view = framing_view(points, VIEW_AZIMUTH, VIEW_ELEVATION, (3, 4))
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(cast_shadow=False)
        server.scene.add_grid(
            "/table",
            width=1.0,
            height=1.0,
            cell_size=0.05,
            section_size=0.25,
            cell_color=(226, 228, 232),
            section_color=(206, 209, 214),
            position=(float(middle[0]), float(middle[1]), TABLE_HEIGHT),
        )
        server.initial_camera.position = tuple(view.T_world_camera[:3, 3])
        server.initial_camera.fov = 2.0 * float(np.arctan(0.5 / view.focal_length))
        server.initial_camera.look_at = tuple(middle)
        server.initial_camera.up = (0.0, 0.0, 1.0)
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        server.gui.add_markdown(f"**{summary(prediction)}**  \nresults are in the frame `{prediction.frame_id}`")

    def _add_controls(self, prediction: Prediction) -> None:
        gui, scores = self.server.gui, prediction.grasps.scores
        # At the start the threshold hides nothing, so that an unsure prediction does not look like an empty one.
        lowest = float(np.floor(20 * min(scores, default=0.0)) / 20)
        self._threshold = gui.add_slider("Lowest score", 0.0, 1.0, 0.01, min(max(lowest, 0.0), 1.0))
        self._count = gui.add_slider("Grasps per object", 0, HANDS_PER_OBJECT, 1, SHOWN_AT_FIRST)
        self._whole = gui.add_checkbox("Whole hand", False)
        self._clouds = gui.add_checkbox("Points", True)
        self._shapes = gui.add_checkbox("Shapes", True)
        self._labels = gui.add_checkbox("Names", True)
        for control in (self._threshold, self._count, self._whole, self._clouds, self._shapes, self._labels):
            control.on_update(lambda _: self._update())

    def _add_object(self, item: DetectedObject) -> _Parts:
        scene, key = self.server.scene, item.instance_id
        colour = to_bytes(instance_colour(key))
        switch = self.server.gui.add_checkbox(object_name(item), True)
        switch.on_update(lambda _: self._update())
        mesh = item.mesh()
        return _Parts(
            switch,
            self._add_points(
                f"/points/{key}", transform_points(self._T_table_frame, item.points), instance_colour(key)
            ),
            scene.add_mesh_simple(
                f"/shapes/{key}",
                transform_points(self._T_table_frame, np.asarray(mesh.vertices)),
                np.asarray(mesh.faces),
                color=colour,
                opacity=0.65,
                side="double",
            ),
            scene.add_label(
                f"/names/{key}",
                object_name(item),
                position=tuple(object_top(item, self._T_table_frame)),
                anchor="bottom-center",
            ),
        )

    def _add_stray_points(self, prediction: Prediction) -> None:
        points, instances = points_on_table(prediction, LARGEST_CLOUD)
        self._stray = self._add_points("/points/none", points[instances == NO_INSTANCE], instance_colour(NO_INSTANCE))

    def _add_points(
        self, name: str, points: Float[np.ndarray, "n 3"], colour: tuple[float, float, float]
    ) -> viser.PointCloudHandle:
        return self.server.scene.add_point_cloud(
            name,
            points.astype(np.float32),
            to_bytes(colour),
            point_size=POINT_SIZE,
            point_shape="circle",
            precision="float32",
        )

    def _add_hands(self, grasps: Grasps, gripper: Gripper) -> list[_Hand]:
        best = best_per_object(grasps, HANDS_PER_OBJECT)
        colours = score_colours(best.scores)
        hands, count = [], {}
        for g in range(len(best)):
            instance = int(best.instances[g])
            rank = count[instance] = count.get(instance, -1) + 1
            slim, whole = (
                self.server.scene.add_mesh_simple(
                    f"/hands/{g}/{name}",
                    mesh.vertices,
                    mesh.faces,
                    color=to_bytes(tuple(colours[g])),
                    flat_shading=True,
                    wxyz=matrix_to_quaternion(best.poses[g, :3, :3]),
                    position=best.poses[g, :3, 3],
                    visible=False,
                )
                for name, mesh in (
                    ("slim", slim_hand_mesh(gripper, float(best.openings[g]))),
                    ("whole", hand_mesh(gripper, float(best.openings[g]))),
                )
            )
            hands.append(_Hand(float(best.scores[g]), instance, rank, slim, whole))
        return hands

    def _update(self) -> None:
        """Shows what the controls ask for."""
        shown = {key for key, parts in self._parts.items() if parts.switch.value}
        with self.server.atomic():
            for key, parts in self._parts.items():
                parts.cloud.visible = key in shown and self._clouds.value
                parts.shape.visible = key in shown and self._shapes.value
                parts.label.visible = key in shown and self._labels.value
            self._stray.visible = self._clouds.value
            for hand in self._hands:
                is_listed = hand.score >= self._threshold.value and hand.rank < self._count.value
                wanted = is_listed and hand.instance in shown
                hand.slim.visible = wanted and not self._whole.value
                hand.whole.visible = wanted and self._whole.value
