"""The node for robots that have ROS, with a fake rclpy and a service that answers one thing."""

import importlib.util
import io
import sys
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import httpx
import numpy as np
import pytest

from icgnet import client as client_module
from icgnet.geometry.transforms import make_transform, quaternion_to_matrix, random_rotation

PACKAGE = Path(__file__).parents[1] / "ros2" / "icgnet_ros"
K = [600.0, 0.0, 2.0, 0.0, 600.0, 1.0, 0.0, 0.0, 1.0]


class Message(SimpleNamespace):
    """Any message: it holds what it is given, and a header."""

    def __init__(self, **fields):
        super().__init__(**{"header": SimpleNamespace(stamp=None, frame_id="")} | fields)


class FakeNode:
    """What the node asks of rclpy.node.Node, and what it did."""

    parameters: ClassVar[dict] = {}

    def __init__(self, name):
        self.name, self.subscriptions, self.published, self.warnings = name, {}, {}, []

    def declare_parameter(self, name, default):
        return SimpleNamespace(value=self.parameters.get(name, default))

    def create_subscription(self, kind, topic, callback, qos):
        self.subscriptions[topic] = (kind, callback, qos)

    def create_publisher(self, kind, topic, qos):
        sent = self.published.setdefault(topic, [])
        return SimpleNamespace(publish=sent.append)

    def get_logger(self):
        return SimpleNamespace(warning=lambda line, throttle_duration_sec: self.warnings.append(line))

    def destroy_node(self):
        pass


class FakeBuffer:
    """A tf2 buffer that knows one transform."""

    def lookup_transform(self, target, source, time, timeout):
        assert (target, source, time) == ("base", "optical", "then")
        move, turn = SimpleNamespace(x=1.0, y=2.0, z=3.0), SimpleNamespace(w=1.0, x=0.0, y=0.0, z=0.0)
        return SimpleNamespace(transform=SimpleNamespace(translation=move, rotation=turn))


def fake(name: str, **content) -> ModuleType:
    module = ModuleType(name)
    vars(module).update(content)
    return module


@pytest.fixture
def node_module(monkeypatch):
    """The module of the node, loaded with what it imports of ROS replaced."""
    kinds = {
        "geometry_msgs": ("Point", "Pose", "PoseArray", "Quaternion"),
        "sensor_msgs": ("CameraInfo", "Image"),
        "std_msgs": ("Float32MultiArray",),
    }
    modules = {
        "rclpy": fake("rclpy"),
        "rclpy.node": fake("rclpy.node", Node=FakeNode),
        "rclpy.executors": fake("rclpy.executors", ExternalShutdownException=type("Shutdown", (Exception,), {})),
        "rclpy.duration": fake("rclpy.duration", Duration=lambda seconds: seconds),
        "rclpy.qos": fake("rclpy.qos", qos_profile_sensor_data=SimpleNamespace(depth=5)),
        "tf2_ros": fake("tf2_ros", Buffer=FakeBuffer, TransformListener=lambda *_, **__: None),
    }
    for package, names in kinds.items():
        modules[package] = fake(package)
        content = {name: type(name, (Message,), {}) for name in names}
        modules[f"{package}.msg"] = fake(f"{package}.msg", **content)
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("icgnet_ros_node", PACKAGE / "icgnet_ros" / "node.py")
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


def poses() -> list[np.ndarray]:
    rng = np.random.default_rng(3)
    return [make_transform(random_rotation(rng), rng.normal(size=3)) for _ in range(20)]


@pytest.fixture
def started(node_module, monkeypatch):
    """Starts the node with parameters; requests of its client are noted, and answered with grasps."""
    asked = []

    def answer(request: httpx.Request) -> httpx.Response:
        asked.append(request)
        grasps = [{"pose": pose.tolist(), "score": 0.9 - 0.01 * index} for index, pose in enumerate(poses())]
        return httpx.Response(200, json={"grasps": grasps, "objects": [], "frame_id": "camera"})

    def client(*arguments, **named):
        return client_module.Client(*arguments, **named, transport=httpx.MockTransport(answer))

    monkeypatch.setattr(node_module, "Client", client)

    def start(**parameters):
        monkeypatch.setattr(FakeNode, "parameters", parameters)
        return node_module.Grasping(), asked

    return start


def image(encoding="16UC1", **fields) -> Message:
    pixels = (np.arange(12).reshape(3, 4) + 500).astype("<u2" if encoding != "32FC1" else "<f4")
    header = SimpleNamespace(stamp="then", frame_id="optical")
    content = {"data": pixels.tobytes(), "step": 4 * pixels.itemsize, "height": 3, "width": 4, "is_bigendian": 0}
    return Message(**content | {"encoding": encoding, "header": header} | fields)


def info(**fields) -> Message:
    return Message(**{"k": K, "width": 4, "height": 3} | fields)


def sent_arrays(request: httpx.Request) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(request.content)) as saved:
        return dict(saved)


def test_an_image_becomes_poses_and_scores_with_its_stamp_and_frame(started):
    node, asked = started()
    node.on_info(info())
    node.on_image(image())
    (result,), (scores,) = node.published["~/poses"], node.published["~/scores"]
    assert (result.header.stamp, result.header.frame_id) == ("then", "optical")
    for found, expected in zip(result.poses, poses(), strict=True):
        at, turn = found.position, found.orientation
        matrix = quaternion_to_matrix(np.array([turn.w, turn.x, turn.y, turn.z]))
        np.testing.assert_allclose(make_transform(matrix, np.array([at.x, at.y, at.z])), expected, atol=1e-9)
    assert scores.data == pytest.approx([0.9 - 0.01 * index for index in range(20)])
    arrays = sent_arrays(asked[0])
    np.testing.assert_allclose(arrays["depth"], (np.arange(12).reshape(3, 4) + 500) / 1000, rtol=1e-6)
    assert "camera_pose" not in arrays
    assert asked[0].url.params["limit"] == "50"


def test_with_a_world_the_pose_of_the_camera_is_sent(started):
    node, asked = started(world="base")
    node.on_info(info())
    node.on_image(image("32FC1"))
    assert node.published["~/poses"][0].header.frame_id == "base"
    arrays = sent_arrays(asked[0])
    assert arrays["camera_pose"].tolist() == [1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]
    assert asked[0].url.params["frame_id"] == "base"


@pytest.mark.parametrize(
    ("camera", "picture", "said"),
    [
        (None, image(), "no answer: no camera_info yet"),
        (info(width=8), image(), "no answer: camera_info is for 8 x 3 pixels, the image has 4 x 3"),
        (info(), image("rgb8"), "no answer: encoding 'rgb8' is no depth; known are 16UC1, mono16, 32FC1"),
        (info(), image(data=b"12"), "no answer: cannot reshape array"),
    ],
)
def test_a_bad_image_is_one_line_and_the_next_is_answered(started, camera, picture, said):
    node, asked = started()
    node.info = camera
    node.on_image(picture)
    assert len(node.warnings) == 1
    assert node.warnings[0].startswith(said)
    assert not asked
    node.on_info(info())
    node.on_image(image())
    assert len(node.published["~/poses"]) == 1


def test_a_service_that_is_away_is_one_line(started, node_module, monkeypatch):
    def away(request):
        raise httpx.ConnectError("refused")

    def client(*arguments, **named):
        return client_module.Client(*arguments, **named, transport=httpx.MockTransport(away))

    monkeypatch.setattr(node_module, "Client", client)
    node, _ = started()
    node.on_info(info())
    node.on_image(image())
    assert node.warnings == ["no answer: cannot reach http://127.0.0.1:8000: refused"]


@pytest.mark.parametrize("reason", [KeyboardInterrupt, "shutdown"])
def test_it_ends_quietly_when_it_is_told_to(started, node_module, monkeypatch, reason):
    started()
    ends = node_module.ExternalShutdownException if reason == "shutdown" else reason
    done = []

    def spin(node):
        done.append(node)
        raise ends

    for name, what in {"init": lambda: None, "spin": spin, "try_shutdown": lambda: done.append("shut down")}.items():
        monkeypatch.setattr(node_module.rclpy, name, what, raising=False)
    node_module.main()
    assert [type(done[0]), done[1]] == [node_module.Grasping, "shut down"]


def test_images_are_read_as_sensors_send_them_and_only_the_newest(started):
    node, _ = started()
    assert set(node.subscriptions) == {"image", "camera_info"}
    assert all(qos.depth == 1 for _, _, qos in node.subscriptions.values())


def test_the_package_is_whole():
    assert ET.parse(PACKAGE / "package.xml").getroot().find("name").text == "icgnet_ros"
    assert (PACKAGE / "resource" / "icgnet_ros").is_file()
    imported = {
        line.split()[1].split(".")[0]
        for line in (PACKAGE / "icgnet_ros" / "node.py").read_text().splitlines()
        if line.strip().startswith(("import ", "from "))
    }
    depends = {each.text for each in ET.parse(PACKAGE / "package.xml").getroot().iter("exec_depend")}
    assert imported - {"numpy", "icgnet", "tf2_ros"} <= depends
    assert "tf2_ros_py" in depends


def test_it_needs_neither_torch_nor_the_rest_of_the_package():
    text = (PACKAGE / "icgnet_ros" / "node.py").read_text()
    used = {line.split()[1] for line in text.splitlines() if line.startswith("from icgnet")}
    assert used == {"icgnet.client", "icgnet.errors"}
