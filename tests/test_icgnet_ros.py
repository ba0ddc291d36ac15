"""The node for robots that have ROS, with a fake rclpy: beside a service that answers one thing, and a real one."""

import importlib.util
import io
import sys
import threading
import time
import xml.etree.ElementTree as ET
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import ClassVar

import httpx
import numpy as np
import pytest

from icgnet import __version__
from icgnet import client as client_module
from icgnet.cli.demo import FOLDER
from icgnet.geometry.camera import unproject
from icgnet.geometry.transforms import make_transform, quaternion_to_matrix, random_rotation
from service_process import serving

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
        self.name, self.subscriptions, self.published, self.timers = name, {}, {}, []
        self.warnings, self.infos = [], []

    def declare_parameter(self, name, default):
        return SimpleNamespace(value=self.parameters.get(name, default))

    def create_subscription(self, kind, topic, callback, qos, qos_overriding_options):
        self.subscriptions[topic] = (kind, callback, qos, qos_overriding_options)

    def create_timer(self, seconds, callback):
        self.timers.append((seconds, callback))

    def resolve_topic_name(self, topic):
        return f"/camera/{topic}"

    def count_publishers(self, topic):
        return {"/camera/image": 2}[topic]

    def create_publisher(self, kind, topic, qos):
        sent = self.published.setdefault(topic, [])
        return SimpleNamespace(publish=sent.append)

    def get_logger(self):
        return SimpleNamespace(
            warning=lambda line, throttle_duration_sec=None: self.warnings.append(line),
            info=lambda line, throttle_duration_sec=None: self.infos.append(line),
        )

    def destroy_node(self):
        pass


class FakeBuffer:
    """A tf2 buffer that knows one transform."""

    def lookup_transform(self, target, source, time, timeout):
        assert (target, source, time) == ("base", "optical", "time of then")
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
        "rclpy.time": fake("rclpy.time", Time=SimpleNamespace(from_msg=lambda stamp: f"time of {stamp}")),
        "rclpy.qos": fake("rclpy.qos", QoSProfile=SimpleNamespace, ReliabilityPolicy=SimpleNamespace(BEST_EFFORT=2)),
        "rclpy.qos_overriding_options": fake(
            "rclpy.qos_overriding_options",
            QoSOverridingOptions=SimpleNamespace(with_default_policies=lambda: "may be overridden"),
        ),
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


GRASPS = [{"pose": pose.tolist(), "score": 0.9 - 0.01 * index} for index, pose in enumerate(poses())]


def answer(request: httpx.Request) -> httpx.Response:
    return httpx.Response(200, json={"grasps": GRASPS, "objects": [], "frame_id": "camera"})


@pytest.fixture
def started(node_module, monkeypatch):
    """Starts the node with parameters. Requests of its client are noted and answered by a function; None sends them."""
    nodes = []

    def start(answered=answer, **parameters):
        asked = []

        def handle(request: httpx.Request) -> httpx.Response:
            asked.append(request)
            return answered(request)

        def client(*arguments, **named):
            return client_module.Client(*arguments, **named, transport=httpx.MockTransport(handle))

        monkeypatch.setattr(node_module, "Client", client_module.Client if answered is None else client)
        monkeypatch.setattr(node_module, "PAUSE", 0.01)
        monkeypatch.setattr(FakeNode, "parameters", parameters)
        nodes.append(node_module.Grasping())
        return nodes[-1], asked

    yield start
    for node in nodes:
        node.stop()
        node.asking.join(60)
        assert not node.asking.is_alive()


class SlowService:
    """A service that is at work until it is let go."""

    def __init__(self):
        self.begun, self.may_end = threading.Semaphore(0), threading.Event()

    def __call__(self, request: httpx.Request) -> httpx.Response:
        self.begun.release()
        assert self.may_end.wait(60)
        return answer(request)


def wait_until(holds, seconds=60.0):
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.002)


def image(encoding="16UC1", **fields) -> Message:
    pixels = (np.arange(12).reshape(3, 4) + 500).astype("<u2" if encoding != "32FC1" else "<f4")
    header = SimpleNamespace(stamp="then", frame_id="optical")
    content = {"data": pixels.tobytes(), "step": 4 * pixels.itemsize, "height": 3, "width": 4, "is_bigendian": 0}
    return Message(**content | {"encoding": encoding, "header": header} | fields)


def info(**fields) -> Message:
    return Message(**{"k": K, "p": [0.0] * 12, "width": 4, "height": 3} | fields)


def sent_arrays(request: httpx.Request) -> dict[str, np.ndarray]:
    with np.load(io.BytesIO(request.content)) as saved:
        return dict(saved)


def test_an_image_becomes_poses_and_scores_with_its_stamp_and_frame(started):
    node, asked = started()
    node.on_info(info())
    node.answer(image())
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
    node.answer(image("32FC1"))
    assert node.published["~/poses"][0].header.frame_id == "base"
    arrays = sent_arrays(asked[0])
    assert arrays["camera_pose"].tolist() == [1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0]
    assert asked[0].url.params["frame_id"] == "base"


@pytest.mark.parametrize(
    ("camera", "picture", "said"),
    [
        (None, image(), "no answer: nothing on /camera/camera_info yet"),
        (info(width=8), image(), "no answer: camera_info is for 8 x 3 pixels, the image has 4 x 3"),
        (info(), image("rgb8"), "no answer: encoding 'rgb8' is no depth; known are 16UC1, mono16, 32FC1"),
        (info(), image(data=b"12"), "no answer: an image of 4 x 3 pixels with 8 bytes a row cannot have 2 bytes"),
        (info(), image(step=7), "no answer: an image of 4 x 3 pixels with 7 bytes a row cannot have 24 bytes"),
    ],
)
def test_a_bad_image_is_one_line_and_the_next_is_answered(started, camera, picture, said):
    node, asked = started()
    node.info = camera
    node.answer(picture)
    assert len(node.warnings) == 1
    assert node.warnings[0].startswith(said)
    assert not asked
    node.on_info(info())
    node.answer(image())
    assert len(node.published["~/poses"]) == 1


def test_a_service_that_is_away_or_too_slow_is_one_line_and_the_next_image_is_answered(started):
    errors = [httpx.ConnectError("refused"), httpx.ReadTimeout("timed out")]

    def answered(request):
        if errors:
            raise errors.pop(0)
        return answer(request)

    node, _ = started(answered, timeout=12.0)
    node.on_info(info())
    for _ in range(3):
        node.answer(image())
    away, slow = node.warnings
    assert away == "no answer: cannot reach http://127.0.0.1:8000: refused"
    assert slow.startswith("no answer: http://127.0.0.1:8000 did not answer within 12 s")
    assert len(node.published["~/poses"]) == 1


def test_of_rectified_images_the_matrix_is_in_P(started):
    node, asked = started()
    for P in ([0.0] * 12, [500.0, 0.0, 2.5, -9.0, 0.0, 510.0, 1.5, 0.0, 0.0, 0.0, 1.0, 0.0]):
        node.on_info(info(p=P))
        node.answer(image())
    before, after = (sent_arrays(request)["K"] for request in asked)
    assert before.ravel().tolist() == K
    assert after.tolist() == [[500.0, 0.0, 2.5], [0.0, 510.0, 1.5], [0.0, 0.0, 1.0]]


def test_while_the_service_is_at_work_images_are_taken_and_the_newest_is_next(started):
    service = SlowService()
    node, asked = started(service)
    node.on_info(info())
    node.on_image(image(header=SimpleNamespace(stamp=0, frame_id="optical")))
    assert service.begun.acquire(timeout=60)
    for stamp in (1, 2, 3):  # none of these waits for the service
        node.on_image(image(header=SimpleNamespace(stamp=stamp, frame_id="optical")))
    node.report()
    assert node.infos == ["2 of 4 images in 10 s skipped, the service is busy, for 0 s with one"]
    service.may_end.set()
    wait_until(lambda: len(node.published["~/scores"]) == 2)
    assert [result.header.stamp for result in node.published["~/poses"]] == [0, 3]
    assert [request.url.params["deadline_ms"] for request in asked] == ["120000.0"] * 2


def test_that_no_image_comes_is_said(started):
    node, _ = started()
    ((period, callback),) = node.timers
    callback()
    assert period == 10.0
    assert node.warnings[0].startswith("no image on /camera/image in 10 s, where 2 publish")
    node.on_info(info())
    node.on_image(image())
    wait_until(lambda: node.published["~/scores"])
    callback()
    assert len(node.warnings) == 1
    assert node.infos[0].startswith("20 grasps in 0.")


def test_it_stops_while_the_service_is_at_work(started, node_module):
    service = SlowService()
    node, _ = started(service)
    node.on_info(info())
    node.on_image(image())
    assert service.begun.acquire(timeout=60)
    node.stop()
    service.may_end.set()
    node.asking.join(60)
    assert not node.asking.is_alive()
    assert node.warnings == node.published["~/poses"] == []


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


def test_an_address_that_is_none_is_one_line(started, node_module, monkeypatch):
    started()
    monkeypatch.setattr(FakeNode, "parameters", {"url": "robot:8000"})
    for name in ("init", "try_shutdown"):
        monkeypatch.setattr(node_module.rclpy, name, lambda: None, raising=False)
    with pytest.raises(SystemExit, match="error: url must begin with http:// or https://, got 'robot:8000'"):
        node_module.main()


def test_images_are_read_as_sensors_send_them_and_only_the_newest(started):
    node, _ = started()
    assert set(node.subscriptions) == {"image", "camera_info"}
    for _, _, qos, options in node.subscriptions.values():
        assert (qos.depth, qos.reliability, options) == (1, 2, "may be overridden")


@pytest.mark.slow
def test_a_real_service_finds_grasps_in_the_bundled_capture(started):
    with np.load(FOLDER / "demo.npz") as capture:
        depth, K = capture["depth"], capture["K"]
    height, width = depth.shape
    pixels = (1000 * depth).round().astype("<u2")
    with serving() as (url, _):
        node, _ = started(None, url=url, limit=10, timeout=600.0)  # busy machines
        node.on_info(info(k=K.ravel().tolist(), width=width, height=height))
        node.on_image(image(data=pixels.tobytes(), step=2 * width, height=height, width=width))
        wait_until(lambda: node.published["~/scores"] or node.warnings, 610.0)
    assert node.warnings == []
    (result,), (scores,) = node.published["~/poses"], node.published["~/scores"]
    assert (result.header.stamp, result.header.frame_id) == ("then", "optical")
    assert 1 <= len(result.poses) == len(scores.data) <= 10
    assert scores.data == sorted(scores.data, reverse=True)
    # Each is at something that the camera sees, as the camera sees it: z forward.
    seen = unproject(depth, K)[depth > 0]
    for pose in result.poses:
        at = np.array([pose.position.x, pose.position.y, pose.position.z])
        assert np.linalg.norm(seen - at, axis=1).min() < 0.05


def test_the_package_is_whole():
    assert ET.parse(PACKAGE / "package.xml").getroot().find("name").text == "icgnet_ros"
    assert (PACKAGE / "resource" / "icgnet_ros").is_file()
    assert ET.parse(PACKAGE / "package.xml").getroot().find("version").text == __version__
    assert f'version="{__version__}"' in (PACKAGE / "setup.py").read_text()
    imported = {
        line.split()[1].split(".")[0]
        for line in (PACKAGE / "icgnet_ros" / "node.py").read_text().splitlines()
        if line.strip().startswith(("import ", "from "))
    }
    depends = {each.text for each in ET.parse(PACKAGE / "package.xml").getroot().iter("exec_depend")}
    assert imported - {"numpy", "icgnet", "tf2_ros"} - set(sys.stdlib_module_names) <= depends
    assert "tf2_ros_py" in depends


def test_it_needs_neither_torch_nor_the_rest_of_the_package():
    text = (PACKAGE / "icgnet_ros" / "node.py").read_text()
    used = {line.split()[1] for line in text.splitlines() if line.startswith("from icgnet")}
    assert used == {"icgnet.client", "icgnet.errors"}
