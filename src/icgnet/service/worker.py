"""One job after the other, in one thread, and so many waiting ones at most."""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

Result = TypeVar("Result")


class FullError(Exception):
    """No more requests are taken at the moment.

    Attributes:
        retry_after: when it is worth to ask again [s].
    """

    def __init__(self, retry_after: int) -> None:
        super().__init__(f"too many requests are waiting: ask again in {retry_after} s")
        self.retry_after = retry_after


class StoppingError(Exception):
    """The service ends; what had not begun is not done any more."""

    def __init__(self) -> None:
        super().__init__("the service is stopping")


class GoneError(Exception):
    """The caller has closed the connection, so nobody wants the result."""


class Worker:
    """Does jobs in one thread. All but the jobs themselves happens in the thread of the event loop.

    Args:
        waiting: requests that may wait beside the one that runs.
    """

    def __init__(self, waiting: int) -> None:
        self.places = waiting + 1
        self.taken = 0
        self.is_stopping = False
        self._seconds = 1.0
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="icgnet-worker")

    @contextmanager
    def place(self) -> Iterator[None]:
        """A place in the house, from before a request's body is read until its job is done.

        Raises:
            FullError: all are taken.
            StoppingError: nothing is taken any more.
        """
        if self.is_stopping:
            raise StoppingError
        if self.taken >= self.places:
            raise FullError(max(1, math.ceil(self._seconds)))
        self.taken += 1
        try:
            yield
        finally:
            self.taken -= 1

    async def run(self, job: Callable[[], Result], gone: Callable[[], Awaitable[None]]) -> Result:
        """The result of a job, after those that came before it.

        Args:
            job: what to do.
            gone: ends when the caller has gone; a job that waits is then not done at all.

        Raises:
            StoppingError: the service stopped before the job had begun.
            GoneError: the caller went before the job was done.
            Exception: whatever the job raises.
        """
        if self.is_stopping:
            raise StoppingError
        future = self._thread.submit(self._timed, job)
        result, leaving = asyncio.wrap_future(future), asyncio.ensure_future(gone())
        try:
            await asyncio.wait({result, leaving}, return_when=asyncio.FIRST_COMPLETED)
            if not result.done():
                if not future.cancel():  # it runs, and its place is taken until it has ended
                    await asyncio.wait({result})
                    if not result.cancelled():
                        result.exception()
                raise GoneError
            return result.result()
        except asyncio.CancelledError:
            if self.is_stopping:
                raise StoppingError from None
            raise
        finally:
            leaving.cancel()

    def stop(self) -> None:
        """Takes nothing more and drops what waits; the job that runs is done to its end."""
        self.is_stopping = True
        self._thread.shutdown(wait=False, cancel_futures=True)

    def _timed(self, job: Callable[[], Result]) -> Result:
        start = time.monotonic()
        try:
            return job()
        finally:
            self._seconds = time.monotonic() - start
