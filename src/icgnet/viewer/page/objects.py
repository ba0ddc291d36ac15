"""Objects on the page: which one to look at, what is known of it, and the points, shapes and names of all."""

from dataclasses import dataclass

import numpy as np
import viser
from jaxtyping import Float

from icgnet.geometry.transforms import transform_points
from icgnet.grasping.grasps import Grasps
from icgnet.inference.prediction import DetectedObject
from icgnet.viewer.describe import object_top
from icgnet.viewer.page.stage import Stage
from icgnet.viewer.page.words import grasp_details, object_details, object_label, object_line, object_list
from icgnet.viewer.palette import instance_colour, to_bytes

ALL = "all objects"
POINT_SIZE = 0.002
OPACITY, FAINT = 0.65, 0.12
"""Of shapes, and of those that are not looked at."""
EVERY, NONE = "all", "none"


@dataclass(frozen=True)
class _Parts:
    """What belongs to one object on the page."""

    line: str
    switch: viser.GuiCheckboxHandle
    cloud: viser.PointCloudHandle
    shape: viser.MeshHandle
    label: viser.LabelHandle


class ObjectPanel:
    """The choice of an object and the text about it at the top; a folder of switches, closed, at the end."""

    def __init__(self, stage: Stage) -> None:
        self._stage, self._prediction = stage, stage.prediction
        gui, prediction = stage.server.gui, stage.prediction
        lines = [object_line(prediction, item) for item in prediction.objects]
        self._list = object_list(prediction)
        self._choice = gui.add_dropdown("Object", [ALL, *lines], hint="or click an object in the scene")
        self._text = gui.add_html(self._list)
        stage.watch(self._choice)
        self._picked: tuple[Grasps, int, str | None] | None = None
        self._parts: dict[int, _Parts] = {}

    def add_switches(self) -> None:
        """Adds the objects to the scene, and the folder that hides them one by one."""
        gui = self._stage.server.gui
        with gui.add_folder("Hide objects", expand_by_default=False):
            group = gui.add_button_group("Show", [EVERY, NONE])
            for item in self._prediction.objects:
                self._parts[item.instance_id] = self._add(item)
        group.on_click(lambda _: self._switch_all(group.value == EVERY))

    @property
    def chosen(self) -> int | None:
        """The object that is looked at; None is all of them."""
        return next((key for key, parts in self._parts.items() if parts.line == self._choice.value), None)

    def shown(self) -> frozenset[int]:
        """The objects whose grasps may be shown."""
        return frozenset(key for key, parts in self._parts.items() if parts.switch.value and self.chosen in (None, key))

    def choose(self, instance_id: int | None) -> None:
        """Looks at one object, or at all of them."""
        self._choice.value = ALL if instance_id is None else self._parts[instance_id].line
        self._stage.changed()

    def pick(self, grasps: Grasps, g: int, reason: str | None) -> None:
        """Looks at one grasp and at its object.

        Args:
            grasps: in the frame of the prediction.
            g: index of the grasp.
            reason: why it was dropped; None if it was not.
        """
        self._picked = grasps, g, reason
        self.choose(int(grasps.instances[g]))

    def update(self, points: bool, shapes: bool, names: bool) -> None:
        """Shows what was chosen: of what is switched on the measured points, the shapes and the names."""
        chosen = self.chosen
        for key, parts in self._parts.items():
            is_on, is_chosen = parts.switch.value, chosen in (None, key)
            parts.cloud.visible = is_on and points
            parts.shape.visible = is_on and shapes
            parts.shape.opacity = OPACITY if is_chosen else FAINT
            parts.label.visible = is_on and names and is_chosen
        text = self._list if chosen is None else self._told_of(self._prediction.objects[chosen])
        if text != self._text.content:
            self._text.content = text

    def _told_of(self, item: DetectedObject) -> str:
        told, picked = object_details(self._prediction, item), self._picked
        if picked is None or picked[0].instances[picked[1]] != item.instance_id:
            own = np.flatnonzero(self._prediction.grasps.instances == item.instance_id)
            if not len(own):
                return told
            picked = self._prediction.grasps, int(own[0]), None
        return told + grasp_details(*picked[:2], self._prediction.frame_id, picked[2])

    def _switch_all(self, on: bool) -> None:
        for parts in self._parts.values():
            parts.switch.value = on
        self._stage.changed()

    def _add(self, item: DetectedObject) -> _Parts:
        scene, key, colour = self._stage.server.scene, item.instance_id, to_bytes(instance_colour(item.instance_id))
        line, mesh = object_line(self._prediction, item), item.mesh()
        switch = self._stage.server.gui.add_checkbox(f"{key} {item.class_name}", True)
        self._stage.watch(switch)
        shape = scene.add_mesh_simple(
            f"/shapes/{key}",
            transform_points(self._stage.T_table_frame, np.asarray(mesh.vertices)),
            np.asarray(mesh.faces),
            color=colour,
            opacity=OPACITY,
            side="double",
        )
        shape.on_click(lambda _: self.choose(key))
        return _Parts(
            line,
            switch,
            add_points(
                self._stage.server,
                f"/points/{key}",
                transform_points(self._stage.T_table_frame, item.points),
                instance_colour(key),
            ),
            shape,
            scene.add_label(
                f"/names/{key}",
                object_label(self._prediction, item),
                position=tuple(object_top(item, self._stage.T_table_frame)),
                anchor="bottom-center",
            ),
        )


def add_points(
    server: viser.ViserServer, name: str, points: Float[np.ndarray, "n 3"], colour: tuple[float, float, float]
) -> viser.PointCloudHandle:
    """A cloud in one colour, in the frame of the scene [m]."""
    return server.scene.add_point_cloud(
        name,
        points.astype(np.float32),
        to_bytes(colour),
        point_size=POINT_SIZE,
        point_shape="circle",
        precision="float32",
    )
