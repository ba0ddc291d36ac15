"""Tries `icgnet ros2` against a real rclpy: plays a capture as a camera, and prints what the node answers.

Runs with the Python that has ROS 2 (rclpy, sensor_msgs, geometry_msgs, visualization_msgs, numpy; nothing of icgnet),
beside a node that runs:

    icgnet ros2 &
    python scripts/ros2_jazzy_peer.py src/icgnet/captures/demo.npz

Messages whose packages are not installed (vision_msgs, moveit_msgs, tf2_msgs) are left out, and named. Ends with 0 when
each of the others has come, with stamp and frame of an image that was sent.
"""

import argparse
import array
import importlib
import sys
import time

import numpy as np
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Empty

RESULTS = {
    "poses": "geometry_msgs/PoseArray",
    "markers": "visualization_msgs/MarkerArray",
    "detections": "vision_msgs/Detection3DArray",
    "grasps": "moveit_msgs/Grasp",
    "collision_objects": "moveit_msgs/CollisionObject",
}
FRAME = "optical"


def kind_of(name):
    """The class of a message; None where its package is not installed."""
    package, _, kind = name.partition("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), kind)
    except ModuleNotFoundError:
        return None


def header_of(message):
    """The header of a message, or of the first one in it."""
    for part in (message, *getattr(message, "markers", [])[:1], getattr(message, "grasp_pose", None)):
        if hasattr(part, "header"):
            return part.header
    raise TypeError(f"{type(message).__name__} has no header")


def entries(messages):
    """How many poses, markers or detections the first message holds."""
    names = ("poses", "markers", "detections", "meshes", "grasp_quality")
    found = [getattr(message, name) for message in messages[:1] for name in names if hasattr(message, name)]
    return sum(len(each) if hasattr(each, "__len__") else 1 for each in found)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", help="npz with depth [m] and K")
    parser.add_argument("--seconds", type=float, default=60.0, help="at most so long")
    parser.add_argument("--metres", action="store_true", help="send 32FC1 in place of 16UC1")
    parser.add_argument("--reliable", action="store_true", help="send lost images again, where somebody wants that")
    parser.add_argument("--trigger", help="topic of std_msgs/Empty that is sent beside each image")
    given = parser.parse_args()
    with np.load(given.capture) as saved:
        depth, K = saved["depth"], saved["K"]
    metres = np.nan_to_num(depth)
    pixels = metres.astype("<f4") if given.metres else (1000 * metres).round().astype("<u2")

    rclpy.init()
    node = rclpy.create_node("icgnet_peer")
    quality = QoSProfile(depth=5) if given.reliable else qos_profile_sensor_data
    images = node.create_publisher(Image, "/camera/depth/image_rect_raw", quality)
    infos = node.create_publisher(CameraInfo, "/camera/depth/camera_info", quality)
    triggers = node.create_publisher(Empty, given.trigger, 10) if given.trigger else None
    if tf := kind_of("tf2_msgs/TFMessage"):
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_publisher(tf, "/tf_static", latched).publish(tf())
    got = {name: [] for name, kind in RESULTS.items() if kind_of(kind)}
    for name, messages in got.items():
        node.create_subscription(kind_of(RESULTS[name]), f"/icgnet/{name}", messages.append, QoSProfile(depth=1000))

    height, width = pixels.shape
    image = Image(
        height=height, width=width, encoding="32FC1" if given.metres else "16UC1", step=width * pixels.itemsize
    )
    image.data = array.array("B", pixels.tobytes())
    info = CameraInfo(height=height, width=width, k=K.ravel().tolist())
    image.header.frame_id = info.header.frame_id = FRAME
    sent, end = 0, time.monotonic() + given.seconds
    while time.monotonic() < end and not all(got.values()):
        sent += 1
        image.header.stamp.sec = info.header.stamp.sec = sent
        infos.publish(info)
        images.publish(image)
        if triggers:
            triggers.publish(Empty())
        until = time.monotonic() + 0.3
        while time.monotonic() < until:
            rclpy.spin_once(node, timeout_sec=0.05)

    print(f"{sent} images sent; topics of icgnet: {[n for n, _ in node.get_topic_names_and_types() if 'icgnet' in n]}")
    is_right = True
    for name, kind in RESULTS.items():
        messages = got.get(name)
        if messages is None:
            print(f"{name:18} {kind:34} not tried: the package is not installed")
            continue
        headers = [header_of(message) for message in messages]
        is_right &= bool(headers) and all(h.frame_id == FRAME and 1 <= h.stamp.sec <= sent for h in headers)
        told = [(header.stamp.sec, header.frame_id) for header in headers[:3]]
        print(f"{name:18} {kind:34} {len(messages)} messages, {entries(messages)} entries in the first, of {told}")
    print("right" if is_right else "WRONG")
    node.destroy_node()
    rclpy.shutdown()
    sys.exit(not is_right)


if __name__ == "__main__":
    main()
