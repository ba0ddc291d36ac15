"""`icgnet view`: the web viewer."""

from dataclasses import dataclass
from pathlib import Path

import tyro

from icgnet.errors import InputError


@dataclass(frozen=True)
class View:
    """Look at a saved prediction in the browser."""

    directory: tyro.conf.Positional[Path]
    """Folder that `icgnet predict` or `icgnet demo` wrote."""
    port: int = 8080
    """Port of the web page; the next free one if it is taken."""
    host: str = "127.0.0.1"
    """Address to listen on; 0.0.0.0 lets other machines look."""

    def run(self) -> None:
        """Serves the page until the user stops it."""
        if not self.directory.is_dir():
            raise InputError(f"no such folder: {self.directory}")
        from icgnet.viewer.web import open_viewer

        viewer = open_viewer(self.directory, self.port, self.host)
        print(f"open {viewer.url} in a browser; stop with Ctrl-C", flush=True)
        viewer.wait()
