"""The captures that an agent may look at: the depth images in one folder, and nothing outside of it."""

import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from icgnet.errors import DataError, IcgnetError, InputError
from icgnet.geometry.arrays import described
from icgnet.inference.capture import IMAGE_SUFFIXES, DepthCapture, read_capture

SUFFIXES = (*IMAGE_SUFFIXES, ".npz", ".npy")
MOST_NAMES = 50
"""So many names are told at once, those of the newest files."""


@dataclass(frozen=True, eq=False)
class Capture:
    """One file of the folder.

    Attributes:
        name: of the file, relative to the folder, as an agent says it.
        content: the depth image, and the pose of the camera if it is known.
        stamp: changes when the file does.
        age: since the file was written [s].
    """

    name: str
    content: DepthCapture
    stamp: tuple[int, int]
    age: float


class CaptureFolder:
    """Depth images in a folder and the folders in it.

    Args:
        folder: that a camera's program writes to.
        intrinsics: for images without a camera matrix, see `read_capture`.
        depth_scale: stored depth units per metre.
        camera_pose: for images without one, see `read_capture`.

    Raises:
        InputError: no such folder.
    """

    def __init__(
        self,
        folder: Path,
        intrinsics: tuple[str, ...] = (),
        depth_scale: float = 1.0,
        camera_pose: tuple[str, ...] = (),
    ) -> None:
        if not folder.is_dir():
            raise InputError(f"no such folder of captures: {folder}")
        self._folder = folder.resolve()
        self._intrinsics, self._depth_scale, self._camera_pose = intrinsics, depth_scale, camera_pose

    def names(self) -> list[str]:
        """Names of the captures, the newest first."""
        found: list[tuple[float, str]] = []
        for path in self._folder.rglob("*"):
            with suppress(OSError):  # the camera's program may take it away at any time
                if path.suffix.lower() in SUFFIXES and self._is_inside(path):
                    found.append((path.stat().st_mtime, path.relative_to(self._folder).as_posix()))
        return [name for _, name in sorted(found, key=lambda each: (-each[0], each[1]))][:MOST_NAMES]

    def read(self, name: str | None = None) -> Capture:
        """A capture, the newest one if no name is given.

        Raises:
            InputError: there is none of this name, it is outside of the folder, or it is no depth image.
            DataError: the file cannot be read.
        """
        path = self._path(name)
        told = path.relative_to(self._folder).as_posix()
        try:
            status = path.stat()
            content = read_capture(path, self._intrinsics, self._depth_scale, self._camera_pose)
        except IcgnetError as error:  # an agent is not told where on this machine the folder is
            kind = DataError if isinstance(error, DataError) else InputError
            raise kind(str(error).replace(f"{self._folder}/", "")) from error
        except OSError as error:
            raise DataError(f"capture {told} is gone or cannot be read: {error.strerror}") from error
        if not isinstance(content, DepthCapture):
            raise InputError(f"capture {told} is a cloud; depth images are looked at")
        return Capture(told, content, (status.st_mtime_ns, status.st_size), max(0.0, time.time() - status.st_mtime))

    def _path(self, name: str | None) -> Path:
        names = self.names()
        known = ", ".join(names) or "none"
        if name is None:
            if not names:
                raise InputError(f"the folder of captures holds none; kinds that are read: {', '.join(SUFFIXES)}")
            return self._folder / names[0]
        try:
            path = self._folder / name
            is_plain = not Path(name).is_absolute() and ".." not in Path(name).parts
            is_one = is_plain and path.suffix.lower() in SUFFIXES and self._is_inside(path)
        except (OSError, ValueError):  # names that no file system knows
            is_one = False
        if not is_one:
            raise InputError(f"no capture {described(name)}; the captures are {known}")
        return self._folder / name

    def _is_inside(self, path: Path) -> bool:
        """Whether a file is there and in the folder, also after all links have been followed."""
        return path.is_file() and path.resolve().is_relative_to(self._folder)
