"""How many threads of the processor the network takes."""

import torch

from icgnet.errors import InputError


def set_threads(threads: int | None) -> None:
    """Lets the whole process compute with so many CPU threads; with as many as torch takes if None.

    Raises:
        InputError: a number below 1.
    """
    if threads is not None:
        if threads < 1:
            raise InputError(f"threads must be at least 1, got {threads}")
        torch.set_num_threads(threads)
