"""Makes scenes in this process, or in processes of this machine that may die and do not outlive this one."""

import os
import signal
import threading
import traceback
from collections import Counter, deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection, wait
from typing import Protocol, runtime_checkable

from icgnet.datagen.job import Job
from icgnet.datagen.recipe import Recipe
from icgnet.errors import DataError

TRIES = 3
"""So many workers may die over one scene."""

KILLED = -9
"""Exit code of a process that the system ended by force (POSIX)."""

THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""What the numerical libraries read when they are loaded. Workers fill the cores; threads would wait for each other."""


@runtime_checkable
class Pool(Protocol):
    """Something that makes the scenes of a job."""

    @property
    def workers(self) -> int:
        """How many scenes are made at a time."""
        ...

    def label(self, scene_ids: Sequence[int]) -> Iterator[Recipe]:
        """The labelled scenes, each as soon as it is finished, in any order.

        Raises:
            DataError: one scene kills every worker that it is given to.
            IcgnetError: what `Job.label` raises.
        """
        ...

    def close(self) -> None:
        """Ends the workers, whatever they are doing."""
        ...


class SerialPool:
    """Makes one scene after the other in the calling process."""

    workers = 1

    def __init__(self, job: Job) -> None:
        self._job = job

    def label(self, scene_ids: Sequence[int]) -> Iterator[Recipe]:
        """The labelled scenes in the order of their numbers."""
        return map(self._job.label, scene_ids)

    def close(self) -> None:
        """There are no workers to end."""


class LocalPool:
    """Makes scenes in processes of this machine.

    A worker that dies (out of memory, a fault in native code) is replaced, and its scene is made again. Workers end
    with this process, however it ends.
    """

    def __init__(self, job: Job, workers: int) -> None:
        self.workers = workers
        self._job = job
        self._busy: dict[Connection, _Worker] = {}
        self._idle: list[_Worker] = []

    def label(self, scene_ids: Sequence[int]) -> Iterator[Recipe]:
        """The labelled scenes, each as soon as it is finished."""
        todo, deaths = deque(scene_ids), Counter[int]()
        while todo or self._busy:
            while todo and len(self._busy) < self.workers:
                self._give(todo.popleft())
            for connection in wait(list(self._busy)):
                worker = self._busy.pop(connection)  # pyright: ignore[reportArgumentType]
                answer = worker.answer()
                if answer is None:
                    deaths[worker.scene_id] += 1
                    if deaths[worker.scene_id] == TRIES:
                        raise DataError(f"{self._job.name(worker.scene_id)}: {_death_notice(worker)}")
                    todo.appendleft(worker.scene_id)
                    continue
                self._idle.append(worker)
                if isinstance(answer, Exception):
                    raise answer
                # The worker goes on while the caller looks at its scene.
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

    def _give(self, scene_id: int) -> None:
        worker = self._idle.pop() if self._idle else _Worker(self._job)
        self._busy[worker.connection] = worker
        worker.give(scene_id)


class _Worker:
    """A process that makes scenes, as the one that started it sees it."""

    def __init__(self, job: Job) -> None:
        context = get_context("spawn")
        self.connection, other_end = context.Pipe()
        self.process = context.Process(target=_serve, args=(other_end, job), daemon=True)
        with _one_thread():
            self.process.start()
        # Were this end still open here, the death of the worker would not close the pipe.
        other_end.close()
        self.scene_id = -1

    def give(self, scene_id: int) -> None:
        """Hands over a scene; that the worker has died meanwhile shows in its answer."""
        self.scene_id = scene_id
        with suppress(OSError):
            self.connection.send(scene_id)

    def answer(self) -> Recipe | Exception | None:
        """What came of the scene; None if the worker has died."""
        try:
            return self.connection.recv()
        except (EOFError, OSError):
            self.connection.close()
            self.process.join()
            return None


def _serve(connection: Connection, job: Job) -> None:
    """What a worker does: makes the scenes whose numbers come through the pipe, until it is closed."""
    # Ctrl-C reaches every process of the terminal; the one that started the workers decides what becomes of them.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            connection.send(_answer(job, connection.recv()))


def _answer(job: Job, scene_id: int) -> Recipe | Exception:
    try:
        return job.label(scene_id)
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


def _death_notice(worker: _Worker) -> str:
    code = worker.process.exitcode or 0
    cause = f"signal {-code}" if code < 0 else f"exit code {code}"
    hint = "; is there too little memory for so many workers?" if code == KILLED else ""
    return f"{TRIES} workers died over it, the last one by {cause}{hint}"
