"""Checks that all settings share: frozen dataclasses say what is valid in their types, and these hold them to it."""

import math
from dataclasses import fields
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from icgnet.errors import InputError


def check_choices(settings: Any) -> None:
    """Makes sure that every field of a dataclass whose type is a `Literal` (or None) holds one of its values.

    Raises:
        InputError: it does not; the message names the field, its value and the valid ones.
    """
    hints = get_type_hints(type(settings))
    for field in fields(settings):
        valid = _choices(hints[field.name])
        value = getattr(settings, field.name)
        if valid and value not in valid:
            names = ", ".join(str(each) for each in valid if each is not None)
            raise InputError(f"{field.name} must be one of {names}, got {value!r}")


def check_range(settings: Any, least: float, *names: str, above: bool = False, most: float = math.inf) -> None:
    """Makes sure that fields of a dataclass, where they are not None, are finite numbers in a range.

    Args:
        settings: the dataclass.
        least: smallest valid value.
        names: of the fields.
        above: whether `least` itself is not valid.
        most: largest valid value.

    Raises:
        InputError: one is not; the message names the field, its value and the range.
    """
    for name in names:
        value = getattr(settings, name)
        if value is None:
            continue
        is_number = isinstance(value, int | float) and math.isfinite(value)
        if not is_number or value > most or value < least or (above and value == least):
            wanted = f"above {least:g}" if above else f"at least {least:g}"
            limit = "" if most == math.inf else f" and at most {most:g}"
            raise InputError(f"{name} must be a number {wanted}{limit}, got {value!r}")


def _choices(hint: Any) -> tuple[Any, ...]:
    """The values that a type allows if it is a `Literal`, also beside None; else none."""
    if get_origin(hint) is Literal:
        return get_args(hint)
    if get_origin(hint) in (Union, UnionType):
        parts = [part for part in get_args(hint) if part is not type(None)]
        if len(parts) == 1 and (valid := _choices(parts[0])):
            return (*valid, None)
    return ()
