"""Output folders that appear whole or not at all."""

import errno
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from icgnet.errors import DataError, InputError
from icgnet.files import cannot_write

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

FRESH, REPLACED = "new", "old"
"""Folders in the scratch folder: the one that is being written, and the earlier one while they change places."""
SUFFIX = ".unfinished"
"""Scratch folders are called `.NAME.RANDOM` and this."""
NO_LOCKS = {errno.EBADF, errno.ENOLCK, errno.ENOTSUP, errno.EINVAL}
"""What file systems answer that cannot lock a folder."""


def check_replaceable(path: Path, marker: str, overwrite: bool = False) -> None:
    """Makes sure that an output folder may be written at `path`.

    Args:
        path: where the folder shall be.
        marker: file by which a folder that we have written before is recognised; such a folder is replaced.
        overwrite: whether any other folder may be replaced too.

    Raises:
        InputError: a file lies there, or a folder that is not one of ours.
    """
    if path.is_symlink() or (path.exists() and not path.is_dir()):
        raise InputError(f"cannot write the output folder {path}: it is a file or a link")
    is_foreign = path.is_dir() and any(path.iterdir()) and not (path / marker).is_file()
    if is_foreign and not overwrite:
        raise InputError(f"output folder {path} holds other files (no {marker}): name another, or give --overwrite")


@contextmanager
def output_folder(path: Path, marker: str, overwrite: bool = False) -> Iterator[Path]:
    """A new folder to write into, which takes its place at `path` only when the block ends without an error.

    Of several that write the same folder, the one that ends last stays. What a killed process has left behind is
    cleared away by the next one, and where it was killed between the two renamings, the earlier folder comes back.

    Args:
        path: where the folder shall be; missing parents are made.
        marker: see `check_replaceable`.
        overwrite: see `check_replaceable`.

    Raises:
        InputError: see `check_replaceable`, also when a foreign folder has appeared while the new one was written.
        DataError: the system cannot write (disk full, no permission); the earlier folder is there as before.
    """
    scratch: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with ExitStack() as alive:
            with _locked(path.parent):
                _clear_remains(path)
                check_replaceable(path, marker, overwrite)
                # Beside the target, because only within one file system is renaming atomic.
                scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.", suffix=SUFFIX, dir=path.parent))
                alive.enter_context(_locked(scratch))
            (scratch / FRESH).mkdir()
            yield scratch / FRESH
            with _locked(path.parent):
                check_replaceable(path, marker, overwrite)
                _change_places(path, scratch)
    except OSError as error:
        if _is_about_another_file(error, path):
            raise
        raise cannot_write(path, error) from error
    finally:
        if scratch is not None:
            _remove(scratch)


def _is_about_another_file(error: OSError, path: Path) -> bool:
    """Whether what the system refused inside of the block has nothing to do with the folder that is written."""
    return isinstance(error.filename, str | Path) and not Path(error.filename).absolute().is_relative_to(
        path.absolute().parent
    )


def _change_places(path: Path, scratch: Path) -> None:
    """Puts the fresh folder at `path`; what was there comes back if that cannot be done."""
    if path.exists():
        path.rename(scratch / REPLACED)
    try:
        (scratch / FRESH).rename(path)
    except OSError:
        _bring_back(path, scratch)
        raise


def _bring_back(path: Path, scratch: Path) -> None:
    """Puts the earlier folder of a scratch folder, if there is one, where it was."""
    if not (scratch / REPLACED).exists():
        return
    try:
        (scratch / REPLACED).rename(path)
    except OSError as error:
        raise DataError(
            f"{path}: cannot write; what was there is now {scratch / REPLACED}: {error.strerror}"
        ) from error


def _remove(scratch: Path) -> None:
    """Removes a scratch folder, unless it holds an earlier folder that nothing has taken the place of."""
    if not ((scratch / REPLACED).exists() and (scratch / FRESH).exists()):
        shutil.rmtree(scratch, ignore_errors=True)


def _clear_remains(path: Path) -> None:
    """Removes the scratch folders of killed processes; an earlier folder that is missing at its place comes back."""
    if fcntl is None:  # nobody can tell which of them are still written
        return
    ours = re.compile(rf"\.{re.escape(path.name)}\.[^.]+{re.escape(SUFFIX)}")
    for scratch in [each for each in path.parent.iterdir() if ours.fullmatch(each.name)]:
        # Alive, or just removed by the one that it belonged to.
        with suppress(OSError), _locked(scratch, wait=False):
            if not path.exists():
                _bring_back(path, scratch)
            _remove(scratch)


@contextmanager
def _locked(folder: Path, wait: bool = True) -> Iterator[None]:
    """Holds a folder against other processes; the system lets go of it when this one ends, however it ends.

    Raises:
        BlockingIOError: another process holds it, and this one shall not wait.
    """
    if fcntl is None:
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            # Network file systems lock no folders; then nobody is kept out, and nothing is cleared.
            if error.errno not in NO_LOCKS or not wait:
                raise
        yield
    finally:
        os.close(handle)
