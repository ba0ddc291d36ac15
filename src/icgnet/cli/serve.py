"""`icgnet serve`: predictions over HTTP."""

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from icgnet.arm.settings import PickSettings
from icgnet.cli.predictor_options import PredictorOptions
from icgnet.errors import InputError
from icgnet.service.config import ServiceConfig

if TYPE_CHECKING:
    from icgnet.service.picking import PickBench

TOKEN = "ICGNET_TOKEN"
EXTRA = ("fastapi", "starlette", "uvicorn", "prometheus_client")


@dataclass(frozen=True)
class Serve:
    """Answer predictions over HTTP, for robots and other programs.

    Every request brings a depth image or a cloud and gets objects and grasps; http://127.0.0.1:8000/docs shows how. The
    token that callers must bring is the environment variable ICGNET_TOKEN.
    """

    arm: str | None = None
    """Name of an arm or an arm file: plans for it under /pick; none are made if not given. Needs icgnet[arm]."""
    hand_eye: Path | None = None
    """YAML or JSON file with T_base_camera, or with T_tool_camera and joints: where the camera of the picks is, unless
    a request gives its camera_pose."""
    pick: PickSettings = field(default_factory=PickSettings)
    """How picks are planned."""
    service: Annotated[ServiceConfig, tyro.conf.arg(name="")] = field(default_factory=ServiceConfig)
    predictor: Annotated[PredictorOptions, tyro.conf.arg(name="")] = field(default_factory=PredictorOptions)

    def run(self) -> None:
        """Serves until the process is told to stop.

        Raises:
            IcgnetError: for everything that the caller can mend.
        """
        self.predictor.check()
        token = os.environ.get(TOKEN) or None
        self.service.check_token(token)
        if self.hand_eye is not None and self.arm is None:
            raise InputError("hand_eye is for picks: give --arm, too")
        try:
            from icgnet.service.app import Service
            from icgnet.service.server import serve
        except ModuleNotFoundError as error:
            if error.name in EXTRA:
                raise InputError('icgnet serve needs more packages: pip install "icgnet[serve]"') from error
            raise
        from icgnet.network.weights_header import DEFAULT_WEIGHTS, stored_checksum

        bench = self._bench()
        predictor = self.predictor.load()
        about = {"sha256": stored_checksum(self.predictor.weights or DEFAULT_WEIGHTS)}
        serve(Service(predictor, self.service, about, bench), token, _announce)

    def _bench(self) -> "PickBench | None":
        """The arm that picks are planned for."""
        if self.arm is None:
            return None
        from icgnet.arm.arm import Arm
        from icgnet.arm.hand_eye import HandEye
        from icgnet.service.picking import PickBench

        hand_eye = None if self.hand_eye is None else HandEye.read(self.hand_eye)
        return PickBench(Arm.load(self.arm), hand_eye, self.pick)


def _announce(address: str) -> None:
    print(f"answering under {address}, described under {address}/docs; stop with Ctrl-C", flush=True)
