"""`icgnet serve` as a process of its own."""

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def serving(*arguments: object) -> Iterator[tuple[str, subprocess.Popen]]:
    """The address and the process of a service on a free port, with one thread and no token; it is killed in the end.

    Args:
        arguments: further ones of the command.
    """
    command = [sys.executable, "-m", "icgnet.cli.main", "serve", "--port", "0", "--threads", "1", *map(str, arguments)]
    environment = {name: value for name, value in os.environ.items() if name != "ICGNET_TOKEN"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    try:
        assert process.stdout is not None
        said = re.search(r"http://127\.0\.0\.1:\d+", process.stdout.readline())
        assert said is not None
        yield said[0], process
    finally:
        process.kill()
        process.communicate()
