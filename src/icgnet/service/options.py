"""What a request may say beside its image or cloud: one table, of which reading, checking and OpenAPI are made."""

from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from icgnet.errors import InputError
from icgnet.geometry.arrays import described, real_array, real_number
from icgnet.settings import check_choice

ANSWERS = ("json", "npz", "csv")
RELEASES = ("drop", "place")
LARGEST_NUMBER = 1e9
LONGEST_QUERY = 8192
"""Longer query strings are refused [characters]."""


@dataclass(frozen=True)
class Option:
    """One option.

    Attributes:
        kind: of its value; numbers are a list, in a query string separated by commas.
        about: what it means, for OpenAPI and the guide.
        shapes: that a list of numbers may have; None stands for any length.
    """

    kind: Literal["number", "whole", "numbers", "flag", "text"]
    about: str
    shapes: tuple[tuple[int | None, ...], ...] = ()

    def schema(self) -> dict[str, Any]:
        """The value as OpenAPI describes it, in JSON."""
        kinds = {"number": "number", "whole": "integer", "numbers": "array", "flag": "boolean", "text": "string"}
        items = {"items": {}} if self.kind == "numbers" else {}
        return {"type": kinds[self.kind], "description": self.about, **items}

    def of_text(self, text: str, name: str) -> Any:
        """The value of a query string.

        Raises:
            InputError: it is of another kind.
        """
        try:
            match self.kind:
                case "text":
                    return text
                case "flag":
                    return {"true": True, "false": False}[text]
                case "whole":
                    return int(text)
                case "number":
                    return float(text)
                case "numbers":
                    return [float(part) for part in text.split(",")]
        except (KeyError, ValueError) as error:
            wanted = {"flag": "true or false", "numbers": "numbers separated by commas"}.get(
                self.kind, f"a {self.kind}"
            )
            wanted = "a whole number" if self.kind == "whole" else wanted
            raise InputError(f"{name} must be {wanted}, got {described(text)}") from error

    def checked(self, value: Any, name: str) -> Any:
        """The value as the predictor takes it.

        Raises:
            InputError: it is of another kind or shape.
        """
        if self.kind == "numbers":
            return self._array(value, name)
        if self.kind in ("flag", "text"):
            kind = bool if self.kind == "flag" else str
            if not isinstance(value, kind):
                raise InputError(
                    f"{name} must be {'true or false' if kind is bool else 'a text'}, got {described(value)}"
                )
            return value
        number = real_number(value, name, "", LARGEST_NUMBER)
        if self.kind == "number":
            return number
        if number != int(number):
            raise InputError(f"{name} must be a whole number, got {described(value)}")
        return int(number)

    def _array(self, value: Any, name: str) -> Float[np.ndarray, "..."]:
        *others, last = self.shapes
        for shape in others:
            with suppress(InputError):
                return real_array(value, name, shape)
        try:
            return real_array(value, name, last)
        except InputError as error:
            also = f"; shapes that are taken, too: {', '.join(map(str, others))}" if others else ""
            raise InputError(f"{error}{also}") from error


OPTIONS = {
    "intrinsics": Option(
        "numbers",
        "Camera matrix [pixels]: fx, fy, cx, cy, or 3 x 3, row by row. In an npz also K.",
        ((4,), (9,), (3, 3)),
    ),
    "depth_scale": Option("number", "Stored depth units per metre: 1000 for millimetres; 1 if not given."),
    "camera_pose": Option(
        "numbers",
        "T_world_camera (OpenCV axes, world z up): 4 x 4, row by row, or x y z [m] qw qx qy qz.",
        ((7,), (16,), (4, 4)),
    ),
    "viewpoint": Option("numbers", "Where the camera stood, in the frame of a cloud [m].", ((3,),)),
    "table_height": Option("number", "Height of the table plane in the world [m]; found if not given."),
    "level_table": Option("flag", "Multiply the depth with what brings the table to table_height."),
    "frame_id": Option("text", "How the world is called in the result."),
    "object_class": Option("text", "Grasps of objects of this class only."),
    "instance": Option(
        "whole", "Grasps of this object only, by the instance_id of an earlier answer to the same input."
    ),
    "region": Option("numbers", "Grasps in this box only: x y z of its lower, then of its upper corner [m].", ((6,),)),
    "limit": Option("whole", "At most so many grasps, the best ones."),
    "deadline_ms": Option(
        "number", "Time from the first byte of the request on [ms]: what is left of it is the budget."
    ),
    "answer": Option("text", "json; npz, with meshes and the instance mask; or csv, one line for each grasp."),
}
"""Of a prediction."""

PICK_OPTIONS = {
    "drop": Option("numbers", "Where the object is let go of: its lowest point, x y z in the world [m].", ((3,),)),
    "joints": Option(
        "numbers", "Of the arm when the picture was taken [rad]; with a camera on the arm only.", ((None,),)
    ),
    "start": Option(
        "numbers", "Joint positions from which the arm starts and to which it returns [rad]; else its home.", ((None,),)
    ),
    "release": Option("text", "drop, or place: lower the object onto the drop-off point; else as the service says."),
    **{name: option for name, option in OPTIONS.items() if name not in ("viewpoint", "limit", "answer")},
}
"""Of a pick."""


def options_of_query(pairs: Iterable[tuple[str, str]], table: Mapping[str, Option] = OPTIONS) -> dict[str, Any]:
    """The values of a query string.

    Args:
        pairs: names and texts.
        table: the options that there are.

    Raises:
        InputError: an unknown name, one that is given twice, or a value of another kind.
    """
    values: dict[str, Any] = {}
    for name, text in pairs:
        if name in values:
            raise InputError(f"{described(name)} is given twice")
        values[name] = known_option(name, table).of_text(text, name)
    return values


def known_option(name: str, table: Mapping[str, Option] = OPTIONS) -> Option:
    """The option of this name.

    Raises:
        InputError: there is none; the message names those that there are.
    """
    if name not in table:
        raise InputError(f"no option {described(name)}; the options are {', '.join(table)}")
    return table[name]


def checked_options(values: Mapping[str, Any], table: Mapping[str, Option] = OPTIONS) -> dict[str, Any]:
    """The values as the predictor takes them, without those that are None.

    Args:
        values: by name.
        table: the options that there are.

    Raises:
        InputError: an unknown name, or a value of another kind, shape or range.
    """
    given = {name: value for name, value in values.items() if value is not None}
    checked = {name: known_option(name, table).checked(value, name) for name, value in given.items()}
    for name, valid in (("answer", ANSWERS), ("release", RELEASES)):
        if name in checked:
            check_choice(name, checked[name], valid)
    for name, least in (("limit", 0), ("instance", 0), ("deadline_ms", 1.0)):
        if checked.get(name, least) < least:
            raise InputError(f"{name} must be at least {least:g}, got {checked[name]:g}")
    return checked
