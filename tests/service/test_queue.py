"""One prediction at a time, a few that wait, and what happens to those for which there is no time or place."""

import socket
import time
from concurrent.futures import ThreadPoolExecutor

import httpx
import pytest

from http_service import DEPTH, HeldUpPredictor, npz, running, wait_until
from tabletop_scenes import INTRINSICS

BODY = npz(depth=DEPTH, K=INTRINSICS)
HEADERS = {"Content-Type": "application/x-npz"}


def post(url: str, timeout: float = 20.0, **query) -> httpx.Response:
    return httpx.post(f"{url}/predict", content=BODY, params=query, headers=HEADERS, timeout=timeout)


@pytest.fixture
def held():
    predictor = HeldUpPredictor()
    predictor.may_end.clear()
    return predictor


def test_more_than_may_wait_are_asked_to_come_back(held):
    with running(held, queue=2) as (url, service, _), ThreadPoolExecutor(8) as callers:
        calls = [callers.submit(post, url) for _ in range(3)]
        wait_until(lambda: service.worker.taken == 3)
        refused = post(url)
        assert refused.status_code == 429
        assert refused.headers["retry-after"] == "1"
        assert refused.json() == {"error": "too many requests are waiting: ask again in 1 s"}
        assert "icgnet_requests_in_house 3.0" in httpx.get(f"{url}/metrics").text
        assert httpx.get(f"{url}/health").status_code == 200
        held.may_end.set()
        assert [call.result().status_code for call in calls] == [200] * 3
        assert post(url).status_code == 200


def test_a_full_service_does_not_wait_for_the_body(held):
    with running(held, queue=0) as (url, _, _), ThreadPoolExecutor(1) as callers:
        call = callers.submit(post, url)
        assert held.begun.acquire(timeout=10)
        address = httpx.URL(url)
        with socket.create_connection((address.host, address.port), timeout=10) as connection:
            head = f"POST /predict HTTP/1.1\r\nHost: {address.host}\r\nContent-Length: 1000000\r\n\r\n"
            connection.sendall(head.encode())
            assert connection.recv(100).startswith(b"HTTP/1.1 429 ")
        held.may_end.set()
        assert call.result().status_code == 200


def test_what_waited_is_taken_off_the_budget(held):
    with running(held, deadline_ms=5000.0) as (url, service, _), ThreadPoolExecutor(2) as callers:
        calls = [callers.submit(post, url)]
        assert held.begun.acquire(timeout=10)
        calls.append(callers.submit(post, url, deadline_ms=9000))
        wait_until(lambda: service.worker.taken == 2)
        time.sleep(0.21)
        held.may_end.set()
        answers = [call.result() for call in calls]
        assert [answer.status_code for answer in answers] == [200, 200]
        assert answers[1].json()["service"]["waited_ms"] > 200
        post(url, deadline_ms=100_000)
    first, second, third = held.budgets
    assert 1000 < first < 5000
    assert 4000 < second < 8800
    assert 90_000 < third < 100_000


def test_a_budget_of_the_service_is_not_exceeded():
    predictor = HeldUpPredictor().with_search(budget_ms=200.0)
    with running(predictor) as (url, _, _):
        post(url, deadline_ms=9000)
        post(url)
    assert predictor.budgets == [200.0, 200.0]


def test_a_request_whose_time_is_up_before_it_begins_is_not_predicted(held):
    with running(held) as (url, service, _), ThreadPoolExecutor(2) as callers:
        first = callers.submit(post, url)
        assert held.begun.acquire(timeout=10)
        late = callers.submit(post, url, deadline_ms=100)
        wait_until(lambda: service.worker.taken == 2)
        time.sleep(0.15)
        held.may_end.set()
        assert late.result().status_code == 504
        assert late.result().json()["error"].startswith("the deadline of 100 ms passed while the request waited")
        assert first.result().status_code == 200
        assert len(held.budgets) == 1


def test_who_goes_away_is_not_predicted_for(held):
    with running(held) as (url, service, _), ThreadPoolExecutor(2) as callers:
        first = callers.submit(post, url)
        assert held.begun.acquire(timeout=10)
        with pytest.raises(httpx.ReadTimeout):
            post(url, timeout=0.2)
        wait_until(lambda: service.worker.taken == 1)
        held.may_end.set()
        assert first.result().status_code == 200
        assert post(url).status_code == 200
        assert len(held.budgets) == 2


def test_who_goes_away_in_the_middle_keeps_the_place_until_the_end(held):
    with running(held, queue=0) as (url, service, _):
        with pytest.raises(httpx.ReadTimeout):
            post(url, timeout=0.2)
        assert held.begun.acquire(timeout=10)
        time.sleep(0.05)
        assert post(url).status_code == 429
        held.may_end.set()
        wait_until(lambda: service.worker.taken == 0)
        assert post(url).status_code == 200


def test_when_it_stops_it_finishes_what_runs_and_drops_what_waits(held):
    with running(held) as (url, service, server), ThreadPoolExecutor(3) as callers:
        runs = callers.submit(post, url)
        assert held.begun.acquire(timeout=10)
        waits = callers.submit(post, url)
        wait_until(lambda: service.worker.taken == 2)
        server.should_exit = True
        assert waits.result().status_code == 503
        assert waits.result().json() == {"error": "the service is stopping"}
        assert waits.result().headers["retry-after"] == "5"
        held.may_end.set()
        assert runs.result().status_code == 200
        assert len(held.budgets) == 1
