"""The node answers another process over DDS on this machine, and what is wrong with an image is one line."""

import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cyclonedds", reason="needs icgnet[ros2]")

from http_service import HeldUpPredictor, known_prediction
from icgnet.errors import InputError
from icgnet.geometry.transforms import matrix_to_quaternion
from icgnet.grasping.gripper import load_gripper
from icgnet.ros2.bus import Bus, Reader, Writer, reliable, sensor_data
from icgnet.ros2.config import Ros2Config
from icgnet.ros2.messages import CameraInfo, CollisionObject, Empty, Header, Image, Time, TransformStamped
from icgnet.ros2.node import Node, hand_of
from tabletop_scenes import INTRINSICS

LOOPBACK = (
    "<CycloneDDS><Domain><General><Interfaces><NetworkInterface name='lo' multicast='false'/></Interfaces>"
    "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
    "<MaxAutoParticipantIndex>30</MaxAutoParticipantIndex>"
    "<Peers><Peer Address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>"
)
"""This machine only, without multicast; see the guide."""
PEER = Path(__file__).parents[1] / "ros2_peer.py"
DEPTH_SHAPE = (120, 160)


@pytest.fixture(scope="module")
def domain():
    """A domain of these tests alone, on loopback; skipped where nothing can be heard there."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CYCLONEDDS_URI", LOOPBACK)
        number = 100 + os.getpid() % 100
        try:
            bus = Bus(number)
        except InputError as error:
            pytest.skip(f"DDS cannot use loopback: {error}")
        reader = Reader(bus, "/heard", Empty, reliable())
        writer = Writer(Bus(number), "/heard", Empty, reliable())
        end = time.monotonic() + 30.0
        while not reader.take(print):
            if time.monotonic() > end:
                pytest.skip("DDS is not heard on loopback")
            writer.write(Empty())
            time.sleep(0.05)
        yield number


def depth_mm(seed: int = 0) -> np.ndarray:
    return np.full(DEPTH_SHAPE, 500 + seed, np.uint16)


def image(encoding: str = "16UC1", pixels: np.ndarray | None = None, frame_id: str = "optical", sec: int = 7) -> Image:
    pixels = depth_mm() if pixels is None else pixels
    height, width = pixels.shape
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel().tolist()
    return Image(Header(Time(sec, 8), frame_id), height, width, encoding, 0, pixels.itemsize * width, data)


def info(**fields) -> CameraInfo:
    height, width = DEPTH_SHAPE
    return CameraInfo(**{"height": height, "width": width, "k": INTRINSICS.ravel().tolist()} | fields)


class Lines:
    """A node with a predictor that knows one answer, and the lines that it says."""

    def __init__(self, domain: int, clock=time.monotonic, **config):
        self.said, self.complaints, self.predictor = [], [], HeldUpPredictor()
        config = Ros2Config(domain=domain, **config)
        self.node = Node(self.predictor, config, self.said.append, self.complaints.append, clock)


@pytest.fixture
def lines(domain):
    return Lines(domain)


@pytest.mark.parametrize(
    ("picture", "camera", "said"),
    [
        (image(), None, "no answer: no camera info on /camera/depth/camera_info yet"),
        (image("rgb8"), info(), "no answer: encoding 'rgb8' of the image is no depth; known are 16UC1 and mono16"),
        (image(), info(k=[0.0] * 9), "no answer: K of the camera info is zero: the camera is not calibrated"),
        (image(), info(width=320), "no answer: the camera info is for 320 x 120 pixels, the image has 160 x 120"),
    ],
)
def test_a_bad_image_is_one_line_and_the_next_is_answered(lines, picture, camera, said):
    lines.node._info = camera
    assert not lines.node._answer(picture)
    assert len(lines.complaints) == 1
    assert lines.complaints[0].startswith(said)
    lines.node._info = info()
    assert lines.node._answer(image())
    assert len(lines.said) == 1
    assert "in 'optical'" in lines.said[0]


def test_a_world_that_is_not_known_is_one_line_until_it_is(domain):
    lines = Lines(domain, world="base")
    lines.node._info = info()
    assert not lines.node._answer(image())
    lines.node._frames.add([TransformStamped(Header(Time(), "map"), "odom")], is_fixed=True)
    assert not lines.node._answer(image())
    assert lines.complaints == [
        "no answer: no transform from 'optical' to 'base': 'base' and 'optical' not known; frames of /tf are none yet",
        "no answer: no transform from 'optical' to 'base': 'base' and 'optical' not known; frames of /tf are map, odom",
    ]
    lines.node._frames.add([TransformStamped(Header(Time(), "base"), "optical")], is_fixed=True)
    assert lines.node._answer(image())
    assert "in 'base'" in lines.said[0]


def test_the_same_complaint_comes_every_ten_seconds(domain):
    now = [0.0]
    lines = Lines(domain, clock=lambda: now[0])
    for now[0] in range(25):
        lines.node.complain("a line")
    lines.node.complain("another\nline")
    assert lines.complaints == ["a line"] * 3 + ["another line"]


def test_that_no_image_comes_is_said(domain):
    now = [0.0]
    lines = Lines(domain, clock=lambda: now[0])
    writer = Writer(Bus(domain), "/camera/depth/image_rect_raw", Image, sensor_data())
    end = time.monotonic() + 60.0
    while lines.node._images.writers < 1 and time.monotonic() < end:
        time.sleep(0.02)
    for now[0] in (5.0, 9.9):
        lines.node.step()
    assert lines.complaints == []
    now[0] = 10.0
    lines.node.step()
    assert lines.complaints[0].startswith("no image on /camera/depth/image_rect_raw in 10 s, where 1 publish: compare")
    while len(lines.complaints) < 2 and time.monotonic() < end:
        writer.write(image())
        lines.node._bus.wait(0.2)
        lines.node.step()
    assert lines.complaints[1].startswith("no answer: no camera info")
    now[0] = 15.0
    lines.node.step()
    assert len(lines.complaints) == 2


@pytest.mark.parametrize("error", [InputError("no plane"), RuntimeError("a fault")])
def test_neither_bad_values_nor_a_fault_end_the_node(lines, error):
    lines.node._info = info()
    lines.predictor.error = error
    assert not lines.node._answer(image())
    assert str(error) in lines.complaints[0]
    lines.predictor.error = None
    assert lines.node._answer(image())


def test_objects_that_are_gone_are_taken_out_of_the_scene(domain, lines):
    reader = Reader(Bus(domain), "/icgnet/collision_objects", CollisionObject, reliable(1000))
    header, found = Header(Time(3, 4), "optical"), known_prediction()
    operations: dict[str, list[int]] = {}
    end = time.monotonic() + 60.0
    while len(operations) < len(found.objects) and time.monotonic() < end:  # until the two have found each other
        lines.node._publish(found, header)
        time.sleep(0.1)
        for each in reader.take(print):
            operations.setdefault(each.id, []).append(each.operation)
    assert sorted(operations) == [f"icgnet_{item.instance_id}" for item in found.objects]
    lines.node._publish(replace(found, objects=(), grasps=found.grasps.empty()), header)
    while any(known[-1] != 1 for known in operations.values()) and time.monotonic() < end:
        for each in reader.take(print):
            operations[each.id].append(each.operation)
        time.sleep(0.05)
    assert all(known[-1] == 1 and set(known[:-1]) == {0} for known in operations.values())


def test_shapes_that_nobody_wants_are_not_made(domain, lines):
    def extract():
        raise AssertionError("made for nobody")

    found = known_prediction()
    objects = tuple(replace(item, extract=extract) for item in found.objects)
    lines.node._publish(replace(found, objects=objects), Header(Time(3, 4), "optical"))
    assert len(lines.said) == 1


def test_a_hand_is_franka_or_described():
    franka, other = load_gripper("franka"), load_gripper("robotiq_2f_85")
    assert hand_of(Ros2Config(), franka).frame == "panda_hand"
    assert hand_of(Ros2Config(), other) is None
    told = hand_of(Ros2Config(hand_frame="tool0", joints=("knuckle",)), other)
    np.testing.assert_array_equal(told.T_base_parent, np.eye(4))
    with pytest.raises(InputError, match="needs both hand_frame and joints"):
        hand_of(Ros2Config(joints=("knuckle",)), other)
    with pytest.raises(InputError, match="mount"):
        hand_of(Ros2Config(mount=(0.0, 0.0, 0.0, 9.0, 0.0, 0.0, 0.0)), franka)


@pytest.mark.parametrize(
    ("config", "said"),
    [
        ({"image": "/camera depth"}, "image must be a name of letters, digits, _ and / such as /camera/depth, got"),
        ({"domain": 233}, "domain must be at least 0 and at most 232, got 233"),
        ({"limit": 0}, "limit must be at least 1"),
        ({"world": " "}, "world must be the name of a frame"),
        ({"mount": (1.0, 2.0)}, "mount takes 7 numbers, x y z qw qx qy qz, got 2"),
    ],
)
def test_settings_that_are_out_of_range_are_one_line(config, said):
    with pytest.raises(InputError, match=said):
        Ros2Config(**config)


def test_the_domain_is_that_of_ros(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "17")
    assert (Ros2Config().domain_id(), Ros2Config(domain=3).domain_id()) == (17, 3)
    monkeypatch.setenv("ROS_DOMAIN_ID", "")
    assert Ros2Config().domain_id() == 0
    monkeypatch.setenv("ROS_DOMAIN_ID", "one")
    with pytest.raises(InputError, match="ROS_DOMAIN_ID must be a number from 0 to 232, got 'one'"):
        Ros2Config().domain_id()


def heard(domain: int, tmp_path: Path, seconds: float = 200.0, **scene) -> dict:
    """What another process hears that sends a scene."""
    np.savez(tmp_path / "scene.npz", **scene)
    command = [sys.executable, str(PEER), str(domain), str(tmp_path / "scene.npz"), str(seconds)]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=seconds + 200).stdout
    return json.loads(said)


def running(node: Node) -> threading.Event:
    stop = threading.Event()
    threading.Thread(target=node.run, args=(stop,), daemon=True).start()
    return stop


@pytest.mark.slow
def test_another_process_hears_everything_with_stamp_and_frame_of_its_image(domain, tmp_path):
    lines = Lines(domain, limit=5)
    stop = running(lines.node)
    try:
        got = heard(domain, tmp_path, pixels=depth_mm(), encoding="16UC1", K=INTRINSICS)
    finally:
        stop.set()
    found, first = known_prediction(), got["poses"][0]
    assert first["header"]["frame_id"] == "optical"
    stamp = first["header"]["stamp"]
    assert stamp["sec"] > 1000
    assert stamp["nanosec"] == 5
    assert len(first["poses"]) == 5
    for pose, expected in zip(first["poses"], found.grasps.poses, strict=False):
        np.testing.assert_allclose([pose["position"][axis] for axis in "xyz"], expected[:3, 3], atol=1e-9)
        quaternion = [pose["orientation"][axis] for axis in "wxyz"]
        np.testing.assert_allclose(quaternion, matrix_to_quaternion(expected[:3, :3]), atol=1e-9)
    of_first = [each for each in got["grasps"] if each["grasp_pose"]["header"]["stamp"] == stamp]
    assert [each["id"].split("_")[1] for each in of_first] == ["0", "1", "2", "3", "4"]
    assert of_first[0]["grasp_quality"] == pytest.approx(found.grasps.scores[0])
    assert of_first[0]["pre_grasp_approach"]["direction"]["header"]["frame_id"] == "panda_hand"
    assert len(of_first[0]["grasp_posture"]["points"][0]["positions"]) == 2
    names = [f"icgnet_{item.instance_id}" for item in found.objects]
    assert [each["id"] for each in got["detections"][0]["detections"]] == names
    assert {each["id"] for each in got["collision_objects"]} == set(names)
    box = got["collision_objects"][0]["meshes"][0]
    assert (len(box["triangles"]), len(box["vertices"])) == (12, 8)
    assert got["markers"][0]["markers"][0]["action"] == 3
    assert not lines.complaints or lines.complaints == ["no answer: no camera info on /camera/depth/camera_info yet"]


@pytest.mark.slow
def test_a_trigger_asks_for_one_image(domain, tmp_path):
    lines = Lines(domain, trigger="/look")
    stop = running(lines.node)
    try:
        heard(domain, tmp_path, seconds=1.0, pixels=depth_mm(), encoding="16UC1", K=INTRINSICS)
        assert lines.said == []
        got = heard(domain, tmp_path, pixels=depth_mm(), encoding="16UC1", K=INTRINSICS, is_triggering=True)
    finally:
        stop.set()
    assert got["poses"]
    assert lines.said


@pytest.mark.slow
def test_the_command_finds_grasps_in_the_demo_in_the_frame_that_tf_names(domain, tmp_path):
    from icgnet.cli.demo import FOLDER

    with np.load(FOLDER / "demo.npz") as capture:
        depth, K, pose = capture["depth"], capture["K"], capture["camera_pose"]
    words = ["ros2", "--world", "base", "--threads", "1", "--domain", str(domain), "--limit", "10"]
    node = subprocess.Popen(
        [sys.executable, "-m", "icgnet.cli.main", *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        assert "answering every image of /camera/depth/image_rect_raw" in node.stdout.readline()
        scene = {"position": pose[:3, 3], "quaternion": matrix_to_quaternion(pose[:3, :3])}
        got = heard(domain, tmp_path, 500.0, pixels=depth.astype(np.float32), encoding="32FC1", K=K, **scene)
    finally:
        node.terminate()
        _, errors = node.communicate(timeout=200)
    assert node.returncode == 0
    assert errors.splitlines()[-1] == "stopped"
    assert "Traceback" not in errors
    first = got["poses"][0]
    assert first["header"]["frame_id"] == "base"
    assert len(first["poses"]) == 10
    heights = [each["position"]["z"] for each in first["poses"]]
    assert min(heights) > 0.0
    assert max(heights) < 0.5
    found = got["detections"][0]["detections"]
    assert len(found) >= 3
    assert all(0.005 < each["bbox"]["size"]["z"] < 0.4 for each in found)
    assert all(len(each["meshes"][0]["triangles"]) > 100 for each in got["collision_objects"])
