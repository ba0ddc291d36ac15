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
from icgnet.viewer.page.stage import Stage
from icgnet.viewer.page.surroundings import SurroundingsPanel
from icgnet.viewer.page.words import header
from icgnet.viewer.served import ServedPage, serve

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
    return WebViewer(prediction, serve(port, host))


class WebViewer(ServedPage):
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
        super().__init__(server)
        self.T_table_frame = invert_transform(prediction.T_frame_table)
        self._lock = threading.RLock()
        self._set_up_page(prediction)
        stage = Stage(server, prediction, self.T_table_frame, self.update)
        self.objects = ObjectPanel(stage)
        self.grasps = GraspPanel(stage, self.objects)
        self.rejected = RejectedPanel(stage, self.objects)
        self.surroundings = SurroundingsPanel(stage)
        self.objects.add_switches()
        self.update()

    def update(self) -> None:
        """Shows what the controls ask for."""
        with self._lock, self.server.atomic():
            shown = self.objects.shown()
            self.objects.update(*self.surroundings.of_objects)
            self.grasps.update(shown)
            self.rejected.update(shown, self.grasps.per_object, self.grasps.whole)
            self.surroundings.update()

    def _set_up_page(self, prediction: Prediction) -> None:
        points, _ = points_on_table(prediction, FRAMED_POINTS)
        if not len(points):
            points = np.array([[0.0, 0.0, TABLE_HEIGHT], [0.3, 0.3, 0.2]])
        self.look_at(points, VIEW_AZIMUTH, VIEW_ELEVATION, (1, 1))
        self.server.gui.main_panel.dock_right()
        self.server.gui.add_html(header(prediction))
