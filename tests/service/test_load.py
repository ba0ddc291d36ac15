"""The script that loads a service, with few requests and a predictor that has nothing to do."""

import importlib.util
import os
from pathlib import Path

import pytest

from http_service import DEPTH, HeldUpPredictor, npz, running, tiny_predictor
from tabletop_scenes import INTRINSICS

SCRIPT = Path(__file__).parents[2] / "scripts" / "service_load.py"
BODY = npz(depth=DEPTH, K=INTRINSICS)


@pytest.fixture(scope="module")
def script():
    found = importlib.util.spec_from_file_location("service_load", SCRIPT)
    module = importlib.util.module_from_spec(found)
    found.loader.exec_module(module)
    return module


def test_eight_clients_see_nothing_but_results_and_full_queues(script):
    with running(HeldUpPredictor()) as (url, _, _):
        statuses, times = script.load(url, BODY, 8, 0.7, {})
    assert set(statuses) <= {200, 429}
    assert len(times) == statuses[200] > 0


def test_one_client_alone_is_measured_without_the_first_request(script):
    with running(HeldUpPredictor()) as (url, _, _):
        times = script.alone(url, BODY, 3, {}, None)
    assert list(times) == ["one client"]
    assert len(times["one client"]) == 3


def test_malformed_bodies_are_the_callers_fault(script):
    with running(tiny_predictor()) as (url, _, _):
        statuses = script.send_malformed(url, 100, {}, BODY)
    assert statuses.total() == 100
    assert all(400 <= status < 500 for status in statuses)


def test_memory_does_not_grow_with_the_requests(script):
    if not Path("/proc/self/status").is_file():
        pytest.skip("needs /proc to see the memory of a process")
    with running(HeldUpPredictor()) as (url, _, _):
        list(script.memory(url, BODY, 10, os.getpid(), {}))
        sizes = list(script.memory(url, BODY, 40, os.getpid(), {}))
    assert max(sizes[5:]) - max(sizes[:5]) < 5.0
