"""`icgnet ros2`: a ROS 2 node without ROS."""

import signal
import sys
import threading
from dataclasses import dataclass, field
from typing import Annotated

import tyro

from icgnet.cli.predictor_options import PredictorOptions
from icgnet.ros2.config import Ros2Config


@dataclass(frozen=True)
class Ros2:
    """Answer depth images of ROS 2 with grasps and objects, without ROS on this machine.

    Listens over DDS and publishes geometry_msgs/PoseArray, visualization_msgs/MarkerArray,
    vision_msgs/Detection3DArray, moveit_msgs/CollisionObject and moveit_msgs/Grasp. What cannot be answered is one
    line on standard error.
    """

    ros: Annotated[Ros2Config, tyro.conf.arg(name="")] = field(default_factory=Ros2Config)
    predictor: Annotated[PredictorOptions, tyro.conf.arg(name="")] = field(default_factory=PredictorOptions)

    def run(self) -> None:
        """Answers until the process is told to stop.

        Raises:
            IcgnetError: for everything that the caller can mend.
        """
        self.predictor.check()
        domain = self.ros.domain_id()
        from icgnet.ros2.node import Node  # says what to install where the extra is missing

        predictor = self.predictor.load()
        stop = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stop.set())
        node = Node(predictor, self.ros, say=lambda line: print(line, flush=True))
        wanted = f"images asked for on {self.ros.trigger}" if self.ros.trigger else "every image"
        print(f"answering {wanted} of {self.ros.image}, in DDS domain {domain}; stop with Ctrl-C", flush=True)
        node.run(stop)
        print("stopped", file=sys.stderr)
