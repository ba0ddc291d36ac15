"""A parallel-jaw gripper, described by one YAML file (see `grippers/franka.yaml`).

The same entries, plain values, describe it in manifests, recipes, weights and saved predictions: `Gripper.to_dict` and
`Gripper.from_dict` are the only way there and back.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from reprlib import Repr
from typing import Any

import numpy as np
import yaml
from jaxtyping import Float

from icgnet.errors import DataError, InputError

GRIPPERS = Path(__file__).parent / "grippers"
LARGEST_FILE = 100_000
"""Size of a gripper file at most [bytes]."""
DIGITS = 9
"""Lengths of boxes are kept to the nanometre, so that corners and centres lead to each other exactly."""
TOUCH = 1e-6
"""Boxes whose faces are this near to each other touch [m]."""
MATING_DEPTH = 0.015
"""How far a finger may reach back into the palm, as on a rail that it slides on [m]."""
MOST_BOXES = 64
LARGEST_HAND = 0.5
"""No part of a hand is further from the grasp than this, along any axis [m]: more is a mistake in the unit."""
SMALLEST_EDGE = 0.0001
RANGES = {
    "max_opening": (0.005, 0.5, " m"),
    "finger_reach": (0.0005, 0.05, " m"),
    "clearance": (0.0005, 0.05, " m"),
    "finger_force": (0.1, 1000.0, " N"),
    "friction": (0.01, 10.0, ""),
}
"""Smallest and largest valid value of each number, and its unit."""


@dataclass(frozen=True)
class Box:
    """An axis-aligned box in the grasp frame: `centre` and full edge lengths `size` [m]."""

    centre: tuple[float, float, float]
    size: tuple[float, float, float]

    def shifted(self, y: float) -> "Box":
        """The box moved along the closing axis by `y` [m]."""
        return Box((self.centre[0], self.centre[1] + y, self.centre[2]), self.size)

    def corners(self) -> dict[str, list[float]]:
        """The lowest and the highest corner [m], as in a gripper file."""
        pairs = list(zip(self.centre, self.size, strict=True))
        lower = [round(centre - size / 2, DIGITS) for centre, size in pairs]
        return {"lower": lower, "upper": [round(centre + size / 2, DIGITS) for centre, size in pairs]}

    def swept(self, approach: float) -> "Box":
        """What the box covers while it comes in straight along the approach axis, over this distance [m]."""
        (x, y, z), (length, depth, height) = self.centre, self.size
        return Box((x, y, z - approach / 2), (length, depth, height + approach))

    def opened(self, way: float) -> "Box":
        """What the box of a +y finger covers while the finger opens by `way` [m]."""
        (x, y, z), (length, depth, height) = self.centre, self.size
        return Box((x, y + way / 2, z), (length, depth + way, height))

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
        base_offset: origin of the base link that a robot driver moves, in the grasp frame [m].
        palm: boxes that do not move.
        finger: boxes of the +y finger, closed.
        base_quaternion: orientation of the base link in the grasp frame, wxyz.
    """

    name: str
    max_opening: float
    finger_reach: float
    clearance: float
    finger_force: float
    friction: float
    base_offset: tuple[float, float, float]
    palm: tuple[Box, ...]
    finger: tuple[Box, ...]
    base_quaternion: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    @property
    def T_grasp_base(self) -> Float[np.ndarray, "4 4"]:
        """Pose of the base link that a robot driver moves, in the grasp frame."""
        # Imported here, because settings know their hand and must not wait for scipy.
        from icgnet.geometry.transforms import make_transform, quaternion_to_matrix

        return make_transform(quaternion_to_matrix(np.array(self.base_quaternion)), np.array(self.base_offset))

    def to_dict(self) -> dict[str, Any]:
        """The entries of a gripper file, plain values for JSON or YAML."""
        return {
            "name": self.name,
            **{key: getattr(self, key) for key in RANGES},
            "base_offset": list(self.base_offset),
            "base_quaternion": list(self.base_quaternion),
            "palm": [box.corners() for box in self.palm],
            "finger": [box.corners() for box in self.finger],
        }

    @classmethod
    def from_dict(cls, entries: Any) -> "Gripper":
        """The gripper of `to_dict` or of a gripper file; without `base_quaternion` the base link is not turned.

        Raises:
            InputError: a missing or unknown entry, a value of the wrong type or out of range, or boxes that make no
                hand: the message names the entry, its value and what is valid.
        """
        required = {"name", "base_offset", "palm", "finger", *RANGES}
        if not isinstance(entries, dict):
            raise InputError(f"must have the entries {', '.join(sorted(required))}; got {_shown(entries)}")
        missing, unknown = required - set(entries), set(entries) - required - {"base_quaternion"}
        if missing or unknown:
            told = [f"{', '.join(sorted(missing))} missing"] * bool(missing)
            told += [f"{', '.join(sorted(map(_shown, unknown)))[:200]} unknown"] * bool(unknown)
            raise InputError(
                f"must have the entries {', '.join(sorted(required))}, and may have base_quaternion: {', '.join(told)}"
            )
        x, y, z = _parse_numbers(entries, "base_offset", 3, 1.0)
        gripper = cls(
            name=_parse_name(entries["name"]),
            base_offset=(x, y, z),
            base_quaternion=_parse_quaternion(entries.get("base_quaternion", [1.0, 0.0, 0.0, 0.0])),
            palm=_parse_boxes(entries["palm"], "palm", fewest=0),
            finger=_parse_boxes(entries["finger"], "finger", fewest=1),
            **{key: _parse_number(entries, key) for key in RANGES},
        )
        _check_shape(gripper)
        return gripper

    def same_hand(self, other: "Gripper") -> bool:
        """Whether both make the same labels: all numbers but the name and where the base link is."""
        return not self.differences(other)

    def differences(self, other: "Gripper") -> list[str]:
        """In what this hand differs from another, one phrase each, name and base link left out."""
        mine, theirs = self.to_dict(), other.to_dict()
        numbers = [f"{key} {mine[key]:g} instead of {theirs[key]:g}" for key in RANGES if mine[key] != theirs[key]]
        return numbers + [f"other boxes of the {key}" for key in ("palm", "finger") if mine[key] != theirs[key]]

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


def extents(boxes: Sequence[Box]) -> tuple[float, float, float]:
    """Edges of the box around at least one box [m]."""
    corners = [box.corners() for box in boxes]
    x, y, z = (
        max(each["upper"][axis] for each in corners) - min(each["lower"][axis] for each in corners) for axis in range(3)
    )
    return x, y, z


def _box_surface(box: Box, spacing: float) -> Float[np.ndarray, "h 3"]:
    counts = [int(np.ceil(edge / spacing)) + 1 for edge in box.size]
    axes = [np.linspace(-0.5, 0.5, count) for count in counts]
    lattice = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    on_surface = (np.abs(lattice) > 0.5 - 1e-9).any(axis=1)
    return np.asarray(box.centre) + lattice[on_surface] * np.asarray(box.size)


def load_gripper(source: str | Path = "franka") -> Gripper:
    """The gripper of a YAML file, or one that ships with the package, by name.

    Raises:
        DataError: no such file or name, or a file that does not describe a hand: see `Gripper.from_dict`.
    """
    built_in = sorted(path.stem for path in GRIPPERS.glob("*.yaml"))
    path = GRIPPERS / f"{source}.yaml" if str(source) in built_in else Path(source)
    try:
        is_file = path.is_file()
    except (OSError, ValueError):  # a name that no file can have
        is_file = False
    if not is_file:
        raise DataError(f"gripper {_shown(str(source))} is neither a file nor one of {built_in}")
    try:
        return Gripper.from_dict(_read_yaml(path))
    except InputError as error:
        raise DataError(f"gripper file {path}: {error}") from error


def _read_yaml(path: Path) -> Any:
    try:
        if path.stat().st_size > LARGEST_FILE:
            raise DataError(f"gripper file {path} has {path.stat().st_size} bytes, a hand needs at most {LARGEST_FILE}")
        return yaml.safe_load(path.read_text())
    except OSError as error:
        raise DataError(f"gripper file {path} cannot be read: {error.strerror or error}") from error
    except (yaml.YAMLError, ValueError, RecursionError, TypeError) as error:  # what PyYAML raises on broken files
        mark, problem = getattr(error, "problem_mark", None), getattr(error, "problem", None)
        where = f" in line {mark.line + 1}" if mark else ""
        said = problem or str(error).split("\n")[0]
        raise DataError(f"gripper file {path} is not valid YAML{where}: {_shown(said)}") from error


_REPR = Repr()
_REPR.maxlevel, _REPR.maxdict, _REPR.maxlist, _REPR.maxtuple = 3, 4, 16, 16
_REPR.maxstring, _REPR.maxother, _REPR.maxlong = 80, 80, 40


def _shown(value: Any) -> str:
    """A value for a message: on one line and short, whatever it is."""
    text = _REPR.repr(value)
    return text if len(text) <= 300 else text[:300] + "..."


def _parse_name(value: Any) -> str:
    if not isinstance(value, str) or not 0 < len(value) <= 60 or not value.isprintable():
        raise InputError(f"name must be a printable text of 1 to 60 letters, got {_shown(value)}")
    return value


def _is_number(value: Any, least: float, most: float) -> bool:
    # The comparison is false for NaN, and right for integers of any size.
    return isinstance(value, int | float) and not isinstance(value, bool) and least <= value <= most


def _parse_number(entries: dict[str, Any], key: str) -> float:
    least, most, unit = RANGES[key]
    if not _is_number(entries[key], least, most):
        raise InputError(f"{key} must be a number from {least:g} to {most:g}{unit}, got {_shown(entries[key])}")
    return float(entries[key])


def _parse_numbers(entries: dict[str, Any], key: str, count: int, largest: float, what: str = "") -> list[float]:
    values = entries[key]
    if (
        not isinstance(values, list | tuple)
        or len(values) != count
        or not all(_is_number(value, -largest, largest) for value in values)
    ):
        unit = "" if count == 4 else " m"
        names = {3: "three", 4: "four"}
        raise InputError(
            f"{what}{key} must be {names[count]} numbers from {-largest:g} to {largest:g}{unit}, got {_shown(values)}"
        )
    return [float(value) for value in values]


def _parse_quaternion(value: Any) -> tuple[float, float, float, float]:
    w, x, y, z = _parse_numbers({"base_quaternion": value}, "base_quaternion", 4, 1.0)
    if abs(w * w + x * x + y * y + z * z - 1.0) > 2e-3:
        raise InputError(f"base_quaternion must be [w, x, y, z] of length 1, got {_shown(value)}")
    return w, x, y, z


def _parse_boxes(entries: Any, part: str, fewest: int) -> tuple[Box, ...]:
    if not isinstance(entries, list | tuple) or not fewest <= len(entries) <= MOST_BOXES:
        raise InputError(f"{part} must be a list of {fewest} to {MOST_BOXES} boxes, got {_shown(entries)}")
    return tuple(_parse_box(entry, f"{part} box {number}: ") for number, entry in enumerate(entries, 1))


def _parse_box(entry: Any, what: str) -> Box:
    if not isinstance(entry, dict) or set(entry) != {"lower", "upper"}:
        raise InputError(f"{what}a box needs the entries lower and upper, got {_shown(entry)}")
    lower, upper = (
        [round(value, DIGITS) for value in _parse_numbers(entry, key, 3, LARGEST_HAND, what)]
        for key in ("lower", "upper")
    )
    if any(high - low < SMALLEST_EDGE for low, high in zip(lower, upper, strict=True)):
        raise InputError(f"{what}a box needs lower < upper, by {SMALLEST_EDGE:g} m or more, got {_shown(entry)}")
    ends = np.array(lower), np.array(upper)
    return Box(tuple(((ends[0] + ends[1]) / 2).tolist()), tuple((ends[1] - ends[0]).tolist()))


def _check_shape(gripper: Gripper) -> None:
    """Makes sure that the boxes make a hand whose fingers close on each other in front of a palm.

    Raises:
        InputError: they do not.
    """
    if 2.0 * gripper.clearance > gripper.max_opening:
        raise InputError(
            f"clearance must be at most half of max_opening ({gripper.max_opening:g} m), got {gripper.clearance:g} m"
        )
    finger, palm = ([box.corners() for box in boxes] for boxes in (gripper.finger, gripper.palm))
    for number, box in enumerate(finger, 1):
        if box["lower"][1] < -TOUCH:
            raise InputError(
                f"finger box {number} reaches to y = {box['lower'][1]:g} m: the finger is the one on the +y side, with "
                "the jaw closed, so that no box of it goes below y = 0"
            )
    pad = min(box["lower"][1] for box in finger)
    if pad > TOUCH:
        raise InputError(f"the pad must lie in the plane y = 0 when the jaw is closed, the finger begins at {pad:g} m")
    tip, rear = max(box["upper"][2] for box in finger), min(box["lower"][2] for box in finger)
    if abs(tip) > TOUCH:
        raise InputError(f"the finger must end in the tip at z = 0, its boxes end at z = {tip:g} m")
    if -rear <= gripper.finger_reach:
        raise InputError(
            f"finger_reach must be less than the length of the finger ({-rear:g} m), got {gripper.finger_reach:g} m"
        )
    for number, box in enumerate(palm, 1):
        if box["upper"][2] > -gripper.finger_reach:
            raise InputError(
                f"palm box {number} reaches to z = {box['upper'][2]:g} m: the fingers must stand out of the palm by "
                f"more than finger_reach ({gripper.finger_reach:g} m)"
            )
    for (i, own), (j, other) in itertools.product(enumerate(gripper.finger, 1), enumerate(gripper.palm, 1)):
        way = own.opened(gripper.max_opening / 2)
        for side, swept in (("+y", way), ("-y", way.mirrored())):
            depth = _depth_along_approach(swept, other)
            if depth > MATING_DEPTH + TOUCH:
                raise InputError(
                    f"box {i} of the {side} finger goes {depth:g} m deep into palm box {j} between open and closed: at "
                    f"most {MATING_DEPTH:g} m may"
                )


def _depth_along_approach(finger: Box, palm: Box) -> float:
    """How far two boxes overlap along z [m]; 0 where they do not overlap at all."""
    ours, theirs = finger.corners(), palm.corners()
    shared = [
        min(ours["upper"][axis], theirs["upper"][axis]) - max(ours["lower"][axis], theirs["lower"][axis])
        for axis in range(3)
    ]
    return shared[2] if min(shared) > TOUCH else 0.0
