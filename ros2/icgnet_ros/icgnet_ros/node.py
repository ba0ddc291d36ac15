"""A node that asks a service of `icgnet serve` for the grasps in each depth image; needs no torch.

Publishes geometry_msgs/PoseArray on ~/poses, best first, and their probabilities as std_msgs/Float32MultiArray on
~/scores, with the stamp of the image.
"""

import numpy as np
import rclpy
from geometry_msgs.msg import Point, Pose, PoseArray, Quaternion
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Float32MultiArray

from icgnet.client import Client
from icgnet.errors import IcgnetError

ENCODINGS = {"16UC1": ("u2", 1000.0), "mono16": ("u2", 1000.0), "32FC1": ("f4", 1.0)}


class Grasping(Node):
    """Hands images to the service, and its answers to everybody."""

    def __init__(self):
        super().__init__("icgnet")
        defaults = {"url": "http://127.0.0.1:8000", "token": "", "timeout": 30.0, "world": "", "limit": 50}
        given = {name: self.declare_parameter(name, value).value for name, value in defaults.items()}
        self.world, self.limit = given["world"], given["limit"]
        self.client = Client(given["url"], given["token"] or None, given["timeout"], retries=0)
        self.info = self.tf = None
        if self.world:
            from tf2_ros import Buffer, TransformListener

            self.tf = Buffer()
            self.listener = TransformListener(self.tf, self, spin_thread=True)  # hears while an image is looked at
        newest = qos_profile_sensor_data
        newest.depth = 1
        self.create_subscription(CameraInfo, "camera_info", self.on_info, newest)
        self.create_subscription(Image, "image", self.on_image, newest)
        self.poses = self.create_publisher(PoseArray, "~/poses", 10)
        self.scores = self.create_publisher(Float32MultiArray, "~/scores", 10)

    def on_info(self, info):
        self.info = info

    def on_image(self, image):
        try:
            answer = self.ask(image)
        except Exception as error:  # a bad image or a service that is away must not end the node
            known = isinstance(error, IcgnetError | ValueError) or type(error).__module__.startswith("tf2")
            line = str(error) if known else f"{type(error).__name__}: {error}"
            self.get_logger().warning(f"no answer: {line}", throttle_duration_sec=5.0)
            return
        result = PoseArray()
        result.header.stamp = image.header.stamp
        result.header.frame_id = self.world or image.header.frame_id
        result.poses = [pose_of(matrix) for matrix in answer.poses]
        self.poses.publish(result)
        self.scores.publish(Float32MultiArray(data=[float(grasp["score"]) for grasp in answer.grasps]))

    def ask(self, image):
        if self.info is None:
            raise ValueError("no camera_info yet")
        if (self.info.width, self.info.height) != (image.width, image.height):
            raise ValueError(
                f"camera_info is for {self.info.width} x {self.info.height} pixels, the image has "
                f"{image.width} x {image.height}"
            )
        pose = None
        if self.tf is not None:
            found = self.tf.lookup_transform(
                self.world, image.header.frame_id, image.header.stamp, Duration(seconds=0.2)
            ).transform
            p, q = found.translation, found.rotation
            pose = [p.x, p.y, p.z, q.w, q.x, q.y, q.z]
        K = np.asarray(self.info.k, dtype=float).reshape(3, 3)
        world = {"frame_id": self.world} if self.world else {}
        return self.client.predict_depth(depth_of(image), K, pose, limit=self.limit, **world)


def depth_of(image):
    """Depth [m] of a sensor_msgs/Image."""
    if image.encoding not in ENCODINGS:
        raise ValueError(f"encoding {image.encoding!r} is no depth; known are {', '.join(ENCODINGS)}")
    kind, units = ENCODINGS[image.encoding]
    pixel = np.dtype((">" if image.is_bigendian else "<") + kind)
    rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, : pixel.itemsize * image.width]
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
    node = Grasping()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.client.close()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
