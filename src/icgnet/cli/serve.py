"""`icgnet serve`: predictions over HTTP."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from icgnet.errors import InputError
from icgnet.inference.grasp_search import GraspSearch
from icgnet.network.config import Precision
from icgnet.service.config import ServiceConfig
from icgnet.settings import check_range

TOKEN = "ICGNET_TOKEN"
EXTRA = ("fastapi", "starlette", "uvicorn", "prometheus_client")


@dataclass(frozen=True)
class Serve:
    """Answer predictions over HTTP, for robots and other programs.

    Every request brings a depth image or a cloud and gets objects and grasps; http://127.0.0.1:8000/docs shows how. The
    token that callers must bring is the environment variable ICGNET_TOKEN.
    """

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
    service: Annotated[ServiceConfig, tyro.conf.arg(name="")] = field(default_factory=ServiceConfig)
    search: Annotated[GraspSearch, tyro.conf.arg(name="")] = field(default_factory=GraspSearch)

    def run(self) -> None:
        """Serves until the process is told to stop.

        Raises:
            IcgnetError: for everything that the caller can mend.
        """
        check_range(self, 1.0, "threads", most=256.0)
        check_range(self, 0.0, "seed")
        token = os.environ.get(TOKEN) or None
        self.service.check_token(token)
        try:
            from icgnet.service.app import Service
            from icgnet.service.server import serve
        except ModuleNotFoundError as error:
            if error.name in EXTRA:
                raise InputError('icgnet serve needs more packages: pip install "icgnet[serve]"') from error
            raise
        from icgnet.network.weights_header import DEFAULT_WEIGHTS, check_known, stored_checksum
        from icgnet.predictor import Predictor

        check_known(self.weights, self.gripper)
        predictor = Predictor.load(
            self.weights, self.threads, self.gripper, self.seed, self.search, self.precision, self.device
        )
        about = {"sha256": stored_checksum(self.weights or DEFAULT_WEIGHTS)}
        serve(Service(predictor, self.service, about), token, _announce)


def _announce(address: str) -> None:
    print(f"answering under {address}, described under {address}/docs; stop with Ctrl-C", flush=True)
