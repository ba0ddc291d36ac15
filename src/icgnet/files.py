"""Files that appear whole or not at all, whenever the process is killed."""

import json
import math
import os
import secrets
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from icgnet.errors import DataError

PARTIAL = ".partial"


@contextmanager
def new_file(path: Path) -> Iterator[BinaryIO]:
    """A file to write into, which takes the place of `path` when the block ends without an error.

    By then it is on the disk and not only in the system's memory, so that a power cut cannot leave an empty file
    under a final name. Until then it has a name of its own, so that two that write the same file do not meet: the
    one that ends last stays.

    Raises:
        DataError: the system cannot write (disk full, no permission); nothing is left behind.
    """
    partial = path.with_name(f"{path.name}.{secrets.token_hex(4)}{PARTIAL}")
    try:
        with partial.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        os.replace(partial, path)
        _sync_folder(path.parent)
    except OSError as error:
        raise cannot_write(path, error) from error
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def cannot_write(path: Path, error: OSError) -> DataError:
    """The error that says which file or folder the system could not write, and why."""
    return DataError(f"{path}: cannot write: {error.strerror or error}")


def write_text(path: Path, text: str) -> None:
    """Writes a text file, whole or not at all; into a device or a pipe, which nothing can take the place of, directly.

    Raises:
        DataError: the system cannot write.
    """
    if path.exists() and not path.is_file() and not path.is_dir():
        try:
            path.write_text(text)
        except OSError as error:
            raise cannot_write(path, error) from error
        return
    with new_file(path) as file:
        file.write(text.encode())


def write_json(path: Path, values: Mapping[str, object]) -> None:
    """Writes a JSON file, whole or not at all. Numbers that are not finite become null, as JSON has none of them.

    Raises:
        DataError: the system cannot write.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    with new_file(path) as file:
        file.write((json.dumps(finite(values), indent=2, allow_nan=False) + "\n").encode())


def finite(value: object) -> object:
    """The same with None in place of numbers that are not finite."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: finite(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [finite(each) for each in value]
    return value


def cut_unfinished_line(path: Path) -> None:
    """Takes away what a killed run had begun to append to a file of lines, if there is such a file."""
    if path.is_file():
        with path.open("r+b") as file:
            content = file.read()
            file.truncate(content.rfind(b"\n") + 1)


def keep_lines(path: Path, is_wanted: Callable[[str], bool]) -> None:
    """Leaves only the wanted lines in a file, if there is such a file; a line that a kill cut off is never wanted.

    Raises:
        DataError: the system cannot write, or a line is not what `is_wanted` expects.
    """
    if not path.is_file():
        return
    whole = path.read_text().rpartition("\n")[0].splitlines(keepends=False)
    try:
        kept = [line + "\n" for line in whole if is_wanted(line)]
    except (ValueError, KeyError, TypeError) as error:
        raise DataError(f"{path}: damaged: {error}") from error
    with new_file(path) as file:
        file.write("".join(kept).encode())


def remove_partial_files(directory: Path) -> None:
    """Deletes what a killed run had begun to write."""
    for path in directory.glob(f"*{PARTIAL}"):
        path.unlink(missing_ok=True)


def _sync_folder(directory: Path) -> None:
    """Puts a renaming on the disk, too; Windows has no way to ask for that, and cannot open folders."""
    if os.name == "nt":
        return
    handle = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
