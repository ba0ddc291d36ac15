"""A prediction in the browser: which objects, which grasps, and why there are none."""

import threading
from pathlib import Path

import numpy as np
import viser

from icgnet.geometry.transforms import invert_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.prediction import Prediction
from icgnet.viewer.describe import points_on_table
from icgnet.viewer.page.grasps import GraspPanel, RejectedPanel
from icgnet.viewer.page.objects import ObjectPanel
from icgnet.viewer.page.surroundings import SurroundingsPanel
from icgnet.viewer.page.words import header
from icgnet.viewer.view import framing_view

FRAMED_POINTS = 100_000
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


class WebViewer:
    """A page with the clouds, shapes and hands of a prediction, all in its table frame (z up).

    Each panel adds its controls and its part of the scene, and shows what they ask for in `update`. To add one, make it
    here where it shall stand on the page, and let `update` call it.

    Attributes:
        server: of the page.
        T_table_frame: from the frame of the prediction to the scene's.
        objects: the choice of an object, and their shapes.
        grasps: the grasps that were found.
        rejected: those that were dropped.
        surroundings: all that is neither an object nor a grasp.
    """

    def __init__(self, prediction: Prediction, server: viser.ViserServer) -> None:
        self.server = server
        self.T_table_frame = invert_transform(prediction.T_frame_table)
        self._lock = threading.RLock()
        self._set_up_page(prediction)
        given = (server, prediction, self.T_table_frame)
        self.objects = ObjectPanel(*given, self.update)
        self.grasps = GraspPanel(*given, self.objects, self.update)
        self.rejected = RejectedPanel(*given, self.objects, self.update)
        self.surroundings = SurroundingsPanel(*given, self.update)
        self.objects.add_switches()
        self.update()

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

    def update(self) -> None:
        """Shows what the controls ask for."""
        with self._lock, self.server.atomic():
            shown = self.objects.shown()
            self.objects.update(*self.surroundings.of_objects)
            self.grasps.update(shown)
            self.rejected.update(shown, self.grasps.per_object, self.grasps.whole)
            self.surroundings.update()

    def _set_up_page(self, prediction: Prediction) -> None:
        server, (points, _) = self.server, points_on_table(prediction, FRAMED_POINTS)
        if not len(points):
            points = np.array([[0.0, 0.0, TABLE_HEIGHT], [0.3, 0.3, 0.2]])
        view = framing_view(points, VIEW_AZIMUTH, VIEW_ELEVATION, (1, 1))
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(cast_shadow=False)
        server.initial_camera.position = tuple(view.T_world_camera[:3, 3])
        server.initial_camera.fov = 2.0 * float(np.arctan(0.5 / view.focal_length))
        server.initial_camera.look_at = tuple((points.min(axis=0) + points.max(axis=0)) / 2)
        server.initial_camera.up = (0.0, 0.0, 1.0)
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        server.gui.main_panel.dock_right()
        server.gui.add_html(header(prediction))
