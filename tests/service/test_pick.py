"""`/pick`: plans for the arm that the service was started with."""

import base64
import json
import re
import threading
import time

import httpx
import numpy as np
import pytest

import needs_arm  # noqa: F401
from arm_scenes import T_BASE_FRAME, arm_file, box, boxes_seen
from http_service import DEPTH, POSE, TOKEN, HeldUpPredictor, depth_png, npz, png, running, wait_until
from icgnet.arm.arm import Arm
from icgnet.arm.hand_eye import HandEye
from icgnet.arm.pick import NO_TIME, plan_pick
from icgnet.arm.settings import PickSettings
from icgnet.client import Client, ServiceError
from icgnet.errors import InputError
from icgnet.service.bodies import JSON, NPZ, PNG
from icgnet.service.options import PICK_OPTIONS
from icgnet.service.picking import PickBench
from tabletop_scenes import INTRINSICS

BODY = npz(depth=DEPTH, K=INTRINSICS, camera_pose=POSE)
DROP = (-0.05, 0.5, 0.2)
ON_THE_ARM = {"T_tool_camera": [0.05, 0, 0.03, 1, 0, 0, 0], "joints": [0, -0.785, 0, -2.356, 0, 1.571, 0.785]}


@pytest.fixture(scope="module")
def scene():
    """Two boxes with a grasp each."""
    return boxes_seen([box((0.05, 0.04, 0.10)), box((0.05, 0.04, 0.06), x=0.27)], grasped=(0, 1))


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    return Arm.load(arm_file(tmp_path_factory.mktemp("arm")))


@pytest.fixture(scope="module")
def predictor(scene):
    return HeldUpPredictor(scene)


@pytest.fixture(scope="module")
def web(predictor, arm):
    """A client of a service with an arm and a camera on it, which sees the two boxes in everything."""
    bench = PickBench(arm, HandEye.from_dict(ON_THE_ARM))
    with running(predictor, bench=bench) as (url, _, _), httpx.Client(base_url=url, timeout=60.0) as client:
        yield client


def post(client: httpx.Client, body: bytes = BODY, kind: str = NPZ, **query) -> httpx.Response:
    query = {"drop": ",".join(map(str, DROP)), **query}
    return client.post("/pick", content=body, params=query, headers={"Content-Type": kind})


def without_times(plan: dict) -> dict:
    return {name: value for name, value in plan.items() if name != "timings_ms"}


def test_the_answer_is_the_plan_that_plan_pick_makes(web, scene, arm):
    answer = post(web, instance=1)
    assert answer.status_code == 200, answer.text
    told = answer.json()
    expected = plan_pick(scene.of_instance(1), arm, T_BASE_FRAME, np.array(DROP) + T_BASE_FRAME[:3, 3])
    assert expected.is_found
    assert without_times(told["plan"]) == json.loads(json.dumps(without_times(expected.to_dict())))
    assert told["plan"]["instance_id"] == told["picked"]["instance_id"] == 1
    np.testing.assert_allclose(T_BASE_FRAME @ told["picked"]["pose"], told["plan"]["T_base_grasp"], atol=1e-9)
    assert told["prediction"]["grasps"] == 1
    assert len(told["prediction"]["objects"]) == 2
    assert told["service"]["waited_ms"] >= 0


def test_no_plan_is_an_answer_with_the_reasons(web, scene):
    grasps = scene.grasps
    turned = grasps.poses @ np.diag([1.0, -1.0, -1.0, 1.0])  # from below, through the table
    below = HeldUpPredictor(boxes_seen([box((0.05, 0.04, 0.10))]))
    object.__setattr__(below.prediction.grasps, "poses", turned[:1])
    with running(below, bench=PickBench(Arm.load())) as (url, _, _):
        told = Client(url).pick(DEPTH, INTRINSICS, (0.3, 0.3, 0.4), camera_pose=POSE)
    assert told.is_found is False
    assert told.T_base_grasp is None
    assert told.result["picked"] is None
    assert sum(told.refused.values()) == 1


def test_a_class_without_an_object_gives_no_plan(web):
    told = post(web, object_class="bottle").json()
    assert told["plan"]["phases"] == []
    assert told["prediction"]["grasps"] == 0


def test_the_camera_is_where_the_request_or_else_the_hand_eye_file_says(web, predictor, arm):
    calls = len(predictor.poses)
    npz_without = npz(depth=DEPTH, K=INTRINSICS)
    joints = [0.1, -0.7, 0.1, -2.2, 0.1, 1.5, 0.7]
    # Of objects without grasps: no plan has to be made.
    assert post(web, object_class="bottle").status_code == 200
    assert post(web, npz_without, object_class="bottle").status_code == 200
    assert post(web, npz_without, object_class="bottle", joints=",".join(map(str, joints))).status_code == 200
    given, from_file, moved = predictor.poses[calls:]
    np.testing.assert_array_equal(given, POSE)
    for pose, at in ((from_file, ON_THE_ARM["joints"]), (moved, joints)):
        hand_eye = HandEye.from_dict(ON_THE_ARM | {"joints": at})
        np.testing.assert_allclose(pose, arm.description.T_world_base @ hand_eye.pose(arm), atol=1e-12)


def test_pngs_and_json_are_taken_as_for_a_prediction(web):
    pose = ",".join(map(repr, POSE.ravel().tolist()))
    intrinsics = {"intrinsics": "135,135,80,60", "depth_scale": 1000, "camera_pose": pose}
    assert post(web, depth_png(), PNG, **intrinsics).json()["plan"]["phases"]
    body = {"depth": base64.b64encode(depth_png()).decode(), "release": "place", "drop": [-0.05, 0.5, 0.05]}
    content = json.dumps(body).encode()
    answer = web.post("/pick", content=content, params=intrinsics, headers={"Content-Type": JSON})
    assert [phase["name"] for phase in answer.json()["plan"]["phases"]][-2:] == ["leave", "return"]


@pytest.mark.parametrize(
    ("body", "query", "said"),
    [
        (BODY, {"drop": ""}, "drop must be numbers separated by commas, got ''"),
        (BODY, {"drop": "1,2"}, "drop must have shape (3,), got (2,)"),
        (BODY, {"drop": "nan,0,0"}, "drop must be finite"),
        (BODY, {"drop": "0.1,0.4,0"}, "drop must be above the support, but it is 0.050 m below it"),
        (BODY, {"drop": "0.1,9,0.2"}, "drop is"),
        (BODY, {"instance": 7}, "no object 7"),
        (BODY, {"object_class": "unicorn"}, "unicorn"),
        (BODY, {"start": "0,0,0"}, "start must have shape (7,), got (3,)"),
        (BODY, {"start": "9,0,0,0,0,0,0"}, "start: fr3_joint1 must be between"),
        (BODY, {"joints": "0,0,0,-1,0,1,0"}, "joints does not go with camera_pose"),
        (npz(depth=DEPTH, K=INTRINSICS), {"joints": "0,0,0,9,0,1,0"}, "joints: fr3_joint4 must be between"),
        (BODY, {"release": "throw"}, "release must be one of drop, place, got 'throw'"),
        (BODY, {"limit": 3}, "no option 'limit'; the options are drop, joints, start, release, intrinsics"),
        (BODY, {"answer": "npz"}, "no option 'answer'"),
        (BODY, {"arm": "fr3"}, "no option 'arm'"),
        (npz(points=np.ones((200, 3))), {}, "a pick needs a depth image, got a cloud"),
        (npz(depth=DEPTH), {}, "a depth image needs intrinsics"),
    ],
)
def test_refusals_are_one_line(web, body, query, said):
    answer = post(web, body, **query)
    assert answer.status_code == 422
    assert set(answer.json()) == {"error"}
    assert said in answer.json()["error"]
    assert "\n" not in answer.json()["error"]


def test_a_pick_needs_a_drop_off_point(web):
    answer = web.post("/pick", content=BODY, headers={"Content-Type": NPZ})
    assert (answer.status_code, answer.json()["error"]) == (
        422,
        "a pick needs drop: x,y,z of the drop-off point in the world [m]",
    )


def test_somebody_must_say_where_the_camera_is_and_only_one(scene, arm):
    beside = HandEye.from_dict({"T_base_camera": [0.5, 0, 0.7, 0, 1, 0, 0]})
    body = npz(depth=DEPTH, K=INTRINSICS)
    for hand_eye, query, said in (
        (None, {}, "a pick needs to know where the camera is: give camera_pose, or start the service with --hand-eye"),
        (beside, {"joints": "0,0,0,-1,0,1,0"}, "joints is for a camera on the arm, and that of this service stands"),
    ):
        bench = PickBench(arm, hand_eye)
        with (
            running(HeldUpPredictor(scene), bench=bench) as (url, _, _),
            httpx.Client(base_url=url, timeout=60.0) as client,
        ):
            answer = post(client, body, **query)
        assert answer.status_code == 422
        assert said in answer.json()["error"]


def test_joints_that_are_not_this_arms_are_refused_at_the_start(arm):
    with pytest.raises(InputError, match=re.escape("joints must have shape (7,), got (6,)")):
        PickBench(arm, HandEye.from_dict(ON_THE_ARM | {"joints": [0.0] * 6}))


def test_without_an_arm_it_says_how_to_get_one():
    with running(HeldUpPredictor()) as (url, _, _), httpx.Client(base_url=url, timeout=60.0) as client:
        answer = post(client)
        assert (answer.status_code, answer.json()) == (
            404,
            {"error": "this service has no arm: it must be started with icgnet serve --arm"},
        )
        assert client.get("/metadata").json()["arm"] is None
        with Client(url) as other, pytest.raises(ServiceError, match="answers 404: this service has no arm"):
            other.pick(DEPTH, INTRINSICS, DROP, camera_pose=POSE)


def test_metadata_and_openapi_tell_of_the_arm(web, arm):
    told = web.get("/metadata").json()["arm"]
    assert told["joint_names"] == list(arm.joint_names)
    assert told["camera"] == "on the arm"
    np.testing.assert_array_equal(told["T_world_base"], arm.description.T_world_base)
    described = web.get("/openapi.json").json()["paths"]["/pick"]["post"]
    assert [each["name"] for each in described["parameters"]] == list(PICK_OPTIONS)
    assert "points" not in described["requestBody"]["content"][JSON]["schema"]["properties"]
    assert {"200", "401", "404", "413", "422", "429", "503", "504"} <= set(described["responses"])


def test_the_token_the_limits_and_the_queue_are_those_of_predictions(scene, arm):
    predictor = HeldUpPredictor(scene)
    headers = {"Authorization": f"Bearer {TOKEN}"}
    bench = PickBench(arm)
    with running(predictor, TOKEN, bench, queue=0, max_megabytes=0.2, max_points=30_000) as (url, _, _):
        with httpx.Client(base_url=url, timeout=60.0) as unknown:
            assert post(unknown).status_code == 401
        with httpx.Client(base_url=url, headers=headers, timeout=60.0) as client:
            assert post(client, bytes(200_001)).status_code == 413
            assert post(client, kind="text/plain").status_code == 415
            large = png(np.ones((200, 200), np.uint16))
            assert "at most 30000 pixels" in post(client, large, PNG, intrinsics="1,1,1,1").json()["error"]
            predictor.may_end.clear()
            answers: list[httpx.Response] = []
            caller = threading.Thread(target=lambda: answers.append(post(client)))
            caller.start()
            assert predictor.begun.acquire(timeout=30)
            full = httpx.post(f"{url}/pick", content=BODY, headers=headers | {"Content-Type": NPZ})
            assert (full.status_code, int(full.headers["Retry-After"]) >= 1) == (429, True)
            predictor.may_end.set()
            caller.join()
            assert answers[0].status_code == 200
            page = client.get("/metrics").text
    assert "icgnet_plans_total 1.0" in page
    assert "icgnet_planning_seconds_count 1.0" in page
    assert 'icgnet_requests_total{route="/pick",status="200"} 1.0' in page


def test_the_deadline_is_the_budget_of_the_prediction_and_of_the_plan(scene, arm):
    predictor = HeldUpPredictor(scene)
    with (
        running(predictor, bench=PickBench(arm)) as (url, service, _),
        httpx.Client(base_url=url, timeout=60.0) as client,
    ):
        told = post(client, deadline_ms=60_000).json()
        assert told["plan"]["phases"]
        assert 50_000 < predictor.budgets[-1] < 60_000
        assert predictor.begun.acquire(timeout=30)  # that of the request above
        predictor.may_end.clear()
        answers: list[httpx.Response] = []
        first = threading.Thread(target=lambda: answers.append(post(client, object_class="bottle")))
        first.start()
        assert predictor.begun.acquire(timeout=30)
        late = threading.Thread(target=lambda: answers.append(post(client, deadline_ms=50)))
        late.start()
        wait_until(lambda: service.worker.taken == 2)
        time.sleep(0.06)
        predictor.may_end.set()
        first.join()
        late.join()
    assert sorted(each.status_code for each in answers) == [200, 504]


def test_when_the_time_is_up_no_further_grasp_is_tried(scene, arm):
    far = boxes_seen([box((0.05, 0.04, 0.10), x=3.0), box((0.05, 0.04, 0.06))], grasped=(0, 1))
    drop = np.array(DROP) + T_BASE_FRAME[:3, 3]
    assert plan_pick(far, arm, T_BASE_FRAME, drop).grasp == 1
    plan = plan_pick(far, arm, T_BASE_FRAME, drop, PickSettings(budget_ms=1.0))
    assert not plan.is_found
    assert [each.reason for each in plan.refusals][1:] == [NO_TIME]
    # The first one is tried however little time there is.
    assert plan_pick(scene, arm, T_BASE_FRAME, drop, PickSettings(budget_ms=1.0)).grasp == 0


def test_the_client_gives_the_plan(web, scene):
    with Client(str(web.base_url), timeout=60.0) as client:
        told = client.pick((1000 * DEPTH), INTRINSICS, DROP, POSE, instance=0, depth_scale=1000.0, release="drop")
        assert told.is_found
        assert told.T_base_grasp.shape == (4, 4)
        assert [phase["name"] for phase in told.phases][:4] == ["reach", "approach", "close", "lift"]
        with pytest.raises(InputError, match="drop must be numbers"):
            client.pick(DEPTH, INTRINSICS, [0.1, "a", 0.2], POSE)
