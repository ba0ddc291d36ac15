"""Makes the pieces of a job on a Ray cluster. The only file that knows Ray."""

import socket
import time
from collections import deque
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Generic
from urllib.parse import urlsplit

import icgnet
from icgnet.errors import DataError, InputError
from icgnet.parallel.pool import TRIES, Job, Product

if TYPE_CHECKING:
    import ray

LOCAL = "local"
OBJECT_STORE = 128 * 2**20
"""Shared memory of a local cluster [bytes]; a scene of 3 kB hardly needs any."""

TASKS_PER_PROCESSOR = 2
"""Tasks that are handed to the cluster at a time: one to do, one to go on with."""

SCENES_PER_TASK = 8
"""At most. Handing out a task takes the driver some 2 ms, which would be too much for every scene of 1,000 workers; and
the answer, 30 kB, is small enough to come without passing through the shared memory."""

COUNT_SECONDS = 5.0
"""How often the cluster's processors are counted, for it may grow and shrink."""

CONNECT_SECONDS = 10.0


class RayPool(Generic[Product]):
    """Makes pieces as Ray tasks of one processor each; Ray gives those of lost workers and machines to others.

    Args:
        job: what to make.
        address: "local" to start a cluster on this machine, "auto" to join the one that this machine belongs to, or
            an address, "host:port" or "ray://host:port".
        workers: processors of a local cluster.

    Raises:
        InputError: Ray is not installed, or no cluster answers at the address.
    """

    def __init__(self, job: Job[Product], address: str, workers: int) -> None:
        self._job = job
        self._ray = _import_ray()
        # Who calls from inside a Ray program keeps the connection.
        self._is_ours = not self._ray.is_initialized()
        if self._is_ours:
            _connect(self._ray, address, workers)

    @property
    def workers(self) -> int:
        """Processors of the cluster; it may grow and shrink."""
        return max(1, int(self._ray.cluster_resources().get("CPU", 1)))

    def make(self, numbers: Sequence[int]) -> Iterator[Product]:
        """The pieces, each as soon as its task is finished."""
        task = self._ray.remote(num_cpus=1, max_retries=TRIES - 1)(_make)
        # In a list, Ray hands the reference on instead of sending the whole job along with every task.
        reference = [self._ray.put(self._job)]
        wanted, counted = TASKS_PER_PROCESSOR * self.workers, time.monotonic()
        # Small runs must be spread evenly, too.
        size = min(SCENES_PER_TASK, max(1, len(numbers) // (2 * wanted)))
        todo = deque(list(numbers[start : start + size]) for start in range(0, len(numbers), size))
        pending: dict[ray.ObjectRef[list[Product]], list[int]] = {}
        while todo or pending:
            if time.monotonic() - counted > COUNT_SECONDS:
                wanted, counted = TASKS_PER_PROCESSOR * self.workers, time.monotonic()
            while todo and len(pending) < wanted:
                ids = todo.popleft()
                pending[task.remote(icgnet.__version__, reference, ids)] = ids
            for answer in self._finished(list(pending)):
                ids = pending.pop(answer)
                pieces = self._fetch(answer, ids)
                yield from pieces
                if not pieces:
                    # All alone, they will show which of them it is.
                    todo.extendleft([scene_id] for scene_id in ids)

    def _finished(self, answers: "list[ray.ObjectRef[list[Product]]]") -> "list[ray.ObjectRef[list[Product]]]":
        """All that are there, as soon as there is one."""
        self._ray.wait(answers, num_returns=1)
        return self._ray.wait(answers, num_returns=len(answers), timeout=0)[0]

    def close(self) -> None:
        """Ends a local cluster, or leaves the one that was joined."""
        if self._is_ours:
            self._ray.shutdown()

    def _fetch(self, answer: "ray.ObjectRef[list[Product]]", scene_ids: list[int]) -> list[Product]:
        """The pieces of a task; none if it was lost again and again and had several scenes."""
        errors, name = self._ray.exceptions, self._job.name(scene_ids[0])
        try:
            return self._ray.get(answer)
        except errors.RayTaskError as error:
            if isinstance(error.cause, errors.RayError):
                reason = str(error.cause).splitlines()[0]
                raise DataError(f"{name}: a machine of the cluster could not take it: {reason}") from error
            raise error.cause from error
        except errors.RayError as error:
            if len(scene_ids) > 1:
                return []
            raise DataError(f"{name}: lost on the cluster {TRIES} times: {str(error).splitlines()[0]}") from error


# A process of the cluster keeps its job, so that meshes are read once and not for every scene.
_jobs: dict[str, Job[Any]] = {}


def _make(version: str, reference: "list[ray.ObjectRef[Job[Any]]]", scene_ids: list[int]) -> list[Any]:
    """What the cluster's processes do."""
    import ray

    if version != icgnet.__version__:
        raise InputError(f"this machine has icgnet {version}, a machine of the cluster has {icgnet.__version__}")
    key = reference[0].hex()
    if key not in _jobs:
        _jobs.clear()
        _jobs[key] = ray.get(reference[0])
    return [_jobs[key].make(scene_id) for scene_id in scene_ids]


def _import_ray() -> Any:
    try:
        import ray
    except ImportError as error:
        raise InputError('--ray needs Ray: pip install "icgnet[cluster]"') from error
    return ray


def _connect(ray: Any, address: str, workers: int) -> None:
    if address not in (LOCAL, "auto"):
        _check_answers(address)
    local = {"num_cpus": workers, "include_dashboard": False, "object_store_memory": OBJECT_STORE}
    try:
        ray.init(address, log_to_driver=False, logging_level="ERROR", **(local if address == LOCAL else {}))
    except (ConnectionError, ImportError, ValueError, RuntimeError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(f'no Ray cluster at {address!r} (give "local", "auto" or host:port): {reason}') from error


def _check_answers(address: str) -> None:
    """Raises InputError unless something listens at "host:port"; Ray itself would go on asking for very long."""
    url = urlsplit(address if "://" in address else f"//{address}")
    try:
        socket.create_connection((url.hostname, url.port), CONNECT_SECONDS).close()
    except OSError as error:
        raise InputError(f'no Ray cluster at {address!r} (give "local", "auto" or host:port): {error}') from error
