"""Output folders that appear whole or not at all."""

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from icgnet.errors import InputError


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

    Args:
        path: where the folder shall be; missing parents are made.
        marker: see `check_replaceable`.
        overwrite: see `check_replaceable`.

    Raises:
        InputError: see `check_replaceable`.
    """
    check_replaceable(path, marker, overwrite)
    path.parent.mkdir(parents=True, exist_ok=True)
    # Beside the target, because only within one file system is renaming atomic.
    scratch = Path(tempfile.mkdtemp(prefix=f".{path.name}.", dir=path.parent))
    try:
        fresh, replaced = scratch / "new", scratch / "old"
        fresh.mkdir()
        yield fresh
        if path.exists():
            path.rename(replaced)
        fresh.rename(path)
    finally:
        shutil.rmtree(scratch)
