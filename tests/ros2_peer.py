"""Another process of the domain: sends images, camera info and transforms, and notes what the node answers.

python ros2_peer.py DOMAIN SCENE.npz SECONDS; prints one JSON object.
"""

import json
import sys
import time

import numpy as np

from icgnet.ros2.bus import Bus, Reader, Writer, reliable, sensor_data
from icgnet.ros2.messages import (
    CameraInfo,
    CollisionObject,
    Detection3DArray,
    Empty,
    Grasp,
    Header,
    Image,
    MarkerArray,
    PoseArray,
    Quaternion,
    TFMessage,
    Time,
    Transform,
    TransformStamped,
    Vector3,
)

RESULTS = {
    "poses": PoseArray,
    "markers": MarkerArray,
    "detections": Detection3DArray,
    "grasps": Grasp,
    "collision_objects": CollisionObject,
}


def main() -> None:
    domain, scene, seconds = int(sys.argv[1]), dict(np.load(sys.argv[2])), float(sys.argv[3])
    bus = Bus(domain)
    readers = {name: Reader(bus, f"/icgnet/{name}", kind, reliable(1000)) for name, kind in RESULTS.items()}
    images = Writer(bus, "/camera/depth/image_rect_raw", Image, sensor_data())
    infos = Writer(bus, "/camera/depth/camera_info", CameraInfo, sensor_data())
    fixed = Writer(bus, "/tf_static", TFMessage, reliable(is_latched=True))
    triggers = Writer(bus, "/look", Empty, reliable())
    if "quaternion" in scene:
        w, x, y, z = scene["quaternion"].tolist()
        move = Transform(Vector3(*scene["position"].tolist()), Quaternion(x, y, z, w))
        fixed.write(TFMessage([TransformStamped(Header(Time(), "base"), "optical", move)]))
    pixels = scene["pixels"]
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel().tolist()
    encoding, (height, width) = str(scene["encoding"]), pixels.shape
    header = Header(Time(), "optical")
    image = Image(header, height, width, encoding, 0, pixels.itemsize * width, data)
    info = CameraInfo(header, height, width, k=scene["K"].ravel().tolist())
    got: dict[str, list] = {name: [] for name in readers}
    sent, end = 0, time.monotonic() + seconds
    while time.monotonic() < end and not complete(got):
        sent += 1
        image.header.stamp = info.header.stamp = Time(1000 + sent, 5)
        infos.write(info)
        images.write(image)
        if "is_triggering" in scene:
            triggers.write(Empty())
        bus.wait(0.3)
        for name, reader in readers.items():
            got[name] += reader.take(lambda line: print(line, file=sys.stderr))
    print(json.dumps({name: list(map(plain, messages)) for name, messages in got.items()}))


def complete(got: dict[str, list]) -> bool:
    """Whether an answer has come to its end: the markers are sent last."""
    return bool(got["markers"] and got["poses"] and got["detections"] and got["collision_objects"])


def plain(message):
    if isinstance(message, list | tuple):
        return [plain(each) for each in message]
    if hasattr(message, "__dataclass_fields__"):
        return {name: plain(getattr(message, name)) for name in message.__dataclass_fields__}
    return message


if __name__ == "__main__":
    main()
