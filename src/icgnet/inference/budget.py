"""How long a prediction may take, and how long its stages take."""

import time


class Budget:
    """Runs from when it is made.

    What is most worth is done first, and each stage asks whether it may go on. The last step that was begun is ended,
    so a prediction takes somewhat longer than its budget.

    Args:
        milliseconds: for the whole prediction; None for no limit.
    """

    def __init__(self, milliseconds: float | None = None) -> None:
        self._seconds = None if milliseconds is None else 1e-3 * milliseconds
        self._start = time.perf_counter()

    @property
    def is_limited(self) -> bool:
        """Whether there is a limit at all."""
        return self._seconds is not None

    def is_spent(self, share: float = 1.0) -> bool:
        """Whether this share of it is used up."""
        return self._seconds is not None and time.perf_counter() - self._start > share * self._seconds


class Clock:
    """Adds up how long each stage takes."""

    def __init__(self) -> None:
        self.laps_ms: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Books the time since the last lap on a stage."""
        now = time.perf_counter()
        self.laps_ms[stage] = self.laps_ms.get(stage, 0.0) + 1e3 * (now - self._last)
        self._last = now
