"""Where the arm was at each picture: a YAML, JSON or CSV file."""

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from icgnet.errors import DataError, InputError
from icgnet.geometry.arrays import described, real_array
from icgnet.geometry.transforms import check_pose

IMAGE, POSE, POSITION, QUATERNION, JOINTS = "image", "T_base_tool", "position", "quaternion_xyzw", "joints"
FORMS = ({POSE}, {POSITION, QUATERNION}, {JOINTS})
"""What an entry may hold beside the name of the picture."""
COLUMNS = ("image", "x", "y", "z", "qx", "qy", "qz", "qw")
"""Of a CSV file."""
LARGEST_FILE = 10_000_000
"""Size of a file with poses at most [bytes]."""
FARTHEST_TOOL = 5.0
"""No arm reaches farther [m]: more is a mistake in the unit."""

Pose = Float[np.ndarray, "4 4"]


def read_poses(path: Path, from_joints: Callable[[Any], Pose] | None = None) -> dict[str, Pose]:
    """T_base_tool at each picture, by the name of the picture: the link that carries the hand, in the arm's base.

    A YAML or JSON file is a list of entries with `image` and one of `T_base_tool` (4 x 4, or x y z [m] qw qx qy qz),
    `position` [m] with `quaternion_xyzw`, or `joints` [rad]. A CSV file has the columns image, x, y, z, qx, qy, qz, qw.

    Args:
        path: the file.
        from_joints: T_base_tool of joint positions; None if nobody knows the arm.

    Raises:
        InputError: no such file.
        DataError: it cannot be read, or an entry is none; the message names it.
    """
    if not path.is_file():
        raise InputError(f"no such file with poses: {path}")
    try:
        entries = _entries(path)
        poses: dict[str, Pose] = {}
        for number, entry in enumerate(entries, 1):
            name, pose = _read(entry, f"entry {number}", from_joints)
            if name in poses:
                raise InputError(f"entry {number}: there is a pose for {name} already")
            poses[name] = pose
        return poses
    except InputError as error:
        raise DataError(f"{path}: {error}") from error
    except (OSError, yaml.YAMLError, csv.Error, ValueError, RecursionError) as error:
        raise DataError(f"{path} cannot be read: {(str(error).splitlines() or ['?'])[0][:200]}") from error


def _entries(path: Path) -> list[Any]:
    if path.stat().st_size > LARGEST_FILE:
        raise InputError(f"has {path.stat().st_size} bytes, {LARGEST_FILE} at most are read")
    if path.suffix.lower() == ".csv":
        with path.open(newline="") as file:
            rows = csv.DictReader(file, skipinitialspace=True)
            if set(rows.fieldnames or ()) != set(COLUMNS):
                raise InputError(f"must have the columns {', '.join(COLUMNS)}, got {', '.join(rows.fieldnames or ())}")
            return [_of_row(row, number) for number, row in enumerate(rows, 1)]
    text = path.read_text()
    entries = json.loads(text) if path.suffix.lower() == ".json" else yaml.safe_load(text)
    if not isinstance(entries, list):
        raise InputError(f"must be a list of entries with image and T_base_tool, got {described(entries)}")
    return entries


def _of_row(row: dict[str, str], number: int) -> dict[str, Any]:
    try:
        values = [float(row[name]) for name in COLUMNS[1:]]
    except (TypeError, ValueError) as error:
        raise InputError(f"entry {number}: {', '.join(COLUMNS[1:])} must be numbers, got {described(row)}") from error
    return {IMAGE: row[IMAGE], POSITION: values[:3], QUATERNION: values[3:]}


def _read(entry: Any, where: str, from_joints: Callable[[Any], Pose] | None) -> tuple[str, Pose]:
    """Name of the picture and pose of an entry.

    Raises:
        InputError: it is none; the message says where.
    """
    names = set(entry) if isinstance(entry, dict) else set()
    if not isinstance(entry, dict) or names - {IMAGE} not in FORMS or not isinstance(entry.get(IMAGE), str):
        forms = "; ".join(" and ".join(sorted(form)) for form in FORMS)
        raise InputError(f"{where} must have image and one of ({forms}), got {described(entry)}")
    name = entry[IMAGE]
    where = f"{where} ({name})"
    if JOINTS in entry:
        if from_joints is None:
            raise InputError(f"{where} has joints: say with --arm of which arm they are")
        return name, from_joints(entry[JOINTS])
    value = entry.get(POSE)
    if value is None:
        x, y, z = real_array(entry[POSITION], f"{where}: {POSITION}", (3,))
        qx, qy, qz, qw = real_array(entry[QUATERNION], f"{where}: {QUATERNION}", (4,))
        value = [x, y, z, qw, qx, qy, qz]
    pose = check_pose(value, f"{where}: {POSE}")
    away = float(np.linalg.norm(pose[:3, 3]))
    if away > FARTHEST_TOOL:
        raise InputError(f"{where}: {POSE} must be in metres: {away:g} m is farther than an arm reaches")
    return name, pose
