"""What every page in the browser has: an address, an end, and a view to begin with."""

import numpy as np
import viser
from jaxtyping import Float

from icgnet.viewer.view import framing_view


def serve(port: int, host: str) -> viser.ViserServer:
    """An empty page, see `ServedPage`.

    Args:
        port: of the web page; the next free one if it is taken.
        host: address to listen on; "0.0.0.0" lets other machines look.
    """
    return viser.ViserServer(host=host, port=port, label="icgnet", verbose=False)


class ServedPage:
    """A page that is served until `stop` is called.

    Attributes:
        server: of the page.
    """

    def __init__(self, server: viser.ViserServer) -> None:
        self.server = server

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

    def look_at(
        self, points: Float[np.ndarray, "n 3"], azimuth: float, elevation: float, shape: tuple[int, int]
    ) -> Float[np.ndarray, "3"]:
        """Lets the page begin with a view of points in a scene with z up, and sets lights and theme.

        Args:
            points: at least one, in the scene [m].
            azimuth: direction of the view [rad].
            elevation: of the view above the horizon [rad].
            shape: height and width of what shall be in view, as a ratio.

        Returns:
            The middle of the points.
        """
        server, view = self.server, framing_view(points, azimuth, elevation, shape)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        server.scene.set_up_direction("+z")
        server.scene.configure_default_lights(cast_shadow=False)
        server.initial_camera.position = tuple(view.T_world_camera[:3, 3])
        server.initial_camera.fov = 2.0 * float(np.arctan(0.5 / view.focal_length))
        server.initial_camera.look_at = tuple(middle)
        server.initial_camera.up = (0.0, 0.0, 1.0)
        server.gui.configure_theme(show_logo=False, show_share_button=False, control_width="medium")
        return middle
