"""`icgnet view`: the web viewer."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from icgnet.errors import DataError, InputError

if TYPE_CHECKING:
    from icgnet.viewer.pick_web import PickViewer
    from icgnet.viewer.web import WebViewer


@dataclass(frozen=True)
class View:
    """Look at a saved prediction or at a planned pick in the browser."""

    directory: tyro.conf.Positional[Path]
    """Folder that `icgnet predict`, `icgnet demo` or `icgnet pick` wrote."""
    port: int = 8080
    """Port of the web page; the next free one if it is taken."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets other machines look."""

    def run(self) -> None:
        """Serves the page until the user stops it."""
        if not self.directory.is_dir():
            raise InputError(f"no such folder: {self.directory}")
        viewer = open_folder(self.directory, self.port, self.host)
        print(f"open {viewer.url} in a browser; stop with Ctrl-C", flush=True)
        viewer.wait()


def open_folder(directory: Path, port: int = 8080, host: str = "127.0.0.1") -> "WebViewer | PickViewer":
    """The viewer of what a folder holds.

    Raises:
        DataError: neither a prediction nor a plan.
    """
    from icgnet.arm.motion import MOTION_FILE

    if (directory / "plan.json").is_file():
        from icgnet.viewer.pick_web import open_pick_viewer

        if not (directory / MOTION_FILE).is_file():
            raise DataError(f"{directory} holds a plan without {MOTION_FILE}: nothing was found, or plan again")
        return open_pick_viewer(directory / MOTION_FILE, port, host)
    from icgnet.viewer.web import open_viewer

    return open_viewer(directory, port, host)
