"""Random bowls, plates, trays, pans and mugs of real sizes, with thin walls, and large boxes.

As in `containers`: every function returns one solid that stands upright on z = 0, but of its real size [m]: it is not
scaled to the hand afterwards. Many are larger than the hand opens; a rim, a handle or an edge can be held.
"""

import numpy as np

from icgnet.objects.containers import Profile, handle, profile_rings, wall_profile
from icgnet.objects.outlines import Outline, circle, rectangle, rounded_rectangle, superellipse
from icgnet.objects.solids import Solid, hull, loft, ring, tube, vessel

SIDES = 48
"""Points around a dish."""
SECTORS = 12
"""Convex pieces around its wall: the hull of one reaches into the hollow by 3 % of the radius."""


def dish(outline: Outline, profile: Profile, wall: float, floor: float, sectors: int = SECTORS) -> Solid:
    """Returns a vessel of one wall thickness [m].

    Args:
        outline: cross-section of radius 1.
        profile: radius [m] and height [m] of the outside, upwards, from its foot to the rim.
        wall: thickness, at right angles to the outside.
        floor: height of the bottom of the hollow.
        sectors: convex pieces around the wall.
    """
    radii, heights = np.array(profile).T
    along = np.gradient(np.column_stack([radii, heights]), axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    inner_heights = np.maximum.accumulate(heights + wall * along[:, 0])
    inner_radii = radii - wall * along[:, 1]
    top = heights[-1]
    levels = [floor, *(z for z in inner_heights if floor + 0.002 < z < top - 0.002), top]
    inside = [(float(np.interp(z, inner_heights, inner_radii)), float(z)) for z in levels]
    return vessel(profile_rings(outline, profile, 1.0), profile_rings(outline, inside, 1.0), sectors)


def _bent(foot: float, radius: float, start: float, height: float, bend: float, points: int = 5) -> Profile:
    """Returns a profile that widens from the foot to the rim: at first (bend below 1) or towards the end (above 1)."""
    t = np.linspace(0.0, 1.0, points)
    shares, rise = (t**bend, t) if bend < 1.0 else (t, t**bend)
    return [
        (float(foot + (radius - foot) * s), float(start + (height - start) * z))
        for s, z in zip(shares, rise, strict=True)
    ]


def _outline(rng: np.random.Generator) -> Outline:
    """Returns a circle, or for one dish in six a square with round corners."""
    return superellipse(SIDES, rng.uniform(4.0, 7.0)) if rng.random() < 1.0 / 6.0 else circle(SIDES)


def bowl(rng: np.random.Generator) -> Solid:
    """Returns a bowl, 9 to 26 cm wide, shallow or deep, with or without a foot, some with a rim that stands out."""
    radius = rng.uniform(0.045, 0.13)
    height = float(np.clip(radius * rng.uniform(0.45, 1.15), 0.03, 0.12))
    wall = rng.uniform(0.002, 0.006)
    foot = radius * rng.uniform(0.35, 0.65)
    stand = rng.uniform(0.003, 0.012) if rng.random() < 0.5 else 0.0
    profile = _bent(foot, radius, stand, height, rng.uniform(0.4, 0.95))
    if stand:
        profile = [(foot * rng.uniform(0.85, 1.0), 0.0), *profile]
    if rng.random() < 0.35:
        lip = rng.uniform(0.004, 0.012)
        profile = [*(point for point in profile if point[1] < height - lip - 0.004), (radius, height - lip)]
        profile = [*profile, (radius + lip, height)]
    return dish(_outline(rng), profile, wall, stand + wall)


def plate(rng: np.random.Generator) -> Solid:
    """Returns a plate or saucer, 12 to 30 cm wide."""
    radius = rng.uniform(0.06, 0.15)
    wall = rng.uniform(0.003, 0.006)
    height = radius * rng.uniform(0.14, 0.24) + wall
    stand = rng.uniform(0.001, 0.004)
    foot = radius * rng.uniform(0.5, 0.72)
    profile = [(foot, 0.0), *_bent(foot * 1.02, radius, stand, height, rng.uniform(1.0, 2.2))]
    return dish(_outline(rng), profile, wall, stand + wall)


def tray(rng: np.random.Generator) -> Solid:
    """Returns a rectangular tray, baking tin or open tub, 18 to 34 cm long."""
    length, height, wall = rng.uniform(0.18, 0.34), rng.uniform(0.02, 0.08), rng.uniform(0.003, 0.005)
    width = length * rng.uniform(0.55, 0.85)
    outline = rounded_rectangle(1.0, width / length, rng.uniform(0.05, 0.15), corner_points=5)
    foot = length * rng.uniform(0.85, 0.96)
    return dish(outline, [(foot, 0.0), (length, height)], wall, wall, sectors=len(outline))


def pan(rng: np.random.Generator) -> Solid:
    """Returns a frying pan or saucepan with a handle, or a pot with two."""
    radius = rng.uniform(0.07, 0.13)
    height = radius * rng.choice([rng.uniform(0.3, 0.5), rng.uniform(0.7, 1.2)])
    wall = rng.uniform(0.003, 0.005)
    profile = [(radius * rng.uniform(0.75, 0.97), 0.0), (radius, height)]
    body = dish(circle(SIDES), profile, wall, rng.uniform(1.0, 1.6) * wall)
    start, thick = radius - 0.5 * wall, rng.uniform(0.006, 0.010)
    section = superellipse(12, 3.0, rng.uniform(1.0, 1.8)) * thick
    if height > 0.7 * radius and rng.random() < 0.5:
        # Two ears, each a half ring that lies flat on the wall.
        span, reach = radius * rng.uniform(0.25, 0.4), rng.uniform(0.03, 0.045)
        angle = np.linspace(-np.pi / 2, np.pi / 2, 9)
        dip = radius - np.sqrt(radius**2 - span**2)
        x = start - dip + (reach + dip) * np.cos(angle)
        path = np.column_stack([x, span * np.sin(angle), np.full(9, 0.8 * height)])
        ear = tube(path, superellipse(10, 2.5) * 0.7 * thick, side=(0.0, 0.0, 1.0))
        return body + ear + ear.turned(np.pi, (0.0, 0.0, 1.0))
    length = rng.uniform(0.11, 0.19)
    rise = length * rng.uniform(0.0, 0.35)
    t = np.array([0.0, 0.25, 0.6, 1.0])
    z = height - 1.2 * thick + rise * t ** rng.uniform(0.7, 1.0)
    path = np.column_stack([start + length * t, np.zeros(4), z])
    return body + tube(path, section, [0.7, 0.8, 1.0, 0.9])


def mug(rng: np.random.Generator) -> Solid:
    """Returns a mug or teacup with thin walls, hollow to its floor, whose handle a finger fits through."""
    low = rng.random() < 0.3
    radius = rng.uniform(0.042, 0.056) if low else rng.uniform(0.034, 0.047)
    height = radius * (rng.uniform(1.1, 1.5) if low else rng.uniform(1.8, 2.8))
    wall = rng.uniform(0.0025, 0.005)
    shares = wall_profile(rng, height)
    floor = rng.uniform(1.0, 1.8) * wall
    body = dish(circle(SIDES), [(share * radius, z) for share, z in shares], wall, floor)
    return body + handle(rng, shares, radius, 0.5 * wall, reaches=(0.7, 1.0))


def large_box(rng: np.random.Generator) -> Solid:
    """Returns a cereal box, a parcel up to 30 cm, or a shoe box with a lid."""
    style = rng.choice(["cereal", "parcel", "lidded"], p=[0.4, 0.4, 0.2])
    if style == "cereal":
        x, y, z = rng.uniform(0.14, 0.21), rng.uniform(0.04, 0.08), rng.uniform(0.2, 0.31)
    elif style == "parcel":
        x, y, z = rng.uniform(0.12, 0.3), rng.uniform(0.1, 0.22), rng.uniform(0.05, 0.2)
    else:
        x, y, z = rng.uniform(0.2, 0.32), rng.uniform(0.12, 0.2), rng.uniform(0.07, 0.13)
    base = rectangle(x, y)
    if style != "lidded":
        bulge = 1.0 + rng.uniform(0.0, 0.02)  # full boxes are a little wider half way up
        return hull(np.concatenate([ring(base, 1.0, 0.0), ring(base, bulge, 0.5 * z), ring(base, 1.0, z)]))
    lip, start = 0.003, z - rng.uniform(0.02, 0.05)
    grown = (1.0 + 2.0 * lip / x, 1.0 + 2.0 * lip / y)
    return loft([ring(base, 1.0, 0.0), ring(base, 1.0, start), ring(base, grown, start + 0.001), ring(base, grown, z)])


def book(rng: np.random.Generator) -> Solid:
    """Returns a book that lies flat: a block of pages between two covers and a spine, or a paperback."""
    width, length, thick = rng.uniform(0.11, 0.21), rng.uniform(0.17, 0.29), rng.uniform(0.012, 0.05)
    board = 0.0 if rng.random() < 0.4 else rng.uniform(0.002, 0.003)
    if not board:
        return loft([ring(rectangle(width, length), 1.0, z) for z in (0.0, thick)])
    cover = loft([ring(rectangle(width, length), 1.0, z) for z in (0.0, board)])
    spine = loft([ring(rectangle(board, length), 1.0, z) for z in (0.0, thick)]).moved(x=(board - width) / 2)
    inset = rng.uniform(0.002, 0.004)
    pages = loft([ring(rectangle(width - inset - 0.001, length - 2 * inset), 1.0, z) for z in (0.001, thick - 0.001)])
    return cover + cover.moved(z=thick - board) + spine + pages.moved(x=0.0005 - inset / 2)
