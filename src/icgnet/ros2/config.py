"""Settings of the node."""

import os
import re
from dataclasses import dataclass

from icgnet.errors import InputError
from icgnet.settings import check_range

DOMAIN = "ROS_DOMAIN_ID"
LARGEST_DOMAIN = 232
"""The ports of higher ones would be above 65535."""
TOPIC = re.compile(r"(/?[A-Za-z_][A-Za-z0-9_]*)(/[A-Za-z_][A-Za-z0-9_]*)*")


@dataclass(frozen=True)
class Ros2Config:
    """What the node listens to, and what it tells whom."""

    image: str = "/camera/depth/image_rect_raw"
    """Topic of the depth images, sensor_msgs/Image: 16UC1 or mono16 in millimetres, 32FC1 in metres."""
    info: str | None = None
    """Topic of the sensor_msgs/CameraInfo; camera_info beside the images if not given."""
    world: str | None = None
    """Frame with z up that results are in, known from /tf and /tf_static; if not given, they are in the frame of the
    image."""
    tf_tolerance: float = 0.1
    """How much older or newer than the image a transform of a moving frame may be [s]."""
    trigger: str | None = None
    """Topic of std_msgs/Empty: each message asks for the next image; every image is answered if not given."""
    prefix: str = "/icgnet"
    """Before the names of the topics with results: poses, markers, detections, grasps, collision_objects."""
    collision_objects: str | None = None
    """Topic of the moveit_msgs/CollisionObject; /collision_object puts them into MoveIt's planning scene."""
    limit: int = 50
    """At most so many grasps are sent, the best ones."""
    domain: int | None = None
    """DDS domain; that of the environment variable ROS_DOMAIN_ID if not given, else 0."""
    hand_frame: str | None = None
    """Link whose z axis is the approach direction, for moveit_msgs/Grasp; panda_hand of the Franka hand, else
    needed."""
    joints: tuple[str, ...] = ()
    """Finger joints for moveit_msgs/Grasp, each of which opens half of the width; those of the Franka hand, else
    needed."""
    mount: tuple[float, ...] = ()
    """Pose of the link that the hand is mounted on in the hand's base link, x y z [m] qw qx qy qz, for
    moveit_msgs/Grasp; panda_link8 of the Franka hand, else the base link itself."""

    def __post_init__(self) -> None:
        for name in ("image", "info", "trigger", "prefix", "collision_objects"):
            value = getattr(self, name)
            if value is not None and not TOPIC.fullmatch(value):
                raise InputError(
                    f"{name} must be a name of letters, digits, _ and / such as /camera/depth, got {value!r}"
                )
        if self.world is not None and not self.world.strip():
            raise InputError(f"world must be the name of a frame, got {self.world!r}")
        check_range(self, 0.0, "tf_tolerance", most=10.0)
        check_range(self, 1.0, "limit", most=1000.0)
        check_range(self, 0.0, "domain", most=float(LARGEST_DOMAIN))
        if len(self.mount) not in (0, 7):
            raise InputError(f"mount takes 7 numbers, x y z qw qx qy qz, got {len(self.mount)}")

    @property
    def info_topic(self) -> str:
        """Topic of the camera info."""
        return self.info or f"{_absolute(self.image).rpartition('/')[0]}/camera_info"

    @property
    def collision_topic(self) -> str:
        """Topic of the collision objects."""
        return self.collision_objects or f"{self.prefix}/collision_objects"

    def domain_id(self) -> int:
        """The DDS domain.

        Raises:
            InputError: ROS_DOMAIN_ID is no number from 0 to 232.
        """
        if self.domain is not None:
            return self.domain
        given = os.environ.get(DOMAIN) or "0"
        if not (given.isascii() and given.isdecimal() and int(given) <= LARGEST_DOMAIN):
            raise InputError(f"{DOMAIN} must be a number from 0 to {LARGEST_DOMAIN}, got {given!r}")
        return int(given)


def dds_name(topic: str) -> str:
    """The name over DDS of a topic of ROS."""
    return f"rt{_absolute(topic)}"


def _absolute(topic: str) -> str:
    return topic if topic.startswith("/") else f"/{topic}"
