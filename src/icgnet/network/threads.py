"""How many threads of the processor the network takes."""

import torch

from icgnet.errors import InputError

MOST_THREADS = 256
"""More threads than this no processor has any use for."""


def set_threads(threads: int | None) -> None:
    """Lets the whole process compute with so many CPU threads; with as many as torch takes if None.

    Raises:
        InputError: no whole number from 1 to `MOST_THREADS`.
    """
    if threads is not None:
        if isinstance(threads, bool) or not isinstance(threads, int) or not 1 <= threads <= MOST_THREADS:
            raise InputError(f"threads must be at least 1 and at most {MOST_THREADS}, got {threads!r}")
        torch.set_num_threads(threads)


def thread_count() -> int:
    """How many CPU threads the process computes with."""
    return torch.get_num_threads()
