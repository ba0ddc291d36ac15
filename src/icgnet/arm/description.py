"""An arm, described by one YAML file (see `arms/fr3.yaml`): what its URDF leaves open."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import yaml
from jaxtyping import Float

from icgnet.arm.libraries import get_package_share_dir
from icgnet.errors import DataError, InputError
from icgnet.geometry.arrays import described, real_array
from icgnet.geometry.transforms import make_transform, quaternion_to_matrix
from icgnet.settings import check_choice

ARMS = Path(__file__).parent / "arms"
REQUIRED = ("name", "urdf", "mount", "home", "acceleration")
OPTIONAL = ("srdf", "packages", "base", "lower", "upper", "velocity", "solver")
SOLVERS = ("franka", "numerical")
LARGEST_FILE = 100_000
"""Size of an arm file at most [bytes]."""
FARTHEST = 10.0
"""No part of an arm is farther from another [m]: more is a mistake in the unit."""
PACKAGE = "package://"

Solver = Literal["franka", "numerical"]


@dataclass(frozen=True, eq=False)
class ArmDescription:
    """What is known of an arm beside its URDF. Joint values are in the order of the joints from base to hand.

    Attributes:
        name: of the arm.
        urdf: file with links, joints and collision geometry.
        srdf: file that says which links never meet; None if there is none.
        packages: folders in which the packages of `package://` names lie.
        mount_link: link that the hand is mounted on.
        T_link_mount: where the base link of the hand sits on it.
        T_world_base: where the arm stands in a world with z up.
        home: where the arm starts and ends [rad].
        acceleration: largest acceleration [rad/s^2].
        lower: lowest joint position that is used [rad]; None for that of the URDF.
        upper: highest joint position that is used [rad]; None for that of the URDF.
        velocity: largest speed [rad/s]; None for that of the URDF.
        solver: of the inverse kinematics: closed formulas for arms of Franka, numerical for any.
    """

    name: str
    urdf: Path
    srdf: Path | None
    packages: tuple[Path, ...]
    mount_link: str
    T_link_mount: Float[np.ndarray, "4 4"]
    T_world_base: Float[np.ndarray, "4 4"]
    home: Float[np.ndarray, "j"]
    acceleration: Float[np.ndarray, "j"]
    lower: Float[np.ndarray, "j"] | None = None
    upper: Float[np.ndarray, "j"] | None = None
    velocity: Float[np.ndarray, "j"] | None = None
    solver: Solver = "numerical"


def read_description(source: str | Path = "fr3") -> ArmDescription:
    """The arm of a YAML file, or one that ships with the package, by name.

    Raises:
        DataError: no such file or name, or a file that does not describe an arm; the message names the entry.
    """
    built_in = sorted(path.stem for path in ARMS.glob("*.yaml"))
    path = ARMS / f"{source}.yaml" if str(source) in built_in else Path(source)
    if not path.is_file():
        raise DataError(f"arm {str(source)[:200]!r} is neither a file nor one of {built_in}")
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise InputError(f"has {path.stat().st_size} bytes, an arm needs at most {LARGEST_FILE}")
        return _parse(yaml.safe_load(path.read_text()), path.parent)
    except InputError as error:
        raise DataError(f"arm file {path}: {error}") from error
    except (OSError, yaml.YAMLError, ValueError, RecursionError) as error:
        raise DataError(f"arm file {path} cannot be read: {str(error).splitlines()[0][:200]}") from error


def _parse(entries: Any, folder: Path) -> ArmDescription:
    """The description in the entries of a YAML file in this folder.

    Raises:
        InputError: a missing or unknown entry, or a value of the wrong type.
    """
    if not isinstance(entries, dict):
        raise InputError(f"must have the entries {', '.join(REQUIRED)}, got {described(entries)}")
    missing, unknown = set(REQUIRED) - set(entries), set(map(str, entries)) - {*REQUIRED, *OPTIONAL}
    if missing or unknown:
        told = [f"{', '.join(sorted(missing))} missing"] * bool(missing)
        told += [f"{', '.join(sorted(unknown))[:200]} unknown"] * bool(unknown)
        raise InputError(
            f"must have the entries {', '.join(REQUIRED)}, may have {', '.join(OPTIONAL)}: {', '.join(told)}"
        )
    given = entries.get("packages") or []
    if not isinstance(given, list):
        raise InputError(f"packages must be a list of folders, got {described(given)}")
    packages = tuple(folder / str(each) for each in given) + (Path(get_package_share_dir()),)
    home = real_array(entries["home"], "home", (None,))
    mount = entries["mount"]
    if not isinstance(mount, dict) or not isinstance(mount.get("link"), str):
        raise InputError(f"mount must have the entries link, position and quaternion, got {described(mount)}")

    def joints(name: str) -> Any:
        return None if entries.get(name) is None else real_array(entries[name], name, (len(home),))

    return ArmDescription(
        name=str(entries["name"])[:60],
        urdf=_file(entries["urdf"], "urdf", folder, packages),
        srdf=None if entries.get("srdf") is None else _file(entries["srdf"], "srdf", folder, packages),
        packages=packages,
        mount_link=mount["link"],
        T_link_mount=_pose({key: mount.get(key) for key in ("position", "quaternion")}, "mount"),
        T_world_base=_pose(entries.get("base", {"position": [0, 0, 0], "quaternion": [1, 0, 0, 0]}), "base"),
        home=home,
        acceleration=_positive(real_array(entries["acceleration"], "acceleration", (len(home),)), "acceleration"),
        lower=joints("lower"),
        upper=joints("upper"),
        velocity=_positive(joints("velocity"), "velocity"),
        solver=check_choice("solver", entries.get("solver", "numerical"), SOLVERS),
    )


def _positive(values: Any, name: str) -> Any:
    if values is not None and not (values > 0).all():
        raise InputError(f"{name} must be above 0 for every joint, got {values.tolist()}")
    return values


def _file(value: Any, name: str, folder: Path, packages: tuple[Path, ...]) -> Path:
    """The file of a name that is relative to the folder of the arm file or to a package."""
    text = str(value)
    places = [each / text.removeprefix(PACKAGE) for each in packages] if text.startswith(PACKAGE) else [folder / text]
    found = next((place for place in places if place.is_file()), None)
    if found is None:
        raise InputError(f"{name}: no such file: {text[:200]}")
    return found


def _pose(entry: Any, name: str) -> Float[np.ndarray, "4 4"]:
    if not isinstance(entry, dict) or set(entry) != {"position", "quaternion"}:
        raise InputError(f"{name} must have the entries position and quaternion, got {described(entry)}")
    position = real_array(entry["position"], f"{name}: position", (3,))
    quaternion = real_array(entry["quaternion"], f"{name}: quaternion", (4,))
    if abs(float(np.linalg.norm(quaternion)) - 1.0) > 1e-2:
        raise InputError(f"{name}: quaternion must be [w, x, y, z] of length 1, got {quaternion.tolist()}")
    if np.abs(position).max() > FARTHEST:
        raise InputError(f"{name}: position must be in metres, within {FARTHEST:g} m, got {position.tolist()}")
    return make_transform(quaternion_to_matrix(quaternion), position)
