"""Random mugs, boxes, cans, bottles, cylindric things and balls.

Every function returns one solid that stands upright on z = 0, about as large as the real thing [m]; the object set
scales it afterwards. What makes an object of its class follows the definitions that ship with the VGN labels.
"""

import numpy as np
import trimesh

from icgnet.objects.outlines import Outline, circle, rectangle, rounded_rectangle, superellipse
from icgnet.objects.solids import Ring, Solid, hollow_prism, hull, loft, ring, tube, vessel

SIDES = 28
"""Points around a body of revolution."""

Profile = list[tuple[float, float]]
"""Radius [share of the body's] and height [m], upwards."""


def profile_rings(outline: Outline, profile: Profile, radius: float) -> list[Ring]:
    """Returns the rings of a body over an outline of radius 1."""
    return [ring(outline, share * radius, z) for share, z in profile]


def wall_profile(rng: np.random.Generator, height: float) -> Profile:
    """Returns the outside of a cup: straight, tapered, bulging, waisted or rounded at the foot."""
    style = rng.choice(["straight", "tapered", "bulging", "waisted", "rounded"])
    if style == "straight":
        return [(0.96, 0.0), (1.0, 0.03 * height), (1.0, height)]
    if style == "tapered":
        return [(rng.uniform(0.62, 0.92), 0.0), (1.0, height)]
    t = np.linspace(0.0, 1.0, 6)
    if style == "rounded":
        share = np.minimum(1.0, 0.55 + 0.45 * np.sqrt(np.clip(t / rng.uniform(0.3, 0.7), 0.0, 1.0)))
    else:
        depth = rng.uniform(0.08, 0.2)
        wave = np.sin(np.pi * t)
        share = 1.0 - depth * (1.0 - wave) if style == "bulging" else 1.0 - depth * wave
    return list(zip(share, t * height, strict=True))


def cup(
    rng: np.random.Generator, radius: float, height: float, outline: Outline, fill: float = 0.0
) -> tuple[Solid, Profile, float]:
    """Returns an open cup, the profile of its outside, and the thickness of its wall [m].

    Args:
        rng: draws the profile and the thicknesses.
        radius: of the cup [m].
        height: of the cup [m].
        outline: cross-section of radius 1.
        fill: share of the height up to which the hollow is filled, at least.
    """
    profile = wall_profile(rng, height)
    wall = radius * rng.uniform(0.1, 0.17)
    floor = max(height * rng.uniform(0.07, 0.14), fill * height)
    heights, shares = np.array([z for _, z in profile]), np.array([share for share, _ in profile])
    levels = [floor, *(z for z in heights if floor * 1.15 < z < height), height]
    inside = [(float(np.interp(z, heights, shares)) - wall / radius, z) for z in levels]
    solid = vessel(profile_rings(outline, profile, radius), profile_rings(outline, inside, radius))
    return solid, profile, wall


def handle(
    rng: np.random.Generator,
    profile: Profile,
    radius: float,
    sink: float,
    reaches: tuple[float, float] = (0.5, 0.85),
) -> Solid:
    """Returns a mug's handle in the xz plane, its ends `sink` [m] deep in the wall that the profile describes.

    It stands out of the wall by a share of the radius that is drawn from the range `reaches`.
    """
    height = profile[-1][1]
    low, high = height * rng.uniform(0.1, 0.3), height * rng.uniform(0.7, 0.92)
    reach = radius * rng.uniform(*reaches)
    exponent = rng.choice([2.0, 2.0, 3.0, 5.0])
    angle = np.linspace(-np.pi / 2.0, np.pi / 2.0, 9)
    out = np.abs(np.cos(angle)) ** (2.0 / exponent)
    up = 0.5 + 0.5 * np.sign(np.sin(angle)) * np.abs(np.sin(angle)) ** (2.0 / exponent)
    out[[0, -1]] = 0.0
    z = low + (high - low) * up
    heights, shares = [level for _, level in profile], [share for share, _ in profile]
    x = radius * np.interp(z, heights, shares) - sink + reach * out * (1.0 + rng.uniform(-0.3, 0.3) * (up - 0.5))
    thickness, breadth = radius * rng.uniform(0.09, 0.14), radius * rng.uniform(0.1, 0.24)
    section = superellipse(10, rng.uniform(2.0, 4.0)) * np.array([thickness, breadth])
    return tube(np.column_stack([x, np.zeros_like(x), z]), section)


def mug(rng: np.random.Generator) -> Solid:
    """Returns a cup with a handle; one in eight is nearly filled, as scans with a lost hollow are."""
    radius = rng.uniform(0.035, 0.05)
    height = radius * rng.uniform(1.5, 3.2)
    outline = circle(SIDES) if rng.random() < 0.8 else superellipse(SIDES, rng.uniform(2.4, 3.5))
    body, profile, wall = cup(
        rng, radius, height, outline, fill=rng.uniform(0.6, 0.85) if rng.random() < 0.125 else 0.0
    )
    return body + handle(rng, profile, radius, 0.5 * wall)


def jug(rng: np.random.Generator) -> Solid:
    """Returns a tall pitcher with a handle, open or with a domed lid."""
    radius = rng.uniform(0.04, 0.06)
    height = radius * rng.uniform(2.6, 4.0)
    if rng.random() < 0.6:
        body, profile, wall = cup(rng, radius, height, circle(SIDES))
        return body + handle(rng, profile, radius, 0.5 * wall)
    profile = wall_profile(rng, height)
    lid = [(share * profile[-1][0], height + rise * radius) for share, rise in ((0.9, 0.06), (0.6, 0.16), (0.15, 0.2))]
    return loft(profile_rings(circle(SIDES), [*profile, *lid], radius)) + handle(rng, profile, radius, 0.2 * radius)


def carton(rng: np.random.Generator) -> Solid:
    """Returns a cuboid package with sharp or slightly bevelled edges."""
    sides = rng.uniform(0.35, 1.0, 3) if rng.random() < 0.7 else np.array([1.0, 1.0, rng.uniform(0.6, 2.0)])
    x, y, z = 0.12 * sides
    bevel = rng.choice([0.0, 0.03, 0.08]) * min(x, y, z)
    if bevel == 0.0:
        return loft([ring(rectangle(x, y), 1.0, 0.0), ring(rectangle(x, y), 1.0, z)])
    levels = [(bevel, 0.0), (0.0, bevel), (0.0, z - bevel), (bevel, z)]
    return hull(np.concatenate([_cut_corners(x - 2 * cut, y - 2 * cut, bevel, height) for cut, height in levels]))


def _cut_corners(x: float, y: float, cut: float, z: float) -> Ring:
    return ring(rounded_rectangle(x, y, cut, corner_points=2), 1.0, z)


def rounded_box(rng: np.random.Generator) -> Solid:
    """Returns a tin, soap or sponge: rounded corners, and top and bottom rounded off as well."""
    x, y, z = 0.11 * rng.uniform(0.35, 1.0, 3)
    corner = min(x, y) * rng.uniform(0.08, 0.3)
    edge = min(z, corner) * rng.uniform(0.2, 0.45)
    outline = rounded_rectangle(x, y, corner, corner_points=5)
    share = 1.0 - 2.0 * edge / np.array([x, y])
    levels = [(0.0, 0.0), (0.7, 0.3), (1.0, 1.0)]
    ends = [(share + (1.0 - share) * out, up * edge) for out, up in levels]
    rings = [ring(outline, tuple(scale), z_) for scale, z_ in ends]
    return loft([*rings, *(ring(outline, tuple(scale), z - z_) for scale, z_ in reversed(ends))])


def lidded_box(rng: np.random.Generator) -> Solid:
    """Returns a box whose lid stands out a little."""
    x, y, z = 0.11 * rng.uniform(0.4, 1.0, 3)
    lip, start = rng.uniform(0.02, 0.05) * min(x, y), z * rng.uniform(0.5, 0.85)
    body = rounded_rectangle(x, y, 0.05 * min(x, y), corner_points=3)
    grown = tuple(1.0 + 2.0 * lip / np.array([x, y]))
    return loft([ring(body, 1.0, 0.0), ring(body, 1.0, start), ring(body, grown, start + lip), ring(body, grown, z)])


def gable_carton(rng: np.random.Generator) -> Solid:
    """Returns a milk carton: a square column with a roof and a seam."""
    width = rng.uniform(0.05, 0.08)
    depth = width * rng.uniform(0.7, 1.0)
    column, roof, seam = width * rng.uniform(1.0, 2.0), width * rng.uniform(0.25, 0.5), width * rng.uniform(0.1, 0.2)
    base = rectangle(width, depth)
    ridge = (1.0, 0.12)
    levels = [(1.0, 0.0), (1.0, column), (ridge, column + roof), (ridge, column + roof + seam)]
    return loft([ring(base, scale, z) for scale, z in levels])


def tapered_box(rng: np.random.Generator) -> Solid:
    """Returns a tub or brick: a box whose top is smaller or larger than its foot."""
    x, y, z = 0.1 * rng.uniform(0.5, 1.0, 3)
    taper = rng.uniform(0.86, 0.95)
    foot, top = (taper, 1.0) if rng.random() < 0.5 else (1.0, taper)
    outline = rounded_rectangle(x, y, rng.uniform(0.03, 0.15) * min(x, y), corner_points=4)
    return loft([ring(outline, foot, 0.0), ring(outline, top, z)])


def can(rng: np.random.Generator) -> Solid:
    """Returns a food tin: plain, with rims, ribbed, with a sunk lid, or necked like a beverage can."""
    radius = rng.uniform(0.03, 0.045)
    height = radius * rng.uniform(0.9, 4.0)
    style = rng.choice(["plain", "rims", "ribs", "sunk", "necked"])
    rim = rng.uniform(0.05, 0.1) * radius
    outline = circle(SIDES)
    if style == "plain":
        profile = [(0.95, 0.0), (1.0, 0.5 * rim), (1.0, height - 0.5 * rim), (0.95, height)]
    elif style == "rims":
        out = 1.0 + rng.uniform(0.02, 0.05)
        profile = [
            (out, 0.0),
            (out, rim),
            (1.0, 1.5 * rim),
            (1.0, height - 1.5 * rim),
            (out, height - rim),
            (out, height),
        ]
    elif style == "ribs":
        count, depth = int(rng.integers(2, 5)), rng.uniform(0.02, 0.04)
        levels = np.linspace(0.2, 0.8, 2 * count + 1) * height
        ribs = [(1.0 - depth * (i % 2), float(z)) for i, z in enumerate(levels)]
        profile = [(1.0, 0.0), *ribs, (1.0, height)]
    elif style == "sunk":
        wall, sunk = rng.uniform(0.08, 0.13), rng.uniform(0.05, 0.12) * height
        outside = profile_rings(outline, [(1.0, 0.0), (1.0, height)], radius)
        return vessel(outside, profile_rings(outline, [(1.0 - wall, height - sunk), (1.0 - wall, height)], radius))
    else:
        height = radius * rng.uniform(3.0, 4.2)
        neck = rng.uniform(0.75, 0.85)
        profile = [(0.78, 0.0), (1.0, 0.06 * height), (1.0, 0.88 * height), (neck, 0.98 * height), (neck, height)]
    return loft(profile_rings(outline, profile, radius))


def bottle(rng: np.random.Generator) -> Solid:
    """Returns a bottle: body of any section, shoulder, round neck, cap; some with a waist, pump or spray head."""
    radius = rng.uniform(0.03, 0.045)
    height = radius * rng.uniform(3.2, 6.0)
    neck = rng.uniform(0.25, 0.55)
    shoulder_start = rng.uniform(0.45, 0.72)
    shoulder_end = min(0.9, shoulder_start + rng.uniform(0.08, 0.3))
    sections = [
        circle(SIDES),
        circle(SIDES),
        superellipse(SIDES, rng.uniform(2.0, 4.0), rng.uniform(0.5, 1.0)),
        superellipse(SIDES, rng.uniform(5.0, 8.0), rng.uniform(0.6, 1.0)),
    ]
    outline = sections[rng.integers(len(sections))]
    slimness = np.abs(outline[:, 1]).max()
    round_neck = circle(SIDES) * min(neck, 0.8 * slimness)

    rings = [ring(outline, radius * 0.9, 0.0), ring(outline, radius, 0.03 * height)]
    if rng.random() < 0.3:
        waist = 1.0 - rng.uniform(0.08, 0.2)
        middle, half = 0.52 * shoulder_start * height, rng.uniform(0.1, 0.18) * height
        levels = [(1.0, middle - half), (waist, middle), (1.0, middle + half)]
        rings += [ring(outline, radius * share, z) for share, z in levels]
    ease = rng.choice([1.0, 1.7, 0.6])  # straight, hollow or round shoulders
    for t in np.linspace(0.0, 1.0, int(rng.integers(2, 6))):
        z = (shoulder_start + t * (shoulder_end - shoulder_start)) * height
        blend = t**ease
        rings.append(ring(outline * (1.0 - blend) + round_neck * blend, radius, z))
    return _closure(rng, rings, round_neck, radius, shoulder_end * height, height)


def _closure(
    rng: np.random.Generator, rings: list[Ring], neck: Outline, radius: float, start: float, top: float
) -> Solid:
    """Returns a bottle's rings continued by a screw cap, a crown, a pump or a spray head."""
    style = rng.choice(["cap", "lip", "plain", "pump", "spray"], p=[0.4, 0.2, 0.2, 0.1, 0.1])
    width = float(np.abs(neck[:, 0]).max()) * radius
    middle = start + (top - start) * rng.uniform(0.2, 0.6)
    if style == "plain":
        return loft([*rings, ring(neck, radius, top)])
    if style in ("cap", "lip"):
        grow = rng.uniform(1.1, 1.5) if style == "cap" else 1.12
        begin = middle if style == "cap" else top - 0.08 * (top - start) - 0.004
        step = min(0.003, 0.2 * (top - begin))
        upper = [(1.0, begin), (grow, begin + step), (grow, top - step), (0.9 * grow, top)]
        return loft([*rings, *(ring(neck, share * radius, z) for share, z in upper)])
    body = loft([*rings, ring(neck, radius, top)])
    if style == "pump":
        size, reach = 0.5 * width, radius * rng.uniform(0.8, 1.3)
        path = np.array([[-1.5 * size, 0.0, top], [0.3 * reach, 0.0, top], [reach, 0.0, top - 0.15 * reach]])
        return body + tube(path, rectangle(1.2 * size, 2.0 * size))
    head = np.array([[-1.3, 0.0], [1.2, 0.0], [2.4, 1.0], [2.4, 1.7], [-1.0, 1.9], [-1.6, 1.2]]) * width
    thickness = 1.3 * width
    points = np.array([[x, side * thickness / 2.0, z + top - 0.3 * width] for x, z in head for side in (-1.0, 1.0)])
    trigger = np.array([[1.6, 0.0, 0.4], [2.0, 0.0, -0.5], [1.6, 0.0, -1.4]]) * width + np.array([0.0, 0.0, top])
    return body + hull(points) + tube(trigger, rectangle(0.35 * width, 0.8 * width))


def handled_bottle(rng: np.random.Generator) -> Solid:
    """Returns a detergent jug: a flat body with a grip from its shoulder to its back."""
    radius = rng.uniform(0.035, 0.045)
    height = radius * rng.uniform(3.4, 4.6)
    aspect = rng.uniform(0.55, 0.8)
    outline = superellipse(SIDES, rng.uniform(3.0, 5.0), aspect)
    neck = circle(SIDES) * rng.uniform(0.28, 0.4)
    levels = [(0.92, 0.0), (1.0, 0.05), (1.0, 0.5)]
    rings = [ring(outline, share * radius, z * height) for share, z in levels]
    rings += [
        ring(outline * (1.0 - t) + neck * t, radius, z * height) for t, z in ((0.35, 0.62), (0.8, 0.78), (1.0, 0.84))
    ]
    rings += [ring(neck, 1.25 * radius, 0.86 * height), ring(neck, 1.25 * radius, height)]
    grip = np.array([[-0.85, 0.47], [-1.1, 0.52], [-1.15, 0.7], [-0.95, 0.82], [-0.3, 0.8]]) * np.array(
        [radius, height]
    )
    path = np.column_stack([grip[:, 0], np.zeros(len(grip)), grip[:, 1]])
    return loft(rings) + tube(path, superellipse(10, 2.5) * radius * np.array([0.13, 0.2]))


def glass(rng: np.random.Generator) -> Solid:
    """Returns a cup or glass without a handle."""
    radius = rng.uniform(0.03, 0.045)
    outline = circle(SIDES) if rng.random() < 0.85 else circle(int(rng.integers(6, 11)))
    sectors = len(outline) if len(outline) < SIDES else 0
    if not sectors:
        return cup(rng, radius, radius * rng.uniform(1.8, 4.2), outline)[0]
    height, taper, wall = radius * rng.uniform(1.8, 4.0), rng.uniform(0.65, 1.0), rng.uniform(0.12, 0.18)
    outside = profile_rings(outline, [(taper, 0.0), (1.0, height)], radius)
    inside = [(taper + 0.1 * (1.0 - taper) - wall, 0.1 * height), (1.0 - wall, height)]
    return vessel(outside, profile_rings(outline, inside, radius), sectors)


def tall_cylinder(rng: np.random.Generator) -> Solid:
    """Returns a tube, candle, marker or tapered tub: slender, round, closed."""
    radius = rng.uniform(0.02, 0.035)
    height = radius * rng.uniform(4.6, 8.0)
    foot, top = (1.0, rng.uniform(0.7, 1.0)) if rng.random() < 0.5 else (rng.uniform(0.75, 1.0), 1.0)
    edge = rng.uniform(0.05, 0.25) * radius
    profile = [(0.93 * foot, 0.0), (foot, edge), (top, height - edge), (0.9 * top, height)]
    if rng.random() < 0.3:
        start = rng.uniform(0.6, 0.85) * height
        out = rng.uniform(1.04, 1.12)
        profile = [(foot, 0.0), (foot, start), (out, start + 0.002), (out, height - edge), (0.92 * out, height)]
    return loft(profile_rings(circle(SIDES), profile, radius))


def jar(rng: np.random.Generator) -> Solid:
    """Returns a jar or vase: closed, round, with an opening too wide to be a bottle's neck."""
    radius = rng.uniform(0.03, 0.045)
    height = radius * rng.uniform(2.0, 3.8)
    neck = rng.uniform(0.72, 0.9)
    lid = min(1.0, neck * rng.uniform(1.02, 1.12))
    start = rng.uniform(0.6, 0.75)
    belly = rng.uniform(0.85, 1.0)
    profile = [(0.92 * belly, 0.0), (belly, 0.04), (1.0, 0.5 * start), (1.0, start), (neck, start + 0.1), (neck, 0.86)]
    profile += [(lid, 0.88), (lid, 0.98), (0.95 * lid, 1.0)]
    return loft(profile_rings(circle(SIDES), [(share, z * height) for share, z in profile], radius))


def prism(rng: np.random.Generator) -> Solid:
    """Returns a hexagonal or octagonal carton, straight, tapered or twisted a little."""
    sides = int(rng.choice([5, 6, 6, 8]))
    radius = rng.uniform(0.03, 0.04)
    height = radius * rng.uniform(1.6, 5.0)
    taper = rng.choice([1.0, rng.uniform(0.75, 0.95)])
    return loft([ring(circle(sides), radius, 0.0), ring(circle(sides), taper * radius, height)])


def roll(rng: np.random.Generator) -> Solid:
    """Returns a roll of tape or paper: a ring with a bore from end to end."""
    radius = rng.uniform(0.035, 0.05)
    bore = rng.uniform(0.3, 0.8)
    height = radius * rng.uniform(0.5, 2.4)
    return hollow_prism(circle(SIDES) * radius, circle(SIDES) * radius * bore, height, sectors=14, bevel=0.03 * radius)


def spool(rng: np.random.Generator) -> Solid:
    """Returns a reel or dumbbell-shaped stand: two discs on a core."""
    radius = rng.uniform(0.03, 0.04)
    height = radius * rng.uniform(1.8, 3.6)
    disc, core, top = height * rng.uniform(0.1, 0.2), rng.uniform(0.5, 0.85), rng.uniform(0.85, 1.0)
    profile = [
        (1.0, 0.0),
        (1.0, disc),
        (core, disc + 0.003),
        (core, height - disc - 0.003),
        (top, height - disc),
        (top, height),
    ]
    return loft(profile_rings(circle(SIDES), profile, radius))


def ball(rng: np.random.Generator) -> Solid:
    """Returns a sphere, or one pressed a little out of shape."""
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=0.035)
    return hull(sphere.vertices * rng.uniform(0.88, 1.0, 3))


def faceted_ball(rng: np.random.Generator) -> Solid:
    """Returns a round stone: the hull of points scattered evenly over a sphere."""
    count = int(rng.integers(24, 90))
    step = np.arange(count) + 0.5
    polar, azimuth = np.arccos(1.0 - 2.0 * step / count), np.pi * (1.0 + 5.0**0.5) * step
    directions = np.column_stack([np.cos(azimuth) * np.sin(polar), np.sin(azimuth) * np.sin(polar), np.cos(polar)])
    return hull(0.035 * directions * rng.uniform(0.94, 1.0, (count, 1)))


def fruit(rng: np.random.Generator) -> Solid:
    """Returns an apple, orange or pumpkin: round, with a foot to stand on and sometimes lobes."""
    t = np.linspace(0.16, 0.9, 9) * np.pi
    lobes = int(rng.choice([0, 0, 5, 6, 8]))
    outline = (
        circle(SIDES)
        * (1.0 + (0.03 if lobes else 0.0) * np.cos(lobes * np.linspace(0, 2 * np.pi, SIDES, endpoint=False)))[:, None]
    )
    squash = rng.uniform(0.85, 1.0)
    wide = rng.uniform(-0.1, 0.1)
    profile = [(float(np.sin(a) * (1.0 + wide * np.cos(a))), float(-np.cos(a) * squash * 0.035)) for a in t]
    return loft(profile_rings(outline, profile, 0.035))
