"""Checks that all settings share: frozen dataclasses say what is valid in their types, and these hold them to it."""

import math
from dataclasses import fields, is_dataclass
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from icgnet.errors import InputError

Settings = TypeVar("Settings")
_LARGEST = 1e300
"""Settings are below this; an integer of hundreds of digits is no float."""


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
        is_number = isinstance(value, int | float) and -math.inf < value < math.inf
        if not is_number or value > most or value < least or (above and value == least):
            wanted = f"above {least:g}" if above else f"at least {least:g}"
            limit = "" if most == math.inf else f" and at most {most:g}"
            raise InputError(f"{name} must be {wanted}{limit}, got {value!r}")


def read_settings(kind: type[Settings], values: Any, name: str = "") -> Settings:
    """The dataclass of plain values, as `asdict` and JSON give them; lists become tuples.

    Its fields are flags, numbers, texts, `Literal`s, tuples of these, dataclasses of such fields, or of a class that
    reads itself with `from_dict`.

    Args:
        kind: the dataclass.
        values: one for each of its fields, by name.
        name: of the whole, for the message.

    Raises:
        InputError: a missing or unknown field, or a value of another type: the message names it.
    """
    hints = get_type_hints(kind)
    names = {field.name for field in fields(kind)}  # pyright: ignore[reportArgumentType]
    if not isinstance(values, dict) or set(values) != names:
        differ = sorted(map(str, set(values) ^ names)) if isinstance(values, dict) else type(values).__name__
        raise InputError(f"{name or 'settings'}: the fields differ from {kind.__name__}: {str(differ)[:200]}")
    prefix = f"{name}." if name else ""
    return kind(**{key: _of_type(hints[key], value, prefix + key) for key, value in values.items()})


def _of_type(hint: Any, value: Any, name: str) -> Any:
    """The value as one of this type, or an `InputError`."""
    if get_origin(hint) in (Union, UnionType) and type(None) in get_args(hint):
        return None if value is None else _of_type(_without_none(hint), value, name)
    if hasattr(hint, "from_dict"):
        return hint.from_dict(value)
    if is_dataclass(hint) and isinstance(hint, type):
        return read_settings(hint, value, name)
    if get_origin(hint) is tuple and isinstance(value, list | tuple):
        kinds = get_args(hint)
        kinds = kinds[:1] * len(value) if kinds[1:] == (...,) else kinds
        if len(kinds) == len(value):
            return tuple(_of_type(each, item, name) for each, item in zip(kinds, value, strict=True))
    elif get_origin(hint) is Literal:
        if isinstance(value, str | int) and value in get_args(hint):
            return value
    elif isinstance(value, bool):
        if hint is bool:
            return value
    elif hint is float and isinstance(value, int | float) and -_LARGEST < value < _LARGEST:
        return float(value)
    elif hint in (int, str) and isinstance(value, hint):
        return value
    wanted = hint.__name__ if isinstance(hint, type) and not get_args(hint) else str(hint).replace("typing.", "")
    raise InputError(f"{name} must be of type {wanted}, got {repr(value)[:80]}")


def _without_none(hint: Any) -> Any:
    """What a type is beside None."""
    return Union[tuple(part for part in get_args(hint) if part is not type(None))]  # noqa: UP007


def _choices(hint: Any) -> tuple[Any, ...]:
    """The values that a type allows if it is a `Literal`, also beside None; else none."""
    if get_origin(hint) is Literal:
        return get_args(hint)
    if get_origin(hint) in (Union, UnionType):
        parts = [part for part in get_args(hint) if part is not type(None)]
        if len(parts) == 1 and (valid := _choices(parts[0])):
            return (*valid, None)
    return ()


def check_choice(name: str, value: Any, valid: tuple[Any, ...]) -> Any:
    """Returns the value if it is one of the valid ones.

    Raises:
        InputError: it is not; the message names it and the valid ones.
    """
    if value not in valid:
        raise InputError(f"{name} must be one of {', '.join(map(str, valid))}, got {value!r}")
    return value
