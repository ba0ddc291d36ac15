"""The client of the service: what it gives, what it tries again, and how little it needs."""

import subprocess
import sys

import httpx
import numpy as np
import pytest

from http_service import DEPTH, POSE, TOKEN, HeldUpPredictor, known_prediction, running, tiny_predictor
from icgnet.client import Client, ServiceError
from icgnet.errors import InputError
from tabletop_scenes import INTRINSICS


@pytest.fixture(scope="module")
def client():
    with running(tiny_predictor()) as (url, _, _), Client(url, timeout=120.0) as client:
        yield client


def test_it_gives_what_the_predictor_gives(client):
    answer = client.predict_depth(DEPTH, INTRINSICS, POSE)
    prediction = known_prediction()
    np.testing.assert_array_equal(answer.poses, prediction.grasps.poses)
    assert answer.best()["score"] == prediction.grasps.scores[0]
    assert len(answer.objects) == len(prediction.objects)
    assert answer.frame_id == "world"
    assert answer.instance_mask is None


def test_meshes_and_the_instance_mask_come_on_demand():
    with running(HeldUpPredictor()) as (url, _, _), Client(url, timeout=120.0) as client:
        answer = client.predict_depth(DEPTH, INTRINSICS, POSE, meshes=True)
    np.testing.assert_array_equal(answer.instance_mask, known_prediction().instance_mask)
    assert set(answer.meshes) == {item.instance_id for item in known_prediction().objects}
    vertices, faces = answer.meshes[0]
    assert (vertices.shape, faces.shape) == ((8, 3), (12, 3))


def test_all_that_the_predictor_takes_is_sent(client):
    answer = client.predict_depth(
        (1000 * DEPTH).astype(np.uint16),
        INTRINSICS,
        camera_pose=POSE,
        depth_scale=1000.0,
        table_height=0.05,
        mask=DEPTH > 0.1,
        level_table=True,
        frame_id="base",
        limit=2,
        region=([-1, -1, 0], [1, 1, 1]),
        deadline_ms=60_000,
    )
    assert answer.frame_id == "base"
    assert len(answer.grasps) == 2


def test_clouds_are_asked_for_in_the_same_way(client):
    cloud = known_prediction().cloud
    answer = client.predict_cloud(cloud.points, viewpoint=POSE[:3, 3], table_height=0.05)
    assert len(answer.grasps) > 0
    assert client.predict_cloud(cloud.points, region=[5, 5, 5, 6, 6, 6]).best() is None


@pytest.mark.parametrize(
    ("depth", "options", "said"),
    [
        (1000 * DEPTH, {}, "which looks like millimetres"),
        (DEPTH, {"object_class": "unicorn"}, "unicorn"),
        (DEPTH, {"fly": 1}, "no option 'fly'"),
        ([[1.0], [1.0, 2.0]], {}, "must be arrays of numbers"),
        (np.array([[None]]), {}, "must be arrays of numbers"),
    ],
)
def test_refusals_are_the_errors_of_the_predictor(client, depth, options, said):
    with pytest.raises(InputError, match=said):
        client.predict_depth(depth, INTRINSICS, **options)


def test_health_and_metadata(client):
    assert client.health() is True
    assert client.metadata()["classes"] == list(tiny_predictor().classes)


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost"])
def test_what_is_for_this_machine_goes_to_no_proxy(client, monkeypatch, host):
    monkeypatch.setenv("HTTP_PROXY", "http://127.0.0.1:9")
    monkeypatch.delenv("NO_PROXY", raising=False)
    port = client._http.base_url.port
    with Client(f"http://{host}:{port}", retries=0) as asked:
        assert asked.metadata()["classes"]
    with Client(f"http://robot.invalid:{port}", retries=0) as asked, pytest.raises(ServiceError, match="refused"):
        asked.metadata()


def test_the_token_is_sent():
    with running(HeldUpPredictor(), TOKEN) as (url, _, _):
        with Client(url, TOKEN) as known:
            assert known.metadata()["gripper"]["name"]
        with Client(url) as unknown, pytest.raises(ServiceError, match="answers 401: this service needs") as caught:
            unknown.metadata()
    assert caught.value.status == 401


def test_a_service_that_comes_back_is_found_again():
    """The connection is kept by the client and closed by the service."""
    predictor = HeldUpPredictor()
    with running(predictor) as (url, _, _):
        client = Client(url, retries=0)
        assert client.health()
    assert client.health() is False
    with pytest.raises(ServiceError, match=f"cannot reach {url}"):
        client.metadata()


class Script(httpx.BaseTransport):
    """Answers one thing after the other; an exception is raised."""

    def __init__(self, *steps: httpx.Response | Exception) -> None:
        self.steps = list(steps)

    def handle_request(self, request: httpx.Request) -> httpx.Response:
        request.read()
        step = self.steps.pop(0)
        if isinstance(step, Exception):
            raise step
        return step


OK = {"status_code": 200, "json": {"objects": [], "grasps": [], "frame_id": "camera"}}
FULL = {"status_code": 429, "json": {"error": "too many"}, "headers": {"Retry-After": "7"}}


def scripted(monkeypatch, *steps, **settings) -> tuple[Client, list[float]]:
    waits: list[float] = []
    monkeypatch.setattr("icgnet.client.time.sleep", waits.append)
    steps = [step if isinstance(step, Exception) else httpx.Response(**step) for step in steps]
    return Client("http://robot", transport=Script(*steps), **settings), waits


def test_a_full_service_is_asked_again_when_it_says(monkeypatch):
    client, waits = scripted(monkeypatch, FULL, FULL, OK)
    assert client.predict_depth(DEPTH, INTRINSICS).grasps == []
    assert len(waits) == 2
    assert all(7.0 <= wait <= 8.75 for wait in waits)


def test_a_lost_connection_is_opened_again(monkeypatch):
    lost = httpx.RemoteProtocolError("Server disconnected"), httpx.ConnectError("refused")
    client, waits = scripted(monkeypatch, *lost, OK)
    assert client.predict_depth(DEPTH, INTRINSICS).objects == []
    assert 0 < waits[0] <= 0.2 < 0.41 > waits[1] >= 0.2


def test_retries_end(monkeypatch):
    client, waits = scripted(monkeypatch, FULL, FULL, FULL, retries=2)
    with pytest.raises(ServiceError, match="answers 429: too many") as caught:
        client.predict_depth(DEPTH, INTRINSICS)
    assert caught.value.status == 429
    assert len(waits) == 2


def test_no_wait_is_longer_than_half_a_minute(monkeypatch):
    client, waits = scripted(monkeypatch, FULL | {"headers": {"Retry-After": "100000"}}, OK)
    client.predict_depth(DEPTH, INTRINSICS)
    assert waits[0] <= 1.25 * 30.0


def test_an_answer_that_does_not_come_is_not_asked_for_again(monkeypatch):
    client, waits = scripted(monkeypatch, httpx.ReadTimeout("timed out"))
    with pytest.raises(ServiceError, match="http://robot did not answer within 30 s: it is busy") as caught:
        client.predict_depth(DEPTH, INTRINSICS)
    assert (caught.value.status, waits) == (None, [])


@pytest.mark.parametrize(
    "content", [{"text": ""}, {"text": "<html>a router</html>"}, {"json": {"grasps": []}}, {"json": [1]}]
)
def test_what_is_no_service_is_said_to_be_none(monkeypatch, content):
    for ask in (
        lambda client: client.metadata(),
        lambda client: client.predict_depth(DEPTH, INTRINSICS),
        lambda client: client.predict_depth(DEPTH, INTRINSICS, meshes=True),
        lambda client: client.pick(DEPTH, INTRINSICS, [0, 0, 1]),
    ):
        client, _ = scripted(monkeypatch, {"status_code": 200, **content})
        with pytest.raises(ServiceError, match="http://robot is no service of icgnet: it answers '"):
            ask(client)


def test_arrays_are_packed_as_the_numpy_of_ubuntu_24_can(monkeypatch):
    """Before numpy 2.1, `savez` takes any name for that of an array."""
    packed, savez = {}, np.savez

    def old_savez(file, **arrays):
        packed.update(arrays)
        savez(file, **arrays)

    monkeypatch.setattr(np, "savez", old_savez)
    client, _ = scripted(monkeypatch, OK)
    client.predict_depth(DEPTH, INTRINSICS)
    assert set(packed) == {"depth", "K"}


@pytest.mark.parametrize("status", [500, 504, 302])
def test_other_answers_are_errors_at_once(monkeypatch, status):
    client, waits = scripted(monkeypatch, {"status_code": status, "text": "<html>gone\nwrong</html>"})
    with pytest.raises(ServiceError, match=f"answers {status}: <html>gone wrong"):
        client.metadata()
    assert waits == []


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"url": "robot:8000"}, "url must begin with http:// or https://, got 'robot:8000'"),
        ({"url": "http://robot:port"}, "url 'http://robot:port' is no address"),
        ({"url": "http://robot", "timeout": 0.0}, "timeout must be above 0 s"),
        ({"url": "http://robot", "retries": -1}, "retries must be at least 0"),
    ],
)
def test_arguments_out_of_range_are_refused(arguments, said):
    with pytest.raises(InputError, match=said):
        Client(**arguments)


ALONE = """
import sys

TAKEN = {"numpy", "httpx", *"httpcore h11 anyio sniffio certifi idna typing_extensions exceptiongroup".split()}

class Refuse:
    def find_spec(self, name, path=None, target=None):
        first = name.partition(".")[0]
        if first not in TAKEN and first != "icgnet" and first not in sys.stdlib_module_names:
            raise ModuleNotFoundError(name, name=first)

sys.meta_path.insert(0, Refuse())
from icgnet.client import Client
with Client("http://127.0.0.1:9", timeout=1.0, retries=0) as client:
    assert client.health() is False
try:
    import scipy
except ModuleNotFoundError:
    print("alone", sorted(name for name in sys.modules if name.startswith("icgnet")))
"""


def test_it_needs_numpy_and_httpx_only():
    done = subprocess.run([sys.executable, "-c", ALONE], capture_output=True, text=True, timeout=60, check=False)
    assert done.stdout.strip() == "alone ['icgnet', 'icgnet.client', 'icgnet.errors']", done.stderr
