"""Where the camera is: the file that `--hand-eye` takes."""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import yaml
from jaxtyping import Float

from icgnet.errors import DataError, InputError
from icgnet.files import write_text
from icgnet.geometry.arrays import described
from icgnet.geometry.transforms import check_pose

if TYPE_CHECKING:  # reading and writing the file needs no package for arms
    from icgnet.arm.arm import Arm

BASE_CAMERA, TOOL_CAMERA, JOINTS = "T_base_camera", "T_tool_camera", "joints"
SUFFIXES = (".yaml", ".yml", ".json")
LARGEST_FILE = 100_000
"""Size of a hand-eye file at most [bytes]."""
FARTHEST_CAMERA, FARTHEST_ON_TOOL = 5.0, 0.5
"""No camera is farther from the base, or from the link that it is screwed to, than this [m]: more is a mistake."""


@dataclass(frozen=True, eq=False)
class HandEye:
    """Where the camera was when the picture was taken: beside the arm, or on its last link.

    Attributes:
        T_base_camera: pose of a camera that stands beside the arm, OpenCV axes; None for one on the arm.
        T_tool_camera: pose of a camera on the arm, in the frame of the link that the hand is mounted on.
        joints: of the arm when the picture was taken [rad]; only with a camera on the arm. None if they are said
            elsewhere.
    """

    T_base_camera: Float[np.ndarray, "4 4"] | None = None
    T_tool_camera: Float[np.ndarray, "4 4"] | None = None
    joints: Float[np.ndarray, "j"] | None = None

    @staticmethod
    def from_dict(entries: Any) -> "HandEye":
        """The entries of a hand-eye file: `T_base_camera`, or `T_tool_camera` and perhaps `joints`.

        A pose is a 4 x 4 matrix or the seven numbers x y z [m] qw qx qy qz.

        Raises:
            InputError: other entries, or a pose that is not rigid, is left-handed or not in metres.
        """
        names = set(entries) if isinstance(entries, dict) else set()
        if names == {BASE_CAMERA}:
            return HandEye(T_base_camera=_pose(entries[BASE_CAMERA], BASE_CAMERA, FARTHEST_CAMERA))
        if names in ({TOOL_CAMERA}, {TOOL_CAMERA, JOINTS}):
            pose = _pose(entries[TOOL_CAMERA], TOOL_CAMERA, FARTHEST_ON_TOOL)
            if JOINTS not in names:
                return HandEye(T_tool_camera=pose)
            try:
                return HandEye(T_tool_camera=pose, joints=np.array(entries[JOINTS], float).reshape(-1))
            except (TypeError, ValueError) as error:
                raise InputError(f"{JOINTS} must be numbers [rad], got {described(entries[JOINTS])}") from error
        got = ", ".join(sorted(map(str, names))) if names else described(entries)
        raise InputError(
            f"must hold {BASE_CAMERA} (a camera beside the arm), or {TOOL_CAMERA} and perhaps {JOINTS} (a camera on "
            f"the arm, and its joints in the picture), got {got}"
        )

    @staticmethod
    def read(path: str | Path) -> "HandEye":
        """The content of a YAML or JSON file, see `from_dict`.

        Raises:
            InputError: no such file.
            DataError: it cannot be read, or holds something else.
        """
        file = Path(path)
        if not file.is_file():
            raise InputError(f"no such hand-eye file: {file}")
        try:
            if file.stat().st_size > LARGEST_FILE:
                raise InputError(f"has {file.stat().st_size} bytes, a hand-eye file needs at most {LARGEST_FILE}")
            text = file.read_text()
            entries = json.loads(text) if file.suffix == ".json" else yaml.safe_load(text)
            return HandEye.from_dict(entries)
        except InputError as error:
            raise DataError(f"hand-eye file {file}: {error}") from error
        except (OSError, yaml.YAMLError, ValueError, RecursionError) as error:
            raise DataError(f"hand-eye file {file} cannot be read: {str(error).splitlines()[0][:200]}") from error

    def write(self, path: Path, notes: Sequence[str] = ()) -> None:
        """Writes the file, with notes as comments if it is YAML, and not JSON.

        Raises:
            InputError: the name ends otherwise.
            DataError: the system cannot write.
        """
        if path.suffix.lower() not in SUFFIXES:
            raise InputError(f"a hand-eye file ends in {', '.join(SUFFIXES)}, got {path.name!r}")
        values = {BASE_CAMERA: self.T_base_camera, TOOL_CAMERA: self.T_tool_camera, JOINTS: self.joints}
        entries = {name: value.round(9).tolist() for name, value in values.items() if value is not None}
        if path.suffix.lower() == ".json":
            text = json.dumps(entries, indent=1) + "\n"
        else:
            text = "".join(f"# {note}\n" for note in notes) + yaml.safe_dump(entries, default_flow_style=None)
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, text)

    def pose(self, arm: "Arm") -> Float[np.ndarray, "4 4"]:
        """T_base_camera when the picture was taken.

        Raises:
            InputError: a camera on the arm whose joints nobody told, or joints that are not those of this arm.
        """
        if self.T_base_camera is not None:
            return self.T_base_camera
        assert self.T_tool_camera is not None
        if self.joints is None:
            raise InputError("the camera is on the arm: give --joints, its joint positions in the picture")
        return arm.mount_pose(arm.check_joints(self.joints, JOINTS)) @ self.T_tool_camera


def _pose(value: Any, name: str, farthest: float) -> Float[np.ndarray, "4 4"]:
    pose = check_pose(value, name)
    distance = float(np.linalg.norm(pose[:3, 3]))
    if distance > farthest:
        raise InputError(f"{name} must be in metres: a camera {distance:g} m away is not within {farthest:g} m")
    return pose
