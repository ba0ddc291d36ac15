"""`icgnet ros2`: a ROS 2 node without ROS."""

import signal
import sys
import threading
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from icgnet.inference.grasp_search import GraspSearch
from icgnet.network.config import Precision
from icgnet.ros2.config import Ros2Config
from icgnet.settings import check_range


@dataclass(frozen=True)
class Ros2:
    """Answer depth images of ROS 2 with grasps and objects, without ROS on this machine.

    Listens over DDS and publishes geometry_msgs/PoseArray, visualization_msgs/MarkerArray,
    vision_msgs/Detection3DArray, moveit_msgs/CollisionObject and moveit_msgs/Grasp. What cannot be answered is one
    line on standard error.
    """

    ros: Annotated[Ros2Config, tyro.conf.arg(name="")] = field(default_factory=Ros2Config)
    weights: Path | None = None
    """Weights file; the one that ships with the package if not given."""
    gripper: str | None = None
    """Name of a gripper or a gripper file: the hand that is to grasp; that of the weights if not given."""
    threads: int | None = None
    """CPU threads."""
    precision: Precision = "float32"
    """In how many bits the network's U-Nets compute; float32 gives the same results on every processor."""
    device: str = "cpu"
    """What the network computes on, such as cpu or cuda."""
    seed: int = 0
    """Of everything that is drawn."""
    search: Annotated[GraspSearch, tyro.conf.arg(name="")] = field(default_factory=GraspSearch)

    def run(self) -> None:
        """Answers until the process is told to stop.

        Raises:
            IcgnetError: for everything that the caller can mend.
        """
        check_range(self, 1.0, "threads", most=256.0)
        check_range(self, 0.0, "seed")
        domain = self.ros.domain_id()
        from icgnet.network.weights_header import check_known
        from icgnet.predictor import Predictor
        from icgnet.ros2.node import Node  # says what to install where the extra is missing

        check_known(self.weights, self.gripper)
        predictor = Predictor.load(
            self.weights, self.threads, self.gripper, self.seed, self.search, self.precision, self.device
        )
        stop = threading.Event()
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda *_: stop.set())
        node = Node(predictor, self.ros, say=lambda line: print(line, flush=True))
        wanted = f"images asked for on {self.ros.trigger}" if self.ros.trigger else "every image"
        print(f"answering {wanted} of {self.ros.image}, in DDS domain {domain}; stop with Ctrl-C", flush=True)
        node.run(stop)
        print("stopped", file=sys.stderr)
