"""A node that asks a service of `icgnet serve` for the grasps in each depth image; needs no torch.

Publishes geometry_msgs/PoseArray on ~/poses, best first, and their probabilities as std_msgs/Float32MultiArray on
~/scores, with the stamp of the image. One image is asked about at a time, in a thread of its own, while the executor
goes on taking images and transforms; of what comes meanwhile the newest is next.
"""

import queue
import sys
import threading
import time

import numpy as np
import rclpy
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.time import Time
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray

from icgnet.client import Client, ServiceError
from icgnet.errors import IcgnetError

ENCODINGS = {"16UC1": ("u2", 1000.0), "mono16": ("u2", 1000.0), "32FC1": ("f4", 1.0)}
PERIOD = 10.0
"""So often it is said whether images come and are looked at [s]."""
PAUSE = 1.0
"""A service that does not answer is not asked again sooner [s]."""


class Grasping(Node):
    """Hands images to the service, and its answers to everybody."""

    def __init__(self):
        super().__init__("icgnet")
        defaults = {"url": "http://127.0.0.1:8000", "token": "", "timeout": 120.0, "world": "", "limit": 50}
        given = {name: self.declare_parameter(name, value).value for name, value in defaults.items()}
        self.world, self.limit, self.timeout = given["world"], given["limit"], given["timeout"]
        self.client = Client(given["url"], given["token"] or None, self.timeout, retries=0)
        self.info = self.tf = self.begun = None
        self.came = self.skipped = 0  # images since the last report
        self.newest, self.stopping = queue.Queue(1), threading.Event()
        if self.world:
            from tf2_ros import Buffer, TransformListener

            self.tf = Buffer()
            self.listener = TransformListener(self.tf, self)
        self.poses = self.create_publisher(PoseArray, "~/poses", 10)
        self.scores = self.create_publisher(Float32MultiArray, "~/scores", 10)
        # Best effort matches every camera; what is lost on the way is for the parameters qos_overrides to mend.
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        overrides = {"qos_overriding_options": QoSOverridingOptions.with_default_policies()}
        self.create_subscription(CameraInfo, "camera_info", self.on_info, newest, **overrides)
        self.create_subscription(Image, "image", self.on_image, newest, **overrides)
        self.create_timer(PERIOD, self.report)
        self.asking = threading.Thread(target=self.answer_images, daemon=True)
        self.asking.start()

    def on_info(self, info):
        self.info = info

    def on_image(self, image):
        self.came += 1
        try:
            self.newest.get_nowait()
            self.skipped += 1
        except queue.Empty:
            pass
        self.newest.put_nowait(image)  # nobody else puts

    def report(self):
        """Says, now and then, that nothing comes or that images were skipped."""
        came, skipped, begun, self.came, self.skipped = self.came, self.skipped, self.begun, 0, 0
        if not came:
            topic = self.resolve_topic_name("image")
            self.get_logger().warning(
                f"no image on {topic} in {PERIOD:g} s, where {self.count_publishers(topic)} publish: is the topic "
                "right, and does the network bring whole images (see README)?"
            )
        elif skipped:
            since = f", for {time.monotonic() - begun:.0f} s with one" if begun is not None else ""
            self.get_logger().info(f"{skipped} of {came} images in {PERIOD:g} s skipped, the service is busy{since}")

    def answer_images(self):
        while not self.stopping.is_set():
            image = self.newest.get()
            if not self.stopping.is_set():
                self.answer(image)

    def answer(self, image):
        self.begun = time.monotonic()
        try:
            self.publish(image, self.ask(image))
        except Exception as error:  # a bad image or a service that is away must not end the node
            if self.stopping.is_set():
                return
            known = isinstance(error, IcgnetError | ValueError) or type(error).__module__.startswith("tf2")
            line = str(error) if known else f"{type(error).__name__}: {error}"
            self.get_logger().warning(f"no answer: {line}", throttle_duration_sec=5.0)
            if isinstance(error, ServiceError):
                self.stopping.wait(PAUSE)
        finally:
            self.begun = None

    def publish(self, image, answer):
        result = PoseArray()
        result.header.stamp = image.header.stamp
        result.header.frame_id = self.world or image.header.frame_id
        result.poses = [pose_of(matrix) for matrix in answer.poses]
        if self.stopping.is_set():
            return
        self.poses.publish(result)
        self.scores.publish(Float32MultiArray(data=[float(grasp["score"]) for grasp in answer.grasps]))
        self.get_logger().info(
            f"{len(result.poses)} grasps in {time.monotonic() - self.begun:.1f} s", throttle_duration_sec=PERIOD
        )

    def ask(self, image):
        if self.info is None:
            raise ValueError(f"nothing on {self.resolve_topic_name('camera_info')} yet")
        if (self.info.width, self.info.height) != (image.width, image.height):
            raise ValueError(
                f"camera_info is for {self.info.width} x {self.info.height} pixels, the image has "
                f"{image.width} x {image.height}"
            )
        pose = None
        if self.tf is not None:
            stamp = Time.from_msg(image.header.stamp)
            found = self.tf.lookup_transform(self.world, image.header.frame_id, stamp, Duration(seconds=0.2)).transform
            p, q = found.translation, found.rotation
            pose = [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
        P = np.asarray(self.info.p, dtype=float).reshape(3, 4)  # of rectified images; K is of those before
        K = P[:, :3] if P[0, 0] else np.asarray(self.info.k, dtype=float).reshape(3, 3)
        options = {"limit": self.limit, "deadline_ms": 1e3 * self.timeout}
        if self.world:
            options["frame_id"] = self.world
        return self.client.predict_depth(depth_of(image), K, pose, **options)

    def stop(self):
        """Ends the thread; what the service is still working at is nobody's any more."""
        self.stopping.set()
        self.client.close()
        if self.newest.empty():
            self.newest.put_nowait(None)
        self.asking.join(PAUSE)


def depth_of(image):
    """Depth [m] of a sensor_msgs/Image."""
    if image.encoding not in ENCODINGS:
        raise ValueError(f"encoding {image.encoding!r} is no depth; known are {', '.join(ENCODINGS)}")
    kind, units = ENCODINGS[image.encoding]
    pixel = np.dtype((">" if image.is_bigendian else "<") + kind)
    data, size = np.frombuffer(image.data, np.uint8), image.step * image.height
    if not size or image.step < pixel.itemsize * image.width or len(data) < size:
        raise ValueError(
            f"an image of {image.width} x {image.height} pixels with {image.step} bytes a row cannot have "
            f"{len(data)} bytes"
        )
    rows = data[:size].reshape(image.height, image.step)[:, : pixel.itemsize * image.width]
    return np.ascontiguousarray(rows).view(pixel).astype(np.float32) / np.float32(units)


def pose_of(matrix):
    """geometry_msgs/Pose of a rigid 4 x 4 matrix, by the largest of the four ways to find its quaternion."""
    m = np.asarray(matrix, dtype=float)
    trace = np.trace(m[:3, :3])
    squares = np.array([trace, *np.diag(m)[:3]]) * [1, 2, 2, 2] + [1, 1 - trace, 1 - trace, 1 - trace]
    k = int(np.argmax(squares))
    off = np.array([m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]])
    if k == 0:
        q = np.array([squares[0], *off])
    else:
        q = np.array([off[k - 1], *(m[k - 1, :3] + m[:3, k - 1])])
        q[k] = squares[k]
    w, x, y, z = (float(value) for value in q / np.linalg.norm(q))
    return Pose(
        position=Point(**dict(zip("xyz", map(float, m[:3, 3]), strict=True))),
        orientation=Quaternion(w=w, x=x, y=y, z=z),
    )


def main():
    rclpy.init()
    try:
        node = Grasping()
    except IcgnetError as error:  # parameters that are no address or time
        rclpy.try_shutdown()
        sys.exit(f"error: {error}")
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.stop()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
