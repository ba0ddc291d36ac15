"""Strange values and broken files, drawn from a seeded generator."""

import json
from pathlib import Path
from typing import Any

import numpy as np

NASTY = (
    *(None, True, "", "text", "nan", -1, 0, 1e-320, 1e155, 1e300, float("nan"), float("inf"), -float("inf"), 10**30),
    *([], {}, [1], [[1, 2], [3]], {"a": 1}, "../../x", "/etc/passwd", "x" * 5000, [0.0] * 3, [float("nan")] * 3),
)
"""Values in place of an entry of a file."""


def strange(rng: np.random.Generator, array: np.ndarray) -> Any:
    """Something else than the array that a caller might hand in by mistake."""
    return CHANGES[rng.integers(len(CHANGES))](rng, array)


def _spoiled(value: Any):
    def change(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
        spoiled = np.array(array, dtype=np.float64)
        spoiled[rng.random(spoiled.shape) < rng.choice([0.001, 0.1, 1.0])] = value
        return spoiled

    return change


def _one(value: float):
    def change(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
        spoiled = np.array(array, dtype=np.float64)
        if spoiled.size:
            spoiled.reshape(-1)[rng.integers(spoiled.size)] = value
        return spoiled

    return change


def _scaled(factor: float):
    return lambda rng, array: np.asarray(array, dtype=np.float64) * factor


def _records(rng: np.random.Generator, array: np.ndarray) -> np.ndarray:
    records = np.zeros(np.shape(array), dtype=[("z", np.float64)])
    records["z"] = array
    return records


CHANGES = (
    *map(_spoiled, (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e155, 1e300, 1e-300)),
    *map(_one, (np.nan, np.inf, 1e155, -1e300, 1e4, -1.0, 1e-320)),
    *map(_scaled, (1e3, 1e-3, 1e6, -1.0, 0.0, 1e300, 1.5)),
    *(lambda rng, array, kind=kind: np.nan_to_num(array).astype(kind) for kind in ("f2", "f4", "u2", "i4", "?", "c16")),
    *(lambda rng, array, kind=kind: np.asarray(array).astype(kind) for kind in ("U8", "O", "S4")),
    _records,
    lambda rng, array: np.asarray(array).tolist(),
    lambda rng, array: [*np.asarray(array).tolist(), [1.0]] if np.ndim(array) else [array],
    lambda rng, array: np.ma.array(array, mask=rng.random(np.shape(array)) < 0.5),
    lambda rng, array: np.ma.masked_all(np.shape(array)),
    lambda rng, array: np.asarray(array)[..., None],
    lambda rng, array: np.asarray(array).reshape(-1),
    lambda rng, array: np.asarray(array)[:1] if np.ndim(array) else array,
    lambda rng, array: np.asarray(array)[:0] if np.ndim(array) else array,
    lambda rng, array: np.asarray(array).T,
    lambda rng, array: np.repeat(np.asarray(array), 2, axis=0) if np.ndim(array) else array,
    lambda rng, array: rng.permutation(np.asarray(array)) if np.ndim(array) else array,
    lambda rng, array: np.asarray(array) + rng.normal(0.0, rng.choice([1e-3, 0.02, 1.0]), np.shape(array)),
    lambda rng, array: NASTY[rng.integers(len(NASTY))],
)


def break_bytes(rng: np.random.Generator, path: Path) -> None:
    """Cuts, flips, doubles or fills a piece of a file."""
    content = bytearray(path.read_bytes())
    start, end = sorted(rng.integers(0, len(content) + 1, size=2))
    kind = rng.integers(5)
    if kind == 0:
        content = content[:start]
    elif kind == 1:
        del content[start : min(end, start + 16)]
    elif kind == 2:
        content[start:start] = content[start : min(end, start + 64)]
    elif kind == 3:
        content[start : start + 8] = rng.bytes(min(8, len(content) - start))
    else:
        for _ in range(rng.integers(1, 4)):
            if content:
                content[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    path.write_bytes(bytes(content))


def break_entries(rng: np.random.Generator, entries: Any) -> Any:
    """The content of a JSON file with one entry, somewhere in it, gone or replaced by a strange one."""
    copy = json.loads(json.dumps(entries))
    place, depth = copy, rng.integers(1, 6)
    for _ in range(depth):
        keys = list(place) if isinstance(place, dict) else list(range(len(place)))
        if not keys:
            break
        key = keys[rng.integers(len(keys))]
        below = place[key]
        if isinstance(below, dict | list) and below and rng.random() < 0.7:
            place = below
            continue
        if rng.random() < 0.2:
            del place[key]
        else:
            place[key] = NASTY[rng.integers(len(NASTY))]
        break
    return copy


def break_arrays(rng: np.random.Generator, path: Path) -> None:
    """Replaces one array of an npz file by a strange one, or leaves it out."""
    with np.load(path) as saved:
        arrays = dict(saved)
    name = list(arrays)[rng.integers(len(arrays))]
    if rng.random() < 0.1:
        del arrays[name]
    else:
        changed = arrays[name] if arrays[name].dtype.kind == "U" else strange(rng, arrays[name])
        try:
            changed = np.asarray(changed)
        except ValueError:
            changed = np.array("ragged")
        arrays[name] = changed.astype("U") if changed.dtype.kind == "O" else changed
    np.savez(path, **arrays)
