"""The one door for arrays and numbers that callers hand in: whatever is not what it claims to be is one clear error."""

import reprlib
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from icgnet.errors import InputError

FARTHEST = 100.0
"""Cameras and tables are nearer than this to the origin of their frame [m]; farther means another unit."""
SHORT = 16
"""Arrays of so many numbers at most are repeated in a message whole."""
NAMED = 60
"""So many characters of a value are repeated in a message."""


def real_array(value: Any, name: str, shape: tuple[int | None, ...], finite: bool = True) -> Float[np.ndarray, "..."]:
    """Real numbers as a new float64 array; masked entries become NaN.

    Args:
        value: whatever the caller gave.
        name: how the caller calls it, for the message.
        shape: length of every axis, None for any.
        finite: whether NaN and infinity are refused.

    Raises:
        InputError: text, ragged lists, objects, records, complex numbers, truth values, another shape, or numbers that
            are not finite where they must be.
    """
    array = _array(value, name, f"real numbers of shape {_shape(shape)}")
    if array.dtype.kind not in "fiu":
        raise InputError(f"{name} must be real numbers of shape {_shape(shape)}, got {described(value)}")
    fits = array.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, array.shape, strict=True))
    if not fits:
        raise InputError(f"{name} must have shape {_shape(shape)}, got {array.shape}")
    with np.errstate(over="ignore"):  # long doubles
        numbers = np.ma.getdata(array).astype(np.float64)
    if np.ma.isMaskedArray(array):
        numbers[np.ma.getmaskarray(array)] = np.nan
    if finite and not np.isfinite(numbers).all():
        given = numbers.tolist() if numbers.size <= SHORT else described(value)
        raise InputError(f"{name} must be finite, got {given}")
    return np.asarray(numbers)


def real_number(value: Any, name: str, unit: str = "m", largest: float = FARTHEST) -> float:
    """A finite real number as a float.

    Raises:
        InputError: no real number, not finite, or of a magnitude above `largest`.
    """
    number = float(real_array(value, f"{name} [{unit}]", ()))
    if abs(number) > largest:
        raise InputError(f"{name} must be within {largest:g} {unit}, got {number:g}: is it in {unit}?")
    return number


def position(value: Any, name: str) -> Float[np.ndarray, "3"]:
    """Where a camera or a table is [m].

    Raises:
        InputError: not three finite numbers, or farther than `FARTHEST` from the origin.
    """
    numbers = real_array(value, name, (3,))
    check_near(numbers, name)
    return numbers


def check_near(numbers: Float[np.ndarray, "3"], name: str) -> None:
    """Raises InputError for a position farther than `FARTHEST` from the origin."""
    if np.abs(numbers).max() > FARTHEST:
        raise InputError(
            f"{name} is {np.abs(numbers).max():g} m from the origin of its frame, {FARTHEST:g} m at most are taken: "
            "that looks like millimetres, divide by 1000"
        )


def truth_array(value: Any, name: str, shape: tuple[int, ...]) -> Bool[np.ndarray, "..."]:
    """Truth values, or numbers of which all but 0 are true.

    Raises:
        InputError: text, records, NaN, masked entries, or another shape.
    """
    array = _array(value, name, f"truth values of shape {_shape(shape)}")
    if array.dtype.kind not in "biuf":
        raise InputError(f"{name} must be truth values of shape {_shape(shape)}, got {described(value)}")
    if array.shape != shape:
        raise InputError(f"{name} must have shape {_shape(shape)}, got {array.shape}")
    if np.ma.is_masked(array) or np.isnan(np.ma.getdata(array)).any():
        raise InputError(f"{name} must be true or false everywhere, but has entries that are masked or NaN")
    return np.ma.getdata(array).astype(bool)


def described(value: Any) -> str:
    """A value in a message: what kind of array it is, or the beginning of anything else."""
    if isinstance(value, np.ndarray) and value.ndim:
        return f"an array of {value.dtype.name} of shape {value.shape}"
    return " ".join(reprlib.repr(value).split())[:NAMED]


def _array(value: Any, name: str, wanted: str) -> np.ndarray:
    try:
        return np.asanyarray(value)
    except Exception as error:  # ragged lists, tensors of another device, whatever `__array__` of a stranger raises
        reason = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"{name} must be {wanted}: {reason[:200]}") from error


def _shape(shape: tuple[int | None, ...]) -> str:
    """A wanted shape in a message: (n, 3), (h, w), or (3,)."""
    letters = "hw" if shape == (None, None) else "nmk"
    axes = [letters[axis] if length is None else str(length) for axis, length in enumerate(shape)]
    return f"({', '.join(axes)}{',' if len(axes) == 1 else ''})"
