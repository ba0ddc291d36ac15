"""`icgnet serve`: it says where it answers, and ends when it is told to."""

import builtins
import signal
import socket
import sys
import threading
import time

import httpx
import pytest

from http_service import DEPTH, npz
from icgnet.cli.main import main
from icgnet.client import Client
from icgnet.errors import InputError, MissingExtraError
from icgnet.network.weights import save_weights
from icgnet.service.server import listen
from service_process import serving
from tabletop_scenes import INTRINSICS, tiny_network


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--host", "0.0.0.0"], "error: host 0.0.0.0 can be reached from other machines: set the environment variable"),
        (["--port", "70000"], "port must be at least 0 and at most 65535, got 70000"),
        (["--threads", "0"], "threads must be at least 1"),
        (["--weights", "none.safetensors"], "none.safetensors: no such weights file"),
        (["--hand-eye", "eye.yaml"], "hand_eye is for picks: give --arm, too"),
        (["--arm", "fr3", "--pick.margin", "9"], "margin must be at least 0.001 and at most 0.05, got 9"),
    ],
)
def test_what_is_wrong_is_one_line(arguments, said, capsys, monkeypatch):
    monkeypatch.delenv("ICGNET_TOKEN", raising=False)
    assert main(["serve", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_without_the_extra_it_says_what_to_install(capsys, monkeypatch):
    real = builtins.__import__

    def without(name, *arguments, **named):
        if name.startswith("icgnet.service.app"):
            raise ModuleNotFoundError("No module named 'fastapi'", name="fastapi")
        return real(name, *arguments, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    assert main(["serve"]) == 2
    assert capsys.readouterr().err == 'error: icgnet serve needs more packages: pip install "icgnet[serve]"\n'


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--arm", "none.yaml"], "arm 'none.yaml' is neither a file nor one of ['fr3']"),
        (["--arm", "fr3", "--hand-eye", "none.yaml"], "no such hand-eye file: none.yaml"),
    ],
)
def test_what_is_wrong_with_the_arm_is_one_line(arguments, said, capsys):
    pytest.importorskip("icgnet.arm.libraries", reason="needs icgnet[arm]", exc_type=MissingExtraError)
    assert main(["serve", *arguments]) == 2
    err = capsys.readouterr().err
    assert said in err
    assert err.count("\n") == 1


def test_without_the_packages_of_the_arm_it_says_what_to_install(capsys, monkeypatch):
    for name in [name for name in sys.modules if name.startswith("icgnet.arm.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    assert main(["serve", "--arm", "fr3"]) == 2
    assert capsys.readouterr().err.endswith('which is not installed: pip install "icgnet[arm]"\n')


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    weights = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
    save_weights(weights, tiny_network(), {})
    with serving("--weights", weights) as started:
        yield started


@pytest.mark.slow
def test_a_process_answers_and_finishes_what_runs_when_it_is_terminated(service):
    url, process = service
    with Client(url) as client:
        assert len(client.metadata()["weights"]["sha256"]) == 64
        assert len(client.predict_depth(DEPTH, INTRINSICS).objects) > 0
    answers = []
    body = npz(depth=DEPTH, K=INTRINSICS)

    def ask():
        answers.append(
            httpx.post(f"{url}/predict", content=body, headers={"Content-Type": "application/x-npz"}, timeout=60.0)
        )

    caller = threading.Thread(target=ask)
    caller.start()
    end = time.monotonic() + 10.0
    while "icgnet_requests_in_house 1.0" not in httpx.get(f"{url}/metrics").text and time.monotonic() < end:
        time.sleep(0.002)
    process.send_signal(signal.SIGTERM)
    caller.join()
    # It ran, or it had just been taken in.
    assert answers[0].status_code in (200, 503)
    assert process.wait(timeout=20) in (0, -signal.SIGTERM)
    assert "Traceback" not in process.stderr.read()


def test_a_taken_port_is_one_line():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"cannot listen on 127.0.0.1, port {port}: Address already in use"):
            listen("127.0.0.1", port)
