"""`icgnet mcp`: tools for agents."""

import os
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from icgnet.arm.settings import PickSettings
from icgnet.cli.predictor_options import PredictorOptions
from icgnet.cli.serve import TOKEN
from icgnet.errors import InputError
from icgnet.settings import check_range

if TYPE_CHECKING:
    from icgnet.agents.sight import Bench, Scene, Sight

EXTRA = ("mcp", "mcp_types", "pydantic")
OF_THE_SERVICE = ("arm", "hand_eye", "pick")
"""Options of an arm in this process, which a service has of its own, as it has a predictor."""


@dataclass(frozen=True)
class Mcp:
    """Give agents tools over the Model Context Protocol, on stdin and stdout: look, list_objects, grasp, pick.

    CAPTURES is the folder whose depth images may be looked at: png, tif and npy with --intrinsics, npz with `depth` and
    `K`. No tool moves anything, and nothing is written unless --plans is given. Needs icgnet[mcp].
    """

    captures: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="CAPTURES")]
    """Folder of depth images; nothing outside of it is opened for an agent."""
    url: str | None = None
    """A running `icgnet serve`, which then finds objects and plans picks; its token is the environment variable
    ICGNET_TOKEN."""
    timeout: float = 120.0
    """So long an answer of the service is waited for [s]; with --url."""
    plans: Path | None = None
    """Folder that every plan is written to as a new JSON file; nothing is written if not given."""
    intrinsics: tuple[str, ...] = ()
    """fx fy cx cy [pixels], or a JSON, YAML, npz or mat file with the camera matrix."""
    depth_scale: float = 1.0
    """Depth units per metre: 1000 for millimetres."""
    camera_pose: tuple[str, ...] = ()
    """T_world_camera (OpenCV axes, world z up): a file with the 4x4 matrix, its 16 numbers row by row, or the 7 numbers
    x y z [m] qw qx qy qz; of an npz, its own if it has one."""
    table_height: float | None = None
    """Height of the table plane in the world [m]; found in the image if not given."""
    frame: str = "world"
    """How the world is called in the answers."""
    arm: str | None = None
    """Name of an arm or an arm file, for pick. Needs icgnet[arm]."""
    hand_eye: Path | None = None
    """YAML or JSON file with T_base_camera, or with T_tool_camera and joints: where the camera is, for captures that do
    not say so."""
    pick: PickSettings = field(default_factory=PickSettings)
    """How picks are planned."""
    predictor: Annotated[PredictorOptions, tyro.conf.arg(name="")] = field(default_factory=PredictorOptions)

    def run(self) -> None:
        """Answers until stdin ends.

        Raises:
            IcgnetError: for everything that the caller can mend.
        """
        check_range(self, 0.0, "depth_scale", above=True)
        check_range(self, -100.0, "table_height", most=100.0)
        check_range(self, 0.1, "timeout", most=3600.0)
        self._check_together()
        try:
            from icgnet.agents.server import serve_tools
        except ModuleNotFoundError as error:
            if (error.name or "").partition(".")[0] in EXTRA:
                raise InputError('icgnet mcp needs more packages: pip install "icgnet[mcp]"') from error
            raise
        from icgnet.agents.captures import CaptureFolder
        from icgnet.agents.sight import Scene
        from icgnet.agents.tools import Tools, plans_folder

        captures = CaptureFolder(self.captures, self.intrinsics, self.depth_scale, self.camera_pose)
        scene = Scene(self.table_height, self.frame)
        sight = self._local(scene) if self.url is None else self._remote(scene)
        serve_tools(Tools(captures, sight, plans_folder(self.plans)))

    def _check_together(self) -> None:
        if self.url is not None:
            own = [(self, each) for each in fields(self) if each.name in OF_THE_SERVICE]
            own += [(self.predictor, each) for each in fields(self.predictor)]
            for options, each in own:
                if getattr(options, each.name) != _default(each):
                    raise InputError(f"{each.name} does not go with url: the service at {self.url} has its own")
        elif self.hand_eye is not None and self.arm is None:
            raise InputError("hand_eye is for an arm: give --arm, too, or --camera-pose")

    def _local(self, scene: "Scene") -> "Sight":
        """A network in this process, loaded when it is first needed."""
        from icgnet.agents.sight import LazySight, LocalSight

        self.predictor.check()
        bench, camera_pose = self._bench()

        return LazySight(lambda: LocalSight(self.predictor.load(), scene, bench, camera_pose))

    def _bench(self) -> "tuple[Bench | None, Any]":
        """The arm, and T_world_camera by its hand-eye file."""
        if self.arm is None:
            return None, None
        from icgnet.agents.sight import Bench
        from icgnet.arm.arm import Arm
        from icgnet.arm.hand_eye import HandEye

        arm = Arm.load(self.arm)
        bench = Bench(arm, self.pick)
        if self.hand_eye is None:
            return bench, None
        return bench, arm.description.T_world_base @ HandEye.read(self.hand_eye).pose(arm)

    def _remote(self, scene: "Scene") -> "Sight":
        from icgnet.agents.sight import RemoteSight

        try:
            from icgnet.client import Client
        except ModuleNotFoundError as error:
            if error.name == "httpx":
                raise InputError('icgnet mcp --url needs more packages: pip install "icgnet[client]"') from error
            raise
        assert self.url is not None
        return RemoteSight(Client(self.url, os.environ.get(TOKEN) or None, self.timeout), scene)


def _default(declared: Any) -> Any:
    return declared.default_factory() if callable(declared.default_factory) else declared.default
