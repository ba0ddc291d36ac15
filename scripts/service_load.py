"""Load of a running service: many clients at once, memory over many requests, and bodies that are no scenes.

    icgnet serve --threads 1 &
    python scripts/service_load.py http://127.0.0.1:8000 --seconds 60 --memory 1000 --malformed 1000 --pid $!

Prints one line for each part; the time in-process is measured, too, if --weights is given. Needs `icgnet[client]`.
"""

import argparse
import io
import statistics
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import httpx
import numpy as np

import icgnet

DEMO = Path(icgnet.__file__).parent / "captures" / "demo.npz"
NPZ, PNG, JSON = "application/x-npz", "image/png", "application/json"


def load(url: str, body: bytes, clients: int, seconds: float, headers: dict[str, str]) -> tuple[Counter, list[float]]:
    """Statuses, and the times of the answers with a result [s]; a full service is asked again at once."""
    statuses, times = Counter(), []
    end = time.monotonic() + seconds

    def ask() -> None:
        with httpx.Client(base_url=url, headers={**headers, "Content-Type": NPZ}, timeout=60.0) as web:
            while time.monotonic() < end:
                start = time.perf_counter()
                try:
                    status = web.post("/predict", content=body).status_code
                except httpx.HTTPError as error:
                    status = type(error).__name__
                statuses[status] += 1
                if status == httpx.codes.OK:
                    times.append(time.perf_counter() - start)
                elif status == httpx.codes.TOO_MANY_REQUESTS:
                    time.sleep(0.05)

    threads = [threading.Thread(target=ask) for _ in range(clients)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return statuses, times


def malformed(rng: np.random.Generator, good: bytes) -> tuple[str, bytes, str]:
    """Media type, body and query of a request of which nothing good can come."""
    kind = (NPZ, PNG, JSON, "text/plain", "")[rng.integers(5)]
    query = ("", "answer=xml", "limit=-1", "intrinsics=1,2", "fly=1", "deadline_ms=nan", "frame_id=%00%ff")[
        rng.integers(7)
    ]
    choice = rng.integers(5)
    if choice == 0:
        return kind, rng.bytes(rng.integers(0, 5000)), query
    if choice == 1:
        return kind, good[: rng.integers(len(good) // 2)], query
    if choice == 2:
        texts = (b"{}", b"[" * 5000, b'{"points": [[NaN, 1e999, -1]]}', b'{"depth": "/etc/passwd"}', b"null", b'"\xff"')
        return JSON, texts[rng.integers(len(texts))], query
    if choice == 3:
        content = io.BytesIO()
        shape = ((0, 0), (3,), (10**5,), (5, 5, 5), (50, 50))[rng.integers(5)]
        name = ("depth", "points", "K", "x", "../../etc/passwd")[rng.integers(5)]
        np.savez(content, allow_pickle=False, **{name: np.full(shape, (np.nan, 0.0, 1e300, -1.0)[rng.integers(4)])})
        return NPZ, content.getvalue(), query
    spoiled = bytearray(good[: len(good) // 4])
    for place in rng.integers(len(spoiled), size=50):
        spoiled[place] = rng.integers(256)
    return kind, bytes(spoiled), query


def send_malformed(url: str, count: int, headers: dict[str, str], good: bytes, seed: int = 0) -> Counter:
    """Statuses of so many malformed requests."""
    rng, statuses = np.random.default_rng(seed), Counter()
    with httpx.Client(base_url=url, headers=headers, timeout=60.0) as web:
        for _ in range(count):
            kind, body, query = malformed(rng, good)
            answer = web.post(f"/predict?{query}", content=body, headers={"Content-Type": kind})
            statuses[answer.status_code] += 1
    return statuses


def megabytes(pid: int) -> float:
    """Resident memory of a process (Linux)."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmRSS")) / 1024


def memory(url: str, body: bytes, count: int, pid: int, headers: dict[str, str]) -> Iterator[float]:
    """Resident memory [MiB] before, and after each tenth of so many requests."""
    yield megabytes(pid)
    with httpx.Client(base_url=url, headers={**headers, "Content-Type": NPZ}, timeout=60.0) as web:
        for number in range(1, count + 1):
            web.post("/predict", content=body).raise_for_status()
            if number % max(1, count // 10) == 0:
                yield megabytes(pid)


def alone(url: str, body: bytes, count: int, headers: dict[str, str], weights: Path | None) -> dict[str, list[float]]:
    """Times of one client [s]; by turns with the same prediction in one thread of this process, if there are weights.

    The turns keep what else the machine does from speaking for one of them.
    """
    times: dict[str, list[float]] = {"in-process": [], "one client": []}
    predict = (lambda: None) if weights is None else in_process(weights, body)
    with httpx.Client(base_url=url, headers={**headers, "Content-Type": NPZ}, timeout=60.0) as web:
        jobs = {"in-process": predict, "one client": lambda: web.post("/predict", content=body).raise_for_status()}
        for number in range(count + 1):
            for name, job in jobs.items():
                start = time.perf_counter()
                job()
                times[name] += [time.perf_counter() - start] * (number > 0)
    return times if weights else {"one client": times["one client"]}


def in_process(weights: Path, body: bytes) -> Callable[[], object]:
    """The same prediction without a service."""
    from icgnet import Predictor

    predictor = Predictor.load(weights, threads=1)
    with np.load(io.BytesIO(body)) as saved:
        capture = saved["depth"], saved["K"], saved["camera_pose"]
    return lambda: predictor.predict_depth(*capture)


def spread(times: list[float]) -> str:
    """Median and 95th percentile."""
    if not times:
        return "none"
    ordered = sorted(times)
    return f"p50 {1e3 * statistics.median(ordered):.0f} ms, p95 {1e3 * ordered[int(0.95 * (len(ordered) - 1))]:.0f} ms"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("url")
    parser.add_argument("--token", default="")
    parser.add_argument("--capture", type=Path, default=DEMO, help="npz with depth, K and camera_pose")
    parser.add_argument("--weights", type=Path, help="the same as the service's, to measure in-process")
    parser.add_argument("--clients", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--single", type=int, default=20, help="requests of one client alone")
    parser.add_argument("--memory", type=int, default=0)
    parser.add_argument("--malformed", type=int, default=0)
    parser.add_argument("--pid", type=int)
    given = parser.parse_args()
    headers = {"Authorization": f"Bearer {given.token}"} if given.token else {}
    body = given.capture.read_bytes()
    if given.single:
        for name, times in alone(given.url, body, given.single, headers, given.weights).items():
            print(f"{name}, {given.single} times: {spread(times)}", flush=True)
    if given.seconds:
        statuses, times = load(given.url, body, given.clients, given.seconds, headers)
        said = ", ".join(f"{count} x {status}" for status, count in sorted(statuses.items(), key=str))
        print(f"{given.clients} clients for {given.seconds:g} s: {said}; results: {spread(times)}", flush=True)
    if given.malformed:
        statuses = send_malformed(given.url, given.malformed, headers, body)
        said = ", ".join(f"{count} x {status}" for status, count in sorted(statuses.items()))
        print(f"{given.malformed} malformed bodies: {said}", flush=True)
    if given.memory:
        print(f"memory over {given.memory} requests [MiB]:", end="", flush=True)
        for size in memory(given.url, body, given.memory, given.pid, headers):
            print(f" {size:.0f}", end="", flush=True)
        print()


if __name__ == "__main__":
    main()
