"""Closed planar outlines, counter-clockwise, and their convex cells."""

import numpy as np
from jaxtyping import Float

Outline = Float[np.ndarray, "_ 2"]


def circle(sides: int) -> Outline:
    """Returns a regular polygon inscribed in the unit circle."""
    angle = 2.0 * np.pi * np.arange(sides) / sides
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def superellipse(sides: int, exponent: float, aspect: float = 1.0) -> Outline:
    """Returns |x|^exponent + |y / aspect|^exponent = 1: 2 is an ellipse, 4 a squircle, 10 nearly a rectangle."""
    c, s = circle(sides).T
    power = 2.0 / exponent
    return np.stack([np.sign(c) * np.abs(c) ** power, aspect * np.sign(s) * np.abs(s) ** power], axis=1)


def rounded_rectangle(width: float, depth: float, radius: float, corner_points: int = 4) -> Outline:
    """Returns a rectangle with rounded corners, centred."""
    radius = min(radius, 0.499 * width, 0.499 * depth)
    angle = np.linspace(0.0, np.pi / 2.0, corner_points)
    arc = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    corner = np.array([width / 2.0 - radius, depth / 2.0 - radius])
    turns = [np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in np.pi / 2.0 * np.arange(4)]
    signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    return np.concatenate([sign * corner + arc @ turn.T for sign, turn in zip(signs, turns, strict=True)])


def rectangle(width: float, depth: float) -> Outline:
    """Returns a centred rectangle."""
    return 0.5 * np.array([[width, depth], [-width, depth], [-width, -depth], [width, -depth]])


def cut_ears(outline: Outline) -> list[list[int]]:
    """Returns triangles that tile a simple polygon, as indices of its vertices, counter-clockwise."""
    remaining = list(range(len(outline)))
    cells = []
    while len(remaining) > 3:
        ear = max(range(len(remaining)), key=lambda i: _ear_quality(outline, remaining, i))
        cells.append([remaining[ear - 1], remaining[ear], remaining[(ear + 1) % len(remaining)]])
        del remaining[ear]
    return [*cells, remaining]


def convex_cells(outline: Outline) -> list[list[int]]:
    """Returns convex cells that tile a simple polygon, as indices of its vertices, counter-clockwise.

    Ears are cut off one by one, then neighbouring cells are joined where the union stays convex.
    """
    cells = cut_ears(outline)
    joined = True
    while joined:
        joined = False
        for first in range(len(cells)):
            for second in range(first + 1, len(cells)):
                union = _join(cells[first], cells[second])
                if union is not None and is_convex(outline[union]):
                    cells[first] = union
                    del cells[second]
                    joined = True
                    break
            if joined:
                break
    return cells


def is_convex(outline: Outline, tolerance: float = 1e-9) -> bool:
    """Returns whether a counter-clockwise outline never turns right."""
    edge = np.roll(outline, -1, axis=0) - outline
    following = np.roll(edge, -1, axis=0)
    return bool((edge[:, 0] * following[:, 1] - edge[:, 1] * following[:, 0] >= -tolerance).all())


def _ear_quality(outline: Outline, remaining: list[int], i: int) -> float:
    """Returns the smallest height over longest side of the ear at `i`, or -1 when cutting it off is not allowed."""
    corner = [remaining[i - 1], remaining[i], remaining[(i + 1) % len(remaining)]]
    a, b, c = outline[corner]
    area = _turn(a, b, c)
    if area <= 1e-12:
        return -1.0
    others = outline[[index for index in remaining if index not in corner]]
    sides = np.array([_turn(a, b, others), _turn(b, c, others), _turn(c, a, others)])
    if (sides >= 0.0).all(axis=0).any():
        return -1.0
    return float(area / max(np.sum((b - a) ** 2), np.sum((c - b) ** 2), np.sum((a - c) ** 2)))


def _turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray | float:
    """Returns twice the signed area of the triangles a, b, c; c may be many points."""
    return (b[0] - a[0]) * (c[..., 1] - a[1]) - (b[1] - a[1]) * (c[..., 0] - a[0])


def _join(first: list[int], second: list[int]) -> list[int] | None:
    """Returns the union of two cells that share an edge."""
    for i, start in enumerate(first):
        end = first[(i + 1) % len(first)]
        if start in second and second[second.index(start) - 1] == end:
            at = second.index(start)
            return first[i + 1 :] + first[: i + 1] + (second[at + 1 :] + second[:at])[:-1]
    return None
