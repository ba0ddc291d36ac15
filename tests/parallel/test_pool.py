"""Workers die, and so does the process that has started them; the scenes are made all the same."""

import os
import signal
import time
from contextlib import closing
from multiprocessing import active_children, get_context
from pathlib import Path

import pytest

from datagen_jobs import EndlessJob, FatalJob, FaultyJob, QuickJob, make, work_endlessly
from icgnet.datagen.job import GenerateJob
from icgnet.errors import DataError, InputError
from icgnet.parallel.pool import TRIES, LocalPool, SerialPool


def numbers(job: GenerateJob, count: int, workers: int = 2) -> list[int]:
    with closing(LocalPool(job, workers)) as pool:
        return [recipe.scene_id for recipe in pool.make(range(count))]


def test_a_local_pool_makes_every_scene_once_and_leaves_no_process_behind():
    assert sorted(numbers(make(QuickJob), 7)) == list(range(7))
    assert active_children() == []


def test_a_serial_pool_makes_them_in_order():
    assert [recipe.scene_id for recipe in SerialPool(make(QuickJob)).make([3, 1, 2])] == [3, 1, 2]


@pytest.mark.slow
def test_a_scene_whose_worker_died_is_made_by_another(tmp_path):
    assert sorted(numbers(make(FatalJob, 1, 1, tmp_path), 4, workers=1)) == [0, 1, 2, 3]
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.slow
def test_a_scene_that_kills_every_worker_is_named(tmp_path):
    with pytest.raises(DataError, match=rf"scene 1 \(seed 4\): {TRIES} workers died over it, the last one by signal 9"):
        numbers(make(FatalJob, 1, TRIES, tmp_path), 4, workers=1)
    assert active_children() == []


def test_an_unforeseen_error_comes_with_the_traceback_of_the_worker():
    with pytest.raises(ZeroDivisionError, match="a bug") as caught:
        numbers(make(FaultyJob), 4, workers=1)
    assert any("datagen_jobs.py" in note for note in caught.value.__notes__)
    assert active_children() == []


def test_errors_name_the_scene_and_the_seed(monkeypatch):
    def refuse(*arguments):
        raise InputError("no object stayed")

    monkeypatch.setattr("icgnet.datagen.job.label_scene", refuse)
    with pytest.raises(InputError, match=r"scene 7 \(seed 4\): no object stayed"):
        make(GenerateJob).make(7)


def test_closing_a_pool_kills_workers_at_work(tmp_path):
    pool = LocalPool(make(EndlessJob, tmp_path), 1)
    pool._give(0)
    (worker,) = active_children()
    assert worker.is_alive()
    pool.close()
    assert active_children() == []


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="asks /proc which processes run")
@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT], ids=lambda how: how.name)
def test_workers_end_with_the_process_that_started_them(how, tmp_path):
    parent = get_context("spawn").Process(target=work_endlessly, args=(tmp_path,))
    parent.start()
    while not (begun := list(tmp_path.glob("begun_*"))):
        assert parent.is_alive()
        time.sleep(0.01)
    worker = int(begun[0].name.removeprefix("begun_"))
    os.kill(parent.pid, how)
    parent.join(30)
    assert parent.exitcode != 0
    # Left alone it would live for a minute.
    deadline = time.monotonic() + 30.0
    while is_alive(worker):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def is_alive(pid: int) -> bool:
    """Whether a process of this number runs; one that has ended and waits for its parent does not."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return False
