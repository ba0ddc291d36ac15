"""A parallel-jaw gripper, described by one YAML file (see `grippers/franka.yaml`)."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from icgnet.errors import DataError
from icgnet.geometry.transforms import make_transform

GRIPPERS = Path(__file__).parent / "grippers"


@dataclass(frozen=True)
class Box:
    """An axis-aligned box in the grasp frame: `centre` and full edge lengths `size` [m]."""

    centre: tuple[float, float, float]
    size: tuple[float, float, float]

    def shifted(self, y: float) -> "Box":
        """The box moved along the closing axis by `y` [m]."""
        return Box((self.centre[0], self.centre[1] + y, self.centre[2]), self.size)

    def mirrored(self) -> "Box":
        """The box turned by 180 degrees about the approach axis."""
        return Box((-self.centre[0], -self.centre[1], self.centre[2]), self.size)


@dataclass(frozen=True)
class Gripper:
    """What planning and simulation need to know of a parallel-jaw hand.

    The grasp frame lies midway between the finger tips: +z approach, +y closing. Boxes are given in it, those of the
    +y finger with the jaw closed (its pad in the plane y = 0); the other finger is its mirror image.

    Attributes:
        name: the gripper's name.
        max_opening: largest distance between the pads [m].
        finger_reach: how far the tips reach past a contact along the approach [m].
        clearance: free space beside each finger while approaching [m].
        finger_force: force of each finger [N].
        friction: sliding friction coefficient of the pads.
        T_grasp_base: pose of the base link that a robot driver moves, in the grasp frame.
        palm: boxes that do not move.
        finger: boxes of the +y finger, closed.
    """

    name: str
    max_opening: float
    finger_reach: float
    clearance: float
    finger_force: float
    friction: float
    T_grasp_base: Float[np.ndarray, "4 4"]
    palm: tuple[Box, ...]
    finger: tuple[Box, ...]

    def opening(self, widths: Float[np.ndarray, "*g"]) -> Float[np.ndarray, "*g"]:
        """Opening while approaching an object of these widths [m]: width and clearance, at most the largest."""
        return np.minimum(np.asarray(widths) + 2.0 * self.clearance, self.max_opening)

    def boxes(self, opening: float) -> tuple[Box, ...]:
        """All boxes of the hand in the grasp frame at this opening [m]: palm, +y finger, -y finger."""
        finger = tuple(box.shifted(opening / 2) for box in self.finger)
        return self.palm + finger + tuple(box.mirrored() for box in finger)

    def surface_points(self, opening: float, spacing: float = 0.008) -> Float[np.ndarray, "h 3"]:
        """Points on the hand's boxes, at most `spacing` [m] apart, in the grasp frame."""
        return np.concatenate([np.zeros((0, 3)), *(_box_surface(box, spacing) for box in self.boxes(opening))])


def _box_surface(box: Box, spacing: float) -> Float[np.ndarray, "h 3"]:
    counts = [int(np.ceil(edge / spacing)) + 1 for edge in box.size]
    axes = [np.linspace(-0.5, 0.5, count) for count in counts]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    on_surface = (np.abs(lattice) > 0.5 - 1e-9).any(axis=1)
    return np.asarray(box.centre) + lattice[on_surface] * np.asarray(box.size)


@lru_cache(maxsize=16)
def load_gripper(source: str | Path = "franka") -> Gripper:
    """The gripper of a YAML file, or one that ships with the package, by name.

    Raises:
        DataError: no such file or name, a missing or unknown entry, or a value out of range.
    """
    built_in = sorted(path.stem for path in GRIPPERS.glob("*.yaml"))
    path = GRIPPERS / f"{source}.yaml" if str(source) in built_in else Path(source)
    if not path.is_file():
        raise DataError(f"gripper {str(source)!r} is neither a file nor one of {built_in}")
    try:
        entries = yaml.safe_load(path.read_text())
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(f"gripper file {path} is not valid YAML: {str(error).splitlines()[0]}") from error
    return _parse(entries, path)


def _parse(entries: Any, path: Path) -> Gripper:
    numbers = ("max_opening", "finger_reach", "clearance", "finger_force", "friction")
    required = {"name", "base_offset", "palm", "finger", *numbers}
    if not isinstance(entries, dict) or set(entries) != required:
        given = sorted(entries) if isinstance(entries, dict) else type(entries).__name__
        raise DataError(f"gripper file {path} must have the entries {sorted(required)}, got {given}")
    try:
        values = {key: _parse_number(entries, key) for key in numbers}
        T_grasp_base = make_transform(np.eye(3), _parse_vector(entries, "base_offset"))
        palm, finger = _parse_boxes(entries["palm"]), _parse_boxes(entries["finger"])
    except (TypeError, ValueError, KeyError) as error:
        raise DataError(f"gripper file {path}: {error}") from error
    if values["max_opening"] > 0.5:
        raise DataError(f"gripper file {path}: max_opening is in metres, got {values['max_opening']}")
    return Gripper(name=str(entries["name"]), T_grasp_base=T_grasp_base, palm=palm, finger=finger, **values)


def _parse_number(entries: Any, key: str) -> float:
    value = entries[key]
    if not isinstance(value, int | float) or not 0 < value < 1000:
        raise ValueError(f"{key} must be a positive number, got {value!r}")
    return float(value)


def _parse_vector(entries: Any, key: str) -> Float[np.ndarray, "3"]:
    vector = np.array(entries[key], float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{key} must be three numbers [m], got {entries[key]!r}")
    return vector


def _parse_boxes(entries: Any) -> tuple[Box, ...]:
    boxes = []
    for entry in entries:
        if not isinstance(entry, dict) or set(entry) != {"lower", "upper"}:
            raise ValueError(f"a box needs the entries lower and upper, got {entry!r}")
        lower, upper = _parse_vector(entry, "lower"), _parse_vector(entry, "upper")
        if not (upper > lower).all():
            raise ValueError(f"a box needs lower < upper, got {entry!r}")
        boxes.append(Box(tuple(((lower + upper) / 2).tolist()), tuple((upper - lower).tolist())))
    return tuple(boxes)
