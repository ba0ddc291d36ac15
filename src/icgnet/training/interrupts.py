"""Ctrl-C ends a run at the next step, with a checkpoint."""

import signal
from contextlib import suppress
from types import FrameType

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """While its block runs, SIGINT and SIGTERM are noted instead of ending the process; a second one ends it at once.

    Outside of the main thread, where Python lets nobody handle signals, nothing is noted.
    """

    def __init__(self) -> None:
        self.noted = False

    def __enter__(self) -> "Interrupts":
        self._before = {}
        with suppress(ValueError):  # not in the main thread
            self._before = {number: signal.signal(number, self._note) for number in SIGNALS}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        if self.noted:
            raise KeyboardInterrupt
        self.noted = True


def ignore_interrupts(worker: int) -> None:
    """For the workers of a data loader: signals to a whole group reach them, too, but who started them ends them."""
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)
