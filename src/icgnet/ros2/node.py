"""The node: takes the newest depth image, predicts, and tells everybody."""

import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from icgnet.errors import IcgnetError, InputError
from icgnet.geometry.transforms import check_pose
from icgnet.grasping.converters import T_PANDA_HAND_LINK8
from icgnet.grasping.gripper import Gripper
from icgnet.inference.prediction import Prediction
from icgnet.predictor import Predictor
from icgnet.ros2.answers import (
    collision_objects,
    detections,
    markers,
    moveit_grasps,
    pose_array,
    removal,
)
from icgnet.ros2.bus import Bus, Reader, Writer, reliable, sensor_data
from icgnet.ros2.config import Ros2Config
from icgnet.ros2.frames import Frames, nanoseconds
from icgnet.ros2.images import depth_of, intrinsics_of
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
    TFMessage,
)

PATIENCE = 0.2
"""The node looks so often whether it is to stop [s]."""
REPEAT = 10.0
"""The same complaint is repeated after this time only [s]."""
FRANKA, FRANKA_HAND, FRANKA_JOINTS = "franka", "panda_hand", ("panda_finger_joint1", "panda_finger_joint2")


@dataclass(frozen=True, eq=False)
class Hand:
    """What moveit_msgs/Grasp must know of a hand on its robot.

    Attributes:
        frame: link whose z axis is the approach direction.
        joints: the finger joints.
        T_base_parent: pose of the link that the hand is mounted on, in the hand's base link [m].
    """

    frame: str
    joints: tuple[str, ...]
    T_base_parent: Float[np.ndarray, "4 4"]


def hand_of(config: Ros2Config, gripper: Gripper) -> Hand | None:
    """The hand that grasps for MoveIt are of; None if it is not said of a hand that is not Franka's.

    Raises:
        InputError: only one of frame and joints is said, or the pose of the mount is none.
    """
    is_franka = gripper.name == FRANKA
    frame = config.hand_frame or (FRANKA_HAND if is_franka else None)
    joints = config.joints or (FRANKA_JOINTS if is_franka else ())
    if frame is None or not joints:
        if frame is None and not joints and not config.mount:
            return None
        raise InputError(f"moveit_msgs/Grasp for the hand {gripper.name!r} needs both hand_frame and joints")
    if config.mount:
        return Hand(frame, joints, check_pose(config.mount, "mount"))
    return Hand(frame, joints, T_PANDA_HAND_LINK8 if is_franka else np.eye(4))


class Node:
    """Listens, predicts and publishes, in the thread that calls `run`.

    Args:
        predictor: finds objects and grasps.
        config: what to listen to, and whom to tell.
        say: takes a line about an answer.
        complain: takes a line about what is wrong.
        clock: tells the time [s].

    Raises:
        InputError: the DDS domain cannot be joined, or the hand is only half described.
    """

    def __init__(
        self,
        predictor: Predictor,
        config: Ros2Config,
        say: Callable[[str], None] = print,
        complain: Callable[[str], None] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._predictor, self._config, self._say, self._clock = predictor, config, say, clock
        self._warn = complain or (lambda line: print(line, file=sys.stderr, flush=True))
        self._hand = hand_of(config, predictor.gripper)
        self._frames = Frames(config.tf_tolerance)
        self._info: CameraInfo | None = None
        self._in_scene: set[str] = set()
        self._said: dict[str, float] = {}
        self._is_asked = config.trigger is None
        self._image_at = clock()

        bus = self._bus = Bus(config.domain_id())
        self._images = Reader(bus, config.image, Image, sensor_data())
        self._infos = Reader(bus, config.info_topic, CameraInfo, sensor_data())
        self._triggers = Reader(bus, config.trigger, Empty, reliable()) if config.trigger else None
        self._moving = Reader(bus, "/tf", TFMessage, reliable(100)) if config.world else None
        self._fixed = Reader(bus, "/tf_static", TFMessage, reliable(100, is_latched=True)) if config.world else None
        self._poses = Writer(bus, f"{config.prefix}/poses", PoseArray, reliable())
        self._markers = Writer(bus, f"{config.prefix}/markers", MarkerArray, reliable())
        self._detections = Writer(bus, f"{config.prefix}/detections", Detection3DArray, reliable())
        # One message each: readers that come a little late, or read slowly, must not lose the first ones.
        self._grasps = Writer(bus, f"{config.prefix}/grasps", Grasp, reliable(config.limit)) if self._hand else None
        self._objects = Writer(bus, config.collision_topic, CollisionObject, reliable(200))

    def run(self, stop: threading.Event) -> None:
        """Answers until it is told to stop; what it is doing then is done to its end."""
        while not stop.is_set():
            self._bus.wait(PATIENCE)
            self.step()

    def step(self) -> bool:
        """Takes in what has come, and answers the newest image if it is wanted; returns whether it did."""
        if self._fixed and self._moving:
            for reader, is_fixed in ((self._fixed, True), (self._moving, False)):
                for message in reader.take(self.complain):
                    self._frames.add(message.transforms, is_fixed)
        self._info = next(iter(self._infos.take(self.complain)[-1:]), self._info)
        images = self._images.take(self.complain)
        self._watch(bool(images))
        is_answered = False
        if images and self._is_asked:
            is_answered = self._answer(images[-1])
            self._is_asked = self._config.trigger is None or not is_answered
        if self._triggers and self._triggers.take(self.complain):
            self._is_asked = True
        return is_answered

    def complain(self, line: str) -> None:
        """Says what is wrong, but not the same for every image."""
        line, now = " ".join(line.split()), self._clock()
        if now - self._said.get(line, -np.inf) >= REPEAT:
            self._said = {known: at for known, at in self._said.items() if now - at < REPEAT} | {line: now}
            self._warn(line)

    def _watch(self, is_there: bool) -> None:
        """Says that no image comes; of those that are lost on the way nobody else tells."""
        now = self._clock()
        if is_there:
            self._image_at = now
        elif now - self._image_at >= REPEAT:
            self.complain(
                f"no image on {self._config.image} in {REPEAT:.0f} s, where {self._images.writers} publish: compare "
                "topic, domain and network, and see 'Large images' in the guide"
            )

    def _answer(self, image: Image) -> bool:
        """Predicts and publishes; whatever is wrong with an image is said, and the next one may be better."""
        try:
            prediction = self._predict(image)
            self._publish(prediction, Header(image.header.stamp, self._config.world or image.header.frame_id))
        except IcgnetError as error:
            self.complain(f"no answer: {error}")
            return False
        except Exception as error:  # a fault of ours must not end a robot's node
            self.complain(f"no answer, by a fault of icgnet: {type(error).__name__}: {error}")
            traceback.print_exc()
            return False
        return True

    def _predict(self, image: Image) -> Prediction:
        if self._info is None:
            raise InputError(f"no camera info on {self._config.info_topic} yet")
        if any(self._info.d) and "rect" not in self._config.image:
            self.complain("the camera info says that images are distorted: give rectified ones, results may be off")
        K = intrinsics_of(self._info, image.width, image.height)
        pose: dict[str, Any] = {}
        if self._config.world:
            stamp = nanoseconds(image.header.stamp.sec, image.header.stamp.nanosec)
            T_world_camera = self._frames.pose(self._config.world, image.header.frame_id, stamp)
            pose = {"camera_pose": T_world_camera, "frame_id": self._config.world}
        return self._predictor.predict_depth(depth_of(image), K, **pose)

    def _publish(self, prediction: Prediction, header: Header) -> None:
        best = replace(prediction, grasps=prediction.grasps.select(slice(0, self._config.limit)))
        # Grasps first: meshes take their time, and are made for those only who listen.
        if self._poses.is_heard:
            self._poses.write(pose_array(best, header))
        if self._grasps and self._hand and self._grasps.is_heard:
            hand = self._hand
            for grasp in moveit_grasps(
                best, self._predictor.gripper, header, hand.frame, hand.joints, hand.T_base_parent
            ):
                self._grasps.write(grasp)
        if self._detections.is_heard:
            self._detections.write(detections(best, header))
        if self._objects.is_heard:
            objects = collision_objects(best, header)
            names = {each.id for each in objects}
            for each in [*(removal(name, header) for name in sorted(self._in_scene - names)), *objects]:
                self._objects.write(each)
            self._in_scene = names
        if self._markers.is_heard:
            self._markers.write(markers(best, header))
        stamp = header.stamp
        spent = sum(prediction.timings_ms.values())
        self._say(
            f"{stamp.sec}.{stamp.nanosec:09d}: {len(best.objects)} objects, {len(best.grasps)} of "
            f"{len(prediction.grasps)} grasps in {header.frame_id!r}, {spent:.0f} ms"
        )
        for warning in prediction.warnings:
            self.complain(f"warning: {warning}")
