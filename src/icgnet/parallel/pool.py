"""Numbered pieces of work in this process, or in processes of this machine that may die and do not outlive this one."""

import os
import signal
import threading
import traceback
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Generic, Protocol, TypeVar, runtime_checkable

from icgnet.errors import DataError, InputError

Product = TypeVar("Product")
Made = TypeVar("Made", covariant=True)

TRIES = 3
"""So many workers may die over one number."""

KILLED = -9
"""Exit code of a process that the system ended by force (POSIX)."""

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What the numerical libraries read when they are loaded. Workers fill the cores; threads would wait for each other."""


@runtime_checkable
class Job(Protocol[Made]):
    """Work in numbered pieces, such as the scenes of a data set; it is sent to every worker."""

    def make(self, number: int) -> Made:
        """The piece of this number, the same one in any process."""
        ...

    def name(self, number: int) -> str:
        """How messages call a piece."""
        ...


@runtime_checkable
class Pool(Protocol[Made]):
    """Something that makes the pieces of a job."""

    @property
    def workers(self) -> int:
        """How many pieces are made at a time."""
        ...

    def make(self, numbers: Sequence[int]) -> Iterator[Made]:
        """The pieces, each as soon as it is finished, in any order.

        Raises:
            DataError: one piece kills every worker that it is given to.
            IcgnetError: what `Job.make` raises.
        """
        ...

    def close(self) -> None:
        """Ends the workers, whatever they are doing."""
        ...


class SerialPool(Generic[Product]):
    """Makes one piece after the other in the calling process."""

    workers = 1

    def __init__(self, job: Job[Product]) -> None:
        self._job = job

    def make(self, numbers: Sequence[int]) -> Iterator[Product]:
        """The pieces in the order of their numbers."""
        return map(self._job.make, numbers)

    def close(self) -> None:
        """There are no workers to end."""


class LocalPool(Generic[Product]):
    """Makes pieces in processes of this machine.

    A worker that dies (out of memory, a fault in native code) is replaced, and its piece is made again. Workers end
    with this process, however it ends.
    """

    def __init__(self, job: Job[Product], workers: int) -> None:
        self.workers = workers
        self._job = job
        self._busy: dict[Connection, _Worker[Product]] = {}
        self._idle: list[_Worker[Product]] = []

    def make(self, numbers: Sequence[int]) -> Iterator[Product]:
        """The pieces, each as soon as it is finished."""
        todo, deaths = deque(numbers), Counter[int]()
        while todo or self._busy:
            while todo and len(self._busy) < self.workers:
                self._give(todo.popleft())
            for connection in wait(list(self._busy)):
                worker = self._busy.pop(connection)  # pyright: ignore[reportArgumentType]
                answer = worker.answer()
                if answer is None:
                    deaths[worker.number] += 1
                    if deaths[worker.number] == TRIES:
                        raise DataError(f"{self._job.name(worker.number)}: {_death_notice(worker)}")
                    todo.appendleft(worker.number)
                    continue
                self._idle.append(worker)
                if isinstance(answer, Exception):
                    raise answer
                # The worker goes on while the caller looks at its piece.
                if todo:
                    self._give(todo.popleft())
                yield answer

    def close(self) -> None:
        """Ends the workers; those that are at work are killed."""
        for worker in self._busy.values():
            worker.process.kill()
        for worker in (*self._busy.values(), *self._idle):
            worker.connection.close()
            worker.process.join()
        self._busy.clear()
        self._idle.clear()

    def _give(self, number: int) -> None:
        worker = self._idle.pop() if self._idle else _Worker(self._job)
        self._busy[worker.connection] = worker
        worker.give(number)


class _Worker(Generic[Product]):
    """A process that makes pieces, as the one that started it sees it."""

    def __init__(self, job: Job[Product]) -> None:
        context = get_context("spawn")
        self.connection, other_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(other_end, job), daemon=True)
        with _one_thread():
            self.process.start()
        # Were this end still open here, the death of the worker would not close the pipe.
        other_end.close()
        self.number = -1

    def give(self, number: int) -> None:
        """Hands over a number; that the worker has died meanwhile shows in its answer."""
        self.number = number
        with suppress(OSError):
            self.connection.send(number)

    def answer(self) -> Product | Exception | None:
        """What came of it; None if the worker has died."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            self.connection.close()
            self.process.join()
            return None


def _serve(connection: Connection, job: Job[Product]) -> None:
    """What a worker does: makes the pieces whose numbers come through the pipe, until it is closed."""
    # Ctrl-C reaches every process of the terminal; the one that started the workers decides what becomes of them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            connection.send(_answer(job, connection.recv()))


def _answer(job: Job[Product], number: int) -> Product | Exception:
    try:
        return job.make(number)
    except Exception as error:
        # Tracebacks do not travel between processes, notes do.
        error.add_note("".join(traceback.format_exception(error)))
        return error


def _end_with_parent() -> None:
    """Ends this process, whatever it is doing, as soon as the one that started it is gone."""
    parent = parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)


def local_pool(job: Job[Product], workers: int) -> Pool[Product]:
    """The pool for so many processes on this machine; with one, pieces are made in the calling process.

    Raises:
        InputError: fewer than one.
    """
    if workers < 1:
        raise InputError(f"workers must be at least 1, got {workers}")
    return SerialPool(job) if workers == 1 else LocalPool(job, workers)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Processes started in this block compute with one thread each, unless the user has said otherwise."""
    added = {name: "1" for name in THREAD_VARIABLES if name not in os.environ}
    os.environ.update(added)
    try:
        yield
    finally:
        for name in added:
            del os.environ[name]


def _death_notice(worker: _Worker[Product]) -> str:
    code = worker.process.exitcode or 0
    cause = f"signal {-code}" if code < 0 else f"exit code {code}"
    hint = "; is there too little memory for so many workers?" if code == KILLED else ""
    return f"{TRIES} workers died over it, the last one by {cause}{hint}"
