"""The options of every command that loads a predictor."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from icgnet.inference.grasp_search import GraspSearch
from icgnet.network.config import Precision
from icgnet.settings import check_range

if TYPE_CHECKING:
    from icgnet.predictor import Predictor


@dataclass(frozen=True)
class PredictorOptions:
    """The network, the hand, and how grasps are looked for."""

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

    def check(self, object_class: str | None = None) -> None:
        """Makes sure, before anything heavy is loaded, that the predictor can be.

        Args:
            object_class: name of a class that the weights must know; None for any.

        Raises:
            IcgnetError: a value out of its range, weights or a hand that cannot be used, or an unknown class.
        """
        check_range(self, 1.0, "threads", most=256.0)
        check_range(self, 0.0, "seed")
        from icgnet.network.weights_header import check_known

        check_known(self.weights, self.gripper, object_class)

    def load(self) -> "Predictor":
        """The predictor; loads torch.

        Raises:
            IcgnetError: as `Predictor.load`.
        """
        from icgnet.predictor import Predictor

        return Predictor.load(
            self.weights, self.threads, self.gripper, self.seed, self.search, self.precision, self.device
        )
