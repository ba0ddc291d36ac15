"""What the service answers to whom."""

import csv
import io
import json
import re
import time

import httpx
import numpy as np
import pytest

from http_service import (
    DEPTH,
    PINHOLE,
    POSE,
    TOKEN,
    HeldUpPredictor,
    depth_png,
    known_prediction,
    npz,
    running,
    tiny_predictor,
)
from icgnet import __version__
from icgnet.cli.demo import FOLDER
from icgnet.errors import DataError, InputError
from icgnet.predictor import Predictor
from icgnet.service.app import Service, create_app
from icgnet.service.bodies import JSON, NPZ, PNG
from icgnet.service.config import ServiceConfig
from icgnet.service.options import OPTIONS
from tabletop_scenes import INTRINSICS

BODY = npz(depth=DEPTH, K=INTRINSICS, camera_pose=POSE)


@pytest.fixture(scope="module")
def web():
    """A client of a service with the tiny network."""
    with running(tiny_predictor()) as (url, _, _), httpx.Client(base_url=url, timeout=60.0) as client:
        yield client


@pytest.fixture(scope="module")
def known_predictor():
    """Has one prediction for everything."""
    return HeldUpPredictor()


@pytest.fixture(scope="module")
def known(known_predictor):
    """A client of a service that has one prediction for everything."""
    with running(known_predictor) as (url, _, _), httpx.Client(base_url=url, timeout=60.0) as client:
        yield client


@pytest.fixture(scope="module")
def locked():
    """A client without the token that its service wants."""
    with running(HeldUpPredictor(), TOKEN) as (url, _, _), httpx.Client(base_url=url, timeout=60.0) as client:
        yield client


def post(client: httpx.Client, body: bytes, kind: str = NPZ, **query) -> httpx.Response:
    return client.post("/predict", content=body, params=query, headers={"Content-Type": kind})


def test_the_answer_is_what_the_predictor_says(web):
    answer = post(web, BODY)
    expected = json.loads(json.dumps(known_prediction().to_dict()))
    assert answer.status_code == 200
    assert answer.headers["content-type"] == JSON
    told = answer.json()
    assert told.pop("service")["waited_ms"] >= 0
    assert len(told["grasps"]) > 5
    assert told.pop("timings_ms").keys() == expected.pop("timings_ms").keys()
    assert told == expected


def test_an_npz_holds_meshes_and_the_instance_of_every_pixel(known):
    prediction = known_prediction()
    with np.load(io.BytesIO(post(known, BODY, answer="npz").content), allow_pickle=False) as saved:
        assert json.loads(saved["result"].tobytes())["format"] == prediction.to_dict()["format"]
        np.testing.assert_array_equal(saved["instance_mask"], prediction.instance_mask)
        for item in prediction.objects:
            mesh = item.mesh()
            assert len(mesh.faces) == 12
            np.testing.assert_allclose(saved[f"vertices_{item.instance_id}"], mesh.vertices, atol=1e-6)
            np.testing.assert_array_equal(saved[f"faces_{item.instance_id}"], mesh.faces)


def test_a_table_of_the_grasps_can_be_read_without_json(known):
    answer = post(known, BODY, answer="csv", limit=2)
    assert answer.headers["content-type"].startswith("text/csv")
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    grasps = known_prediction().grasps
    assert len(rows) == 2
    for g, row in enumerate(rows):
        pose = [float(row[f"m{i}{j}"]) for i in range(4) for j in range(4)]
        np.testing.assert_array_equal(np.reshape(pose, (4, 4)), grasps.poses[g])
        assert float(row["score"]) == grasps.scores[g]
        assert row["class_name"] == known_prediction().class_of(int(row["instance_id"]))


def test_a_png_a_cloud_and_json_find_the_same_objects(web):
    pose = ",".join(map(repr, POSE.ravel().tolist()))
    of_png = post(web, depth_png(), PNG, intrinsics=PINHOLE, depth_scale=1000, camera_pose=pose).json()
    cloud = known_prediction().cloud
    of_cloud = post(web, npz(points=cloud.points, viewpoint=cloud.viewpoint), table_height=0.05, frame_id="base").json()
    points = {"points": cloud.points.tolist(), "viewpoint": POSE[:3, 3].tolist(), "table_height": 0.05}
    of_json = post(web, json.dumps(points).encode(), JSON).json()
    for answer in (of_png, of_cloud, of_json):
        assert len(answer["objects"]) > 0
        assert len(answer["grasps"]) > 0
    assert [of_png["frame_id"], of_cloud["frame_id"], of_json["frame_id"]] == ["world", "base", "world"]


def test_grasps_are_chosen_by_class_instance_region_and_number(known):
    prediction = known_prediction()
    name = prediction.class_of(int(prediction.grasps.instances[0]))
    assert len(post(known, BODY, object_class=name).json()["grasps"]) == len(prediction.of_class(name).grasps)
    assert {each["instance_id"] for each in post(known, BODY, instance=0).json()["grasps"]} <= {0}
    assert post(known, BODY, region="5,5,5,6,6,6").json()["grasps"] == []
    assert len(post(known, BODY, limit=1).json()["grasps"]) == 1
    missing = post(known, BODY, instance=999)
    assert missing.status_code == 422
    assert "no object 999: the scene has" in missing.json()["error"]


@pytest.mark.parametrize(
    ("kind", "query", "status", "said"),
    [
        ("text/plain", {}, 415, "Content-Type must be one of image/png, application/x-npz, application/json"),
        (PNG, {}, 422, "not a readable PNG"),
        (NPZ, {"fly": "1"}, 422, "no option 'fly'"),
        (NPZ, {"object_class": "unicorn"}, 422, "unicorn"),
        (NPZ, {"region": "1,0,0,0,1,1"}, 422, "region must have lower <= upper"),
        (NPZ, {"depth_scale": 0.001}, 422, "which looks like millimetres"),
        (NPZ, {"camera_pose": "1,2,3,0,0,0,0"}, 422, "camera_pose"),
        (NPZ, {"frame_id": "x" * 9000}, 414, "at most 8192 characters"),
    ],
)
def test_refusals_are_one_line(web, kind, query, status, said):
    answer = post(web, BODY, kind, **query)
    assert answer.status_code == status
    assert set(answer.json()) == {"error"}
    assert said in answer.json()["error"]
    assert "\n" not in answer.json()["error"]


@pytest.mark.parametrize(("method", "path", "status"), [("GET", "/fly", 404), ("GET", "/predict", 405)])
def test_unknown_addresses_are_refused_in_the_same_way(web, method, path, status):
    answer = web.request(method, path)
    assert (answer.status_code, set(answer.json())) == (status, {"error"})


def test_packed_bodies_are_refused(web):
    headers = {"Content-Type": NPZ, "Content-Encoding": "gzip"}
    assert web.post("/predict", content=BODY, headers=headers).status_code == 415


def test_answers_go_out_at_once(web):
    web.get("/health")
    times = []
    for _ in range(9):
        start = time.perf_counter()
        web.get("/health")
        times.append(time.perf_counter() - start)
    # Without TCP_NODELAY each one takes 40 ms, for which the receiving system waits with its receipt.
    assert min(times) < 0.03


def test_metadata_tell_what_is_served(web):
    told = web.get("/metadata").json()
    assert told["icgnet"] == __version__
    assert told["classes"] == list(tiny_predictor().classes)
    assert told["gripper"] == tiny_predictor().gripper.to_dict()
    assert told["weights"] == {"sha256": "of no file"}
    assert told["limits"]["max_bytes"] == 32_000_000
    assert {"units", "frames"} <= set(told)


def test_openapi_names_every_option_and_answer(web):
    described = web.get("/openapi.json").json()["paths"]["/predict"]["post"]
    assert [each["name"] for each in described["parameters"]] == list(OPTIONS)
    assert set(described["requestBody"]["content"]) == {PNG, NPZ, JSON}
    assert {"200", "401", "413", "422", "429", "503", "504"} <= set(described["responses"])
    assert web.get("/docs").status_code == 200


def test_metrics_count_requests_by_route_and_status():
    with running(HeldUpPredictor()) as (url, _, _), httpx.Client(base_url=url, timeout=60.0) as client:
        assert post(client, BODY).status_code == 200
        assert post(client, BODY, PNG).status_code == 422
        assert client.get("/secret/path").status_code == 404
        page = client.get("/metrics")
    assert page.headers["content-type"].startswith("text/plain")
    assert 'icgnet_requests_total{route="/predict",status="200"} 1.0' in page.text
    assert 'icgnet_requests_total{route="/predict",status="422"} 1.0' in page.text
    assert 'icgnet_requests_total{route="other",status="404"} 1.0' in page.text
    assert "icgnet_prediction_seconds_count 1.0" in page.text
    assert f"icgnet_grasps_total {len(known_prediction().grasps)}.0" in page.text
    assert "secret" not in page.text


def test_large_bodies_are_refused_while_they_come():
    with (
        running(HeldUpPredictor(), max_megabytes=0.1) as (url, _, _),
        httpx.Client(base_url=url, timeout=60.0) as client,
    ):
        assert post(client, bytes(100_001)).status_code == 413
        sent = 0

        def endless():
            nonlocal sent
            while sent < 10**9:
                sent += 10_000
                yield bytes(10_000)

        answer = client.post("/predict", content=endless(), headers={"Content-Type": NPZ})
        assert answer.status_code == 413
        assert answer.json() == {"error": "the body must be at most 100000 bytes"}
        assert sent < 10**8
        assert post(client, BODY).status_code == 200


def test_a_connection_goes_on_after_a_body_that_was_not_read(known):
    answer = post(known, bytes(20_000_000), "text/plain")
    assert answer.status_code == 415
    assert post(known, BODY).status_code == 200


def test_a_body_that_does_not_come_gives_its_place_back():
    with (
        running(HeldUpPredictor(), queue=0, body_seconds=0.1) as (url, _, _),
        httpx.Client(base_url=url, timeout=60.0) as client,
    ):

        def slow():
            yield b"PK"
            # Longer than the service waits; the rest is sent into a connection that it has closed.
            time.sleep(0.4)
            yield b"PK"

        assert client.post("/predict", content=slow(), headers={"Content-Type": NPZ}).status_code == 408
        assert post(client, BODY).status_code == 200


@pytest.mark.parametrize("header", [None, "Bearer wrong", f"Basic {TOKEN}", "Bearer", f"Bearer {TOKEN}x", "Bearer ü"])
def test_without_its_token_nothing_but_health_is_told(locked, header):
    headers = {} if header is None else {"Authorization": header.encode()}
    asked = locked.post("/predict", content=BODY, headers={"Content-Type": NPZ, **headers})
    for answer in (asked, locked.get("/metadata", headers=headers), locked.get("/metrics", headers=headers)):
        assert answer.status_code == 401
        assert answer.headers["www-authenticate"] == "Bearer"
    assert locked.get("/health", headers=headers).json() == {"status": "ok"}
    assert locked.get("/openapi.json", headers=headers).status_code == 200


@pytest.mark.parametrize("host", [None, "robot.example", "["])
def test_with_its_token_it_answers_and_the_machine_may_have_any_name(locked, host):
    headers = {"Authorization": f"Bearer {TOKEN}"} | ({} if host is None else {"Host": host})
    assert locked.post("/predict", content=BODY, headers={"Content-Type": NPZ, **headers}).status_code == 200
    assert locked.get("/metadata", headers=headers).status_code == 200


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1.evil.example:8000", "[", "localhost:x", ""])
def test_without_a_token_only_names_of_this_machine_are_answered(web, host):
    answer = web.get("/metadata", headers={"Host": host})
    assert answer.status_code == 400
    assert "without a token only requests to localhost are answered" in answer.json()["error"]
    assert web.get("/metadata", headers={"Host": "localhost:8000"}).status_code == 200
    assert web.get("/metadata", headers={"Host": "[::1]"}).status_code == 200


@pytest.mark.parametrize(
    ("host", "token", "said"),
    [
        ("0.0.0.0", None, "set the environment variable ICGNET_TOKEN"),
        ("192.168.1.5", None, "set the environment variable ICGNET_TOKEN"),
        ("0.0.0.0", "short", "at least 16 printable ASCII characters without blanks, got 5"),
        ("127.0.0.1", "with blanks in the middle", "without blanks"),
    ],
)
def test_a_service_that_others_reach_needs_a_good_token(host, token, said):
    with pytest.raises(InputError, match=re.escape(said)):
        create_app(Service(HeldUpPredictor(), ServiceConfig(host=host), {}), token)


@pytest.mark.parametrize(
    ("field", "value"), [("port", 70000), ("queue", -1), ("max_megabytes", 0.0), ("host", ""), ("deadline_ms", 0.0)]
)
def test_settings_out_of_range_are_refused(field, value):
    with pytest.raises(InputError, match=field):
        ServiceConfig(**{field: value})


@pytest.mark.parametrize(
    ("error", "status", "said"),
    [
        (InputError("this\nis wrong"), 422, "this is wrong"),
        (DataError("broken"), 422, "broken"),
        (RuntimeError("secret"), 500, "internal error: the log of the service tells more"),
        (MemoryError(), 500, "internal error: the log of the service tells more"),
    ],
)
def test_errors_of_a_prediction_are_answered_and_the_service_goes_on(
    known, known_predictor, monkeypatch, error, status, said
):
    monkeypatch.setattr(known_predictor, "error", error)
    answer = post(known, BODY)
    assert (answer.status_code, answer.json()) == (status, {"error": said})
    monkeypatch.undo()
    assert post(known, BODY).status_code == 200


def test_numbers_that_are_not_finite_become_null():
    class Strange(HeldUpPredictor):
        def predict_depth(self, *args, **kwargs):
            prediction = known_prediction()
            return type(prediction)(**{**vars(prediction), "timings_ms": {"encode": float("nan")}})

    with running(Strange()) as (url, _, _), httpx.Client(base_url=url, timeout=60.0) as client:
        answer = post(client, BODY)
    assert "NaN" not in answer.text
    assert answer.json()["timings_ms"] == {"encode": None}


@pytest.mark.slow
def test_the_shipped_weights_find_grasps_in_the_demo_capture():
    with running(Predictor.load()) as (url, _, _), httpx.Client(base_url=url, timeout=60.0) as client:
        answer = post(client, (FOLDER / "demo.npz").read_bytes())
    assert answer.status_code == 200, answer.text
    assert len(answer.json()["grasps"]) > 0
