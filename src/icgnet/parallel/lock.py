"""One run at a time writes into a folder."""

import json
import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from filelock import FileLock, Timeout

from icgnet.errors import DataError

# Hidden names: readers of whole folders, such as pandas, pass over them.
LOCK = ".lock"
OWNER = ".lock-owner.json"


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Holds the lock of an existing folder.

    The operating system frees the lock of a process that ends, however it ends, so that nothing stays locked
    behind a run that was killed.

    Raises:
        DataError: another process holds it; the message names its id and its machine.
    """
    lock = FileLock(directory / LOCK, timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise DataError(f"{directory}: {_owner(directory)} is writing into this folder; give another one") from error
    owner = {"pid": os.getpid(), "host": platform.node(), "since": datetime.now(UTC).isoformat(timespec="seconds")}
    path = directory / OWNER
    try:
        path.write_text(json.dumps(owner))
        yield
    finally:
        path.unlink(missing_ok=True)
        lock.release()


def _owner(directory: Path) -> str:
    """Who holds the lock, as far as they have said."""
    try:
        owner = json.loads((directory / OWNER).read_text())
        return f"process {owner['pid']} on {owner['host']} (since {owner['since']})"
    except (OSError, ValueError, KeyError, TypeError):
        return "another process"
