"""What an agent is answered, without the protocol between."""

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from arm_scenes import arm_file, box, boxes_seen
from http_service import DEPTH, POSE, HeldUpPredictor, known_prediction, running
from icgnet.agents.captures import CaptureFolder
from icgnet.agents.sight import NO_ARM, Bench, LocalSight, RemoteSight, Scene
from icgnet.agents.tools import Tools, plans_folder
from icgnet.client import Client, ServiceError
from icgnet.errors import DataError, InputError, MissingExtraError
from icgnet.geometry.transforms import quaternion_to_matrix
from icgnet.inference.prediction import Prediction
from tabletop_scenes import INTRINSICS


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder with two captures, and a file beside it that no agent may see."""
    inside = tmp_path / "captures"
    inside.mkdir()
    np.savez(inside / "first.npz", depth=DEPTH, K=INTRINSICS, camera_pose=POSE)
    np.savez(inside / "second.npz", depth=DEPTH, K=INTRINSICS, camera_pose=POSE)
    os.utime(inside / "first.npz", (1000, 1000))
    np.savez(tmp_path / "secret.npz", depth=DEPTH, K=INTRINSICS)
    return inside


@pytest.fixture
def predictor() -> HeldUpPredictor:
    return HeldUpPredictor()


@pytest.fixture
def tools(folder, predictor) -> Tools:
    return Tools(CaptureFolder(folder), LocalSight(predictor, Scene()))


def two_boxes() -> Prediction:
    """Two boxes with a grasp each, as seen in an image of the size of the captures."""
    prediction = boxes_seen([box((0.05, 0.04, 0.10)), box((0.05, 0.04, 0.06), x=0.27)], grasped=(0, 1))
    return replace(prediction, input_shape=DEPTH.shape)


def with_arm(folder: Path, plans: Path | None = None, **scene) -> Tools:
    """Tools that see two boxes in everything, before an arm."""
    pytest.importorskip("icgnet.arm.libraries", reason="needs icgnet[arm]", exc_type=MissingExtraError)
    from icgnet.arm.arm import Arm

    bench = Bench(Arm.load(arm_file(folder.parent)))
    return Tools(CaptureFolder(folder), LocalSight(HeldUpPredictor(two_boxes()), Scene(**scene), bench), plans)


def test_a_look_is_a_picture_in_which_every_object_has_its_colour(tools):
    look = tools.look()
    mask = known_prediction().instance_mask
    pixels = np.asarray(look.picture.resize(mask.shape[::-1], Image.Resampling.BOX)).astype(float)
    colourful = np.ptp(pixels, axis=2)
    # Labels cover a part of what is in the picture.
    assert np.median(colourful[mask >= 0]) > 20 > np.median(colourful[mask < 0])
    lines = look.table.splitlines()
    assert f"{len(known_prediction().objects)} objects, in the frame world [m]" in lines[0]
    assert lines[2].startswith(f"0  {known_prediction().class_of(0)} (")
    assert look.scene == tools.list_objects() | {"age_seconds": look.scene["age_seconds"]}


def test_objects_are_told_with_place_size_and_grasps(tools):
    told = tools.list_objects("first.npz")
    prediction = known_prediction()
    assert told["captures"] == ["second.npz", "first.npz"]
    assert told["age_seconds"] > 1e6
    assert told["classes"] == list(prediction.classes)
    for entry, item in zip(told["objects"], prediction.objects, strict=True):
        lower, upper = item.points.min(axis=0), item.points.max(axis=0)
        np.testing.assert_allclose(entry["middle"], (lower + upper) / 2, atol=1e-4)
        np.testing.assert_allclose(entry["size"], upper - lower, atol=1e-4)
        assert entry["grasps"] == (prediction.grasps.instances == item.instance_id).sum()


def test_the_newest_capture_is_looked_at_and_a_new_file_is_found(tools, folder, predictor):
    assert tools.list_objects()["capture"] == "second.npz"
    np.savez(folder / "third.npz", depth=DEPTH, K=INTRINSICS, camera_pose=POSE)
    os.utime(folder / "third.npz", (4e9, 4e9))
    assert tools.list_objects()["capture"] == "third.npz"
    assert len(predictor.poses) == 2
    tools.grasp("third.npz")
    assert len(predictor.poses) == 2  # remembered
    os.utime(folder / "third.npz", (4e9 + 1, 4e9 + 1))
    tools.grasp("third.npz")
    assert len(predictor.poses) == 3  # it has changed


def test_grasps_are_told_best_first_and_by_object(tools):
    prediction = known_prediction()
    told = tools.grasp(limit=2)
    assert told["found"] == len(prediction.grasps)
    assert [entry["score"] for entry in told["grasps"]] == pytest.approx(
        prediction.grasps.scores[:2].tolist(), abs=1e-4
    )
    pose = np.array(told["grasps"][0]["pose"])
    np.testing.assert_array_equal(pose, prediction.grasps.poses[0])
    np.testing.assert_allclose(
        quaternion_to_matrix(np.array(told["grasps"][0]["quaternion_wxyz"])), pose[:3, :3], atol=1e-5
    )
    np.testing.assert_allclose(told["grasps"][0]["approach"], pose[:3, 2], atol=1e-5)
    number = int(prediction.grasps.instances[0])
    name = prediction.class_of(number)
    assert tools.grasp(instance_id=number)["found"] == len(prediction.of_instance(number).grasps)
    assert tools.grasp(object_class=name)["found"] == len(prediction.of_class(name).grasps)


def test_why_there_is_no_grasp_is_told_of_the_objects_that_were_asked_for(tools):
    found = known_prediction()
    assert tools.grasp()["rejected"] == found.rejected
    for item in found.objects:
        assert tools.grasp(instance_id=item.instance_id)["rejected"] == found.rejections.of_object(item.instance_id)
    name = found.objects[0].class_name
    of_class = [found.rejections.of_object(item.instance_id) for item in found.objects if item.class_name == name]
    assert tools.grasp(object_class=name)["rejected"]["low_score"] == sum(each["low_score"] for each in of_class)


def test_a_capture_that_the_camera_takes_away_meanwhile_is_no_fault(folder, monkeypatch):
    captures, is_inside = CaptureFolder(folder), CaptureFolder._is_inside

    def inside(self, path: Path) -> bool:
        known = is_inside(self, path)
        if path.name == "second.npz":
            path.unlink()
        return known

    monkeypatch.setattr(CaptureFolder, "_is_inside", inside)
    assert captures.names() == ["first.npz"]
    monkeypatch.setattr(captures, "_path", lambda name: captures._folder / "second.npz")
    with pytest.raises(DataError, match=r"^capture second\.npz is gone or cannot be read"):
        captures.read()


@pytest.mark.parametrize(
    "name",
    ["../secret.npz", "/etc/hostname", "link.npz", "linked/secret.npz", "none.npz", "", ".", "a\0b.npz", "x" * 5000],
)
def test_nothing_outside_of_the_folder_is_opened(tools, folder, name):
    (folder / "link.npz").symlink_to(folder.parent / "secret.npz")
    (folder / "linked").symlink_to(folder.parent, target_is_directory=True)
    with pytest.raises(InputError, match=r"no capture .*; the captures are second\.npz, first\.npz") as caught:
        tools.look(name)
    assert str(folder) not in str(caught.value)


def test_links_within_the_folder_and_folders_in_it_are_fine(tools, folder):
    (folder / "deep").mkdir()
    (folder / "first.npz").rename(folder / "deep" / "first.npz")
    (folder / "again.npz").symlink_to(folder / "second.npz")
    assert tools.list_objects("deep/first.npz")["capture"] == "deep/first.npz"
    assert tools.list_objects("again.npz")["capture"] == "again.npz"


def test_broken_captures_are_one_line_that_does_not_say_where_they_are(tools, folder):
    (folder / "broken.npz").write_bytes(b"PK nothing")
    np.savez(folder / "cloud.npz", points=np.ones((200, 3)))
    (folder / "bare.npy").write_bytes((folder / "first.npz").read_bytes())
    Image.fromarray(np.ones((40, 40), np.uint16)).save(folder / "image.png")
    for name, kind, said in (
        ("broken.npz", DataError, "cannot read broken.npz"),
        ("cloud.npz", InputError, "cloud.npz is a cloud"),
        ("bare.npy", DataError, "cannot read bare.npy"),
        ("image.png", InputError, "image.png is a depth image without camera matrix"),
    ):
        with pytest.raises(kind, match=said) as caught:
            tools.list_objects(name)
        assert str(folder) not in str(caught.value)


def test_an_empty_folder_says_what_belongs_there(tmp_path):
    with pytest.raises(InputError, match=r"the folder of captures holds none; kinds that are read: \.png, \.tif"):
        Tools(CaptureFolder(tmp_path), LocalSight(HeldUpPredictor(), Scene())).look()
    with pytest.raises(InputError, match="no such folder of captures"):
        CaptureFolder(tmp_path / "none")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"object_class": "unicorn"}, "no class 'unicorn'; the classes are "),
        ({"instance_id": 99}, "no object 99: the scene has"),
        ({"instance_id": -1}, "no object -1: the scene has"),
        ({"limit": 0}, "limit must be at least 1 and at most 50, got 0"),
        ({"limit": 51}, "limit must be at least 1 and at most 50, got 51"),
    ],
)
def test_wishes_that_cannot_be_met_are_one_line(tools, arguments, said):
    with pytest.raises(InputError, match=said):
        tools.grasp(**arguments)


def test_a_pick_is_a_plan_and_nothing_is_written(folder, tmp_path):
    before = sorted(tmp_path.rglob("*"))
    tools = with_arm(folder)
    told = tools.pick([-0.05, 0.5, 0.2], instance_id=1)
    assert (told["moved"], told["found"], told["instance_id"], told["saved"]) == (False, True, 1, None)
    assert [phase["name"] for phase in told["phases"]][:4] == ["reach", "approach", "close", "lift"]
    assert told["phases"][0]["last_joints"] == pytest.approx(told["phases"][1]["first_joints"])
    assert sum(phase["duration"] for phase in told["phases"]) == pytest.approx(told["duration"])
    assert len(json.dumps(told)) < 8000
    assert sorted(set(tmp_path.rglob("*")) - set(before)) == [tmp_path / "arm.yaml"]  # by this test
    assert tools.pick([-0.05, 0.5, 0.05], release="place")["phases"][-2]["name"] == "leave"


def test_plans_are_written_if_that_was_said_at_the_start(folder, tmp_path):
    tools = with_arm(folder, plans_folder(tmp_path / "plans"))
    assert tools.writes
    (tmp_path / "plans" / "plan-0001.json").write_text("an earlier one")
    assert tools.pick([-0.05, 0.5, 0.2])["saved"] == "plan-0002.json"
    assert tools.pick([-0.05, 0.5, 0.2], object_class="bottle")["saved"] is None  # there is no bottle
    plan = json.loads((tmp_path / "plans" / "plan-0002.json").read_text())
    assert plan["format"] == "icgnet pick 1"
    assert len(plan["phases"][0]["joint_trajectory"]["points"]) > 5
    assert (tmp_path / "plans" / "plan-0001.json").read_text() == "an earlier one"
    with pytest.raises(InputError, match="plans cannot be written to"):
        plans_folder(tmp_path / "plans" / "plan-0001.json")


@pytest.mark.parametrize(
    ("drop", "release", "said"),
    [
        ([0.1, 0.2], None, r"drop must have shape \(3,\), got \(2,\)"),
        ([0.1, float("nan"), 0.2], None, "drop must be finite"),
        ([0.1, 0.4, 0.0], None, "drop must be above the support"),
        ([0.1, 0.4, 0.2], "throw", "release must be one of drop, place, got 'throw'"),
    ],
)
def test_a_pick_that_cannot_be_is_one_line(folder, drop, release, said):
    with pytest.raises(InputError, match=said):
        with_arm(folder).pick(drop, release=release)


def test_a_pick_needs_an_arm_and_the_place_of_the_camera(tools, folder):
    with pytest.raises(InputError, match=NO_ARM):
        tools.pick([0.1, 0.4, 0.2])
    np.savez(folder / "first.npz", depth=DEPTH, K=INTRINSICS)
    with pytest.raises(InputError, match="a pick needs to know where the camera is"):
        with_arm(folder).pick([0.1, 0.4, 0.2], "first.npz")


def test_the_camera_stands_where_the_capture_or_else_the_start_says(folder, predictor):
    np.savez(folder / "first.npz", depth=DEPTH, K=INTRINSICS)
    other = POSE.copy()
    other[:3, 3] += 0.01
    tools = Tools(CaptureFolder(folder), LocalSight(predictor, Scene(0.05, "base"), camera_pose=other))
    tools.look("first.npz")
    tools.look("second.npz")
    np.testing.assert_array_equal(predictor.poses, [other, POSE])


def test_a_service_answers_in_place_of_a_network(folder, predictor, tools):
    with running(predictor) as (url, _, _), Client(url) as client:
        remote = Tools(CaptureFolder(folder), RemoteSight(client, Scene()))
        for question in (Tools.list_objects, Tools.grasp):
            here, there = question(tools), question(remote)
            assert {**there, "age_seconds": 0} == {**json.loads(json.dumps(here)), "age_seconds": 0}
        assert np.array_equal(np.asarray(remote.look().picture), np.asarray(tools.look().picture))
        with pytest.raises(ServiceError, match="answers 404: this service has no arm"):
            remote.pick([0.1, 0.4, 0.2])
        np.savez(folder / "first.npz", depth=DEPTH, K=INTRINSICS)
        with pytest.raises(InputError, match="instance_id needs camera_pose"):
            remote.pick([0.1, 0.4, 0.2], "first.npz", instance_id=0)


def test_the_arm_of_a_service_plans(folder):
    here = with_arm(folder)
    from icgnet.arm.arm import Arm
    from icgnet.service.picking import PickBench

    bench = PickBench(Arm.load(folder.parent / "arm.yaml"))
    with running(HeldUpPredictor(two_boxes()), bench=bench) as (url, _, _), Client(url, timeout=60.0) as client:
        there = Tools(CaptureFolder(folder), RemoteSight(client, Scene()))
        assert there.pick([-0.05, 0.5, 0.2], instance_id=1) == here.pick([-0.05, 0.5, 0.2], instance_id=1)
