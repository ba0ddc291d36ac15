"""Random things of the class "other": dishes, tools and food.

As in `containers`: every function returns one solid [m], upright as it would stand or lie on a table.
"""

import numpy as np

from icgnet.objects.containers import SIDES, profile_rings, wall_profile
from icgnet.objects.outlines import Outline, circle, superellipse
from icgnet.objects.solids import Solid, extrude, hollow_prism, loft, ring, tube, vessel

_X = (1.0, 0.0, 0.0)
_Y = (0.0, 1.0, 0.0)


def arc(radius: float, start: float, end: float, points: int) -> np.ndarray:
    """Returns points on a circle in the xz plane, from one angle to another [m, rad]."""
    angle = np.linspace(start, end, points)
    return np.column_stack([radius * np.cos(angle), np.zeros(points), radius * np.sin(angle)])


def bowl(rng: np.random.Generator) -> Solid:
    """Returns a bowl or a deep plate."""
    radius = 0.06
    height = radius * rng.uniform(0.55, 1.2)
    foot, wall = rng.uniform(0.35, 0.6), rng.uniform(0.09, 0.14)
    t = np.linspace(0.0, 1.0, 5)
    share = foot + (1.0 - foot) * t ** rng.uniform(0.45, 1.0)
    outer = list(zip(share, t * height, strict=True))
    floor = rng.uniform(0.1, 0.16)
    levels = np.linspace(floor, 1.0, 4)
    inner = [(float(np.interp(z, t, share)) - wall, z * height) for z in levels]
    return vessel(profile_rings(circle(SIDES), outer, radius), profile_rings(circle(SIDES), inner, radius))


def pan(rng: np.random.Generator) -> Solid:
    """Returns a saucepan or ladle: a low vessel with a straight handle."""
    radius, height = 0.045, 0.045 * rng.uniform(0.5, 1.3)
    wall = rng.uniform(0.1, 0.15)
    outer = profile_rings(circle(24), [(rng.uniform(0.75, 1.0), 0.0), (1.0, height)], radius)
    inner = profile_rings(
        circle(24), [(float(outer[0][:, 0].max()) / radius - wall, 0.12 * height), (1.0 - wall, height)], radius
    )
    length, size = radius * rng.uniform(1.2, 2.2), radius * rng.uniform(0.1, 0.16)
    path = np.array(
        [
            [radius * (1.0 - 0.5 * wall), 0, 0.8 * height],
            [radius + length, 0, 0.8 * height + 0.2 * length * rng.random()],
        ]
    )
    return vessel(outer, inner, sectors=12) + tube(path, superellipse(12, 3.0, 1.5) * size)


def funnel(rng: np.random.Generator) -> Solid:
    """Returns a goblet or egg-cup: an open cup on a stem with a foot."""
    radius, height = 0.035, 0.035 * rng.uniform(1.0, 1.8)
    profile = wall_profile(rng, height)
    wall, floor = 0.13, 0.15 * height
    heights, shares = [z for _, z in profile], [share for share, _ in profile]
    levels = [floor, *(z for z in heights if 1.15 * floor < z < height), height]
    inside = [(float(np.interp(z, heights, shares)) - wall, z) for z in levels]
    cup = vessel(profile_rings(circle(24), profile, radius), profile_rings(circle(24), inside, radius), sectors=12)
    stem, foot = radius * rng.uniform(0.5, 1.6), rng.uniform(0.7, 0.95)
    neck = rng.uniform(0.18, 0.3)
    stand = [(foot, 0.0), (foot, 0.1 * stem), (neck, 0.35 * stem), (neck, stem + 0.6 * floor)]
    return cup.moved(z=stem) + loft(profile_rings(circle(24), stand, radius))


def spoon(rng: np.random.Generator) -> Solid:
    """Returns a spoon, spatula or brush: a flat head on a stick."""
    length, thick = 0.16, 0.16 * rng.uniform(0.055, 0.075)
    stick = tube(np.array([[0.0, 0, 0], [length * 0.65, 0, 0]]), superellipse(10, 2.5, 1.3) * 0.5 * thick)
    flat: Outline = superellipse(20, rng.uniform(2.0, 6.0), rng.uniform(0.6, 1.0)) * 0.2 * length
    head = loft(
        [
            ring(flat, 0.9, -0.5 * thick),
            ring(flat, 1.0, -0.1 * thick),
            ring(flat, 1.0, 0.3 * thick),
            ring(flat, 0.9, 0.6 * thick),
        ]
    )
    return stick + head.moved(x=0.8 * length)


def hammer(rng: np.random.Generator) -> Solid:
    """Returns a hammer or mallet lying on its side."""
    length, grip = 0.16, 0.16 * rng.uniform(0.05, 0.08)
    stick = tube(
        np.array([[0, 0, 0], [0.4 * length, 0, 0], [length, 0, 0]]), superellipse(12, 2.5, 1.3) * grip, [1.1, 0.8, 0.8]
    )
    head_length, head = length * rng.uniform(0.35, 0.6), length * rng.uniform(0.09, 0.14)
    start = length - head
    if rng.random() < 0.5:
        face = loft(
            [
                ring(circle(16), head * share, z)
                for share, z in (
                    (0.9, 0.0),
                    (1.0, 0.1 * head_length),
                    (0.8, 0.35 * head_length),
                    (0.8, 0.65 * head_length),
                    (1.0, 0.9 * head_length),
                    (0.9, head_length),
                )
            ]
        )
        return stick + face.moved(z=-0.5 * head_length).turned(np.pi / 2, _X).moved(x=start)
    claw = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.4], [0.15, 2.4], [-0.1, 2.4], [-0.5, 0.4]]) * head * 1.6
    claw[:, 1] -= 0.6 * head
    return stick + extrude(claw, 1.6 * head).moved(z=-0.8 * head).moved(x=start)


def wrench(rng: np.random.Generator) -> Solid:
    """Returns an open or ring spanner lying flat."""
    length, thick = 0.15, 0.15 * rng.uniform(0.06, 0.1)
    half, jaw = length * rng.uniform(0.035, 0.06), length * rng.uniform(0.1, 0.15)
    gap, depth = jaw * rng.uniform(0.35, 0.5), jaw * rng.uniform(0.7, 1.1)
    mouth = [
        (half, -half),
        (half + jaw, -jaw),
        (half + 2.0 * jaw, -0.8 * jaw),
        (half + 2.0 * jaw, -gap),
        (half + 2.0 * jaw - depth, -gap),
    ]
    right = np.array([*mouth, *((x, -y) for x, y in reversed(mouth))]) + np.array([length / 2, 0.0])
    if rng.random() < 0.5:
        left = -right
        return extrude(np.concatenate([right, left]), thick)
    shaft = np.concatenate([right, [[-length / 2, half], [-length / 2, -half]]])
    eye = hollow_prism(circle(20) * jaw, circle(20) * jaw * 0.6, 1.2 * thick, sectors=10)
    return extrude(shaft, thick) + eye.moved(x=-length / 2 - 0.85 * jaw, z=-0.1 * thick)


def screwdriver(rng: np.random.Generator) -> Solid:
    """Returns a screwdriver, brush or torch lying along x: a thick grip and a thinner shaft."""
    length = 0.16
    grip, thick, thin = rng.uniform(0.35, 0.6), rng.uniform(0.08, 0.12), rng.uniform(0.03, 0.05)
    outline = circle(int(rng.choice([6, 8, 16])))
    levels = [
        (0.7 * thick, 0.0),
        (thick, 0.06),
        (0.85 * thick, 0.5 * grip),
        (thick, grip - 0.06),
        (thin, grip),
        (thin, 1.0),
    ]
    return loft([ring(outline, size * length, z * length) for size, z in levels]).turned(np.pi / 2, _Y)


def flashlight(rng: np.random.Generator) -> Solid:
    """Returns a torch, bulb or microphone: a handle with a wider round head."""
    length, radius = 0.13, 0.13 * rng.uniform(0.09, 0.13)
    head = rng.uniform(1.5, 2.2)
    if rng.random() < 0.5:
        profile = [(0.95, 0.0), (1.0, 0.03), (1.0, 0.6), (head, 0.75), (head, 1.0)]
    else:
        t = np.linspace(0.15, 0.97, 7) * np.pi
        globe = [
            (float(head * 1.2 * np.sin(a)), float(0.73 - 0.27 * np.cos(a))) for a in t if np.sin(a) * head * 1.2 > 0.3
        ]
        profile = [(1.0, 0.0), (1.0, min(0.42, globe[0][1] - 0.02)), *globe]
    return loft(profile_rings(circle(20), [(share, z * length) for share, z in profile], radius))


def dumbbell(rng: np.random.Generator) -> Solid:
    """Returns a dumbbell, bone or plunger standing on one end."""
    bar, height = rng.uniform(0.3, 0.55), 0.12 * rng.uniform(0.7, 1.3)
    weight = rng.uniform(0.2, 0.32)
    outline = circle(int(rng.choice([6, 8, 20])))
    top = rng.uniform(0.6, 1.0)
    levels = [
        (0.9, 0.0),
        (1.0, 0.04),
        (1.0, weight - 0.03),
        (bar, weight),
        (bar, 1 - weight),
        (top, 1.03 - weight),
        (top, 0.97),
        (0.9 * top, 1.0),
    ]
    return loft(profile_rings(outline, [(share, z * height) for share, z in levels], 0.033))


def banana(rng: np.random.Generator) -> Solid:
    """Returns a bent capsule: banana, croissant, cucumber, sausage."""
    turn = rng.uniform(0.3, 2.2)
    length = rng.uniform(0.12, 0.18)
    size = length * rng.uniform(0.09, 0.14)
    path = arc(length / turn, np.pi / 2 + turn / 2, np.pi / 2 - turn / 2, 11)
    t = np.linspace(-1.0, 1.0, 11)
    scales = np.maximum((1.0 - np.abs(t) ** rng.uniform(2.5, 6.0)) ** 0.5, rng.uniform(0.25, 0.4))
    return tube(path, circle(int(rng.choice([5, 6, 14]))) * size, list(scales)).turned(np.pi / 2, _X)


def egg(rng: np.random.Generator) -> Solid:
    """Returns an egg, lemon, pear or top: longer than a ball."""
    t = np.linspace(0.06, 0.94, 11) * np.pi
    stretch, pear = rng.uniform(1.45, 2.3), rng.uniform(-0.4, 0.4)
    profile = [(float(np.sin(a) * (1.0 + pear * np.cos(a))), float(-stretch * np.cos(a) * 0.03)) for a in t]
    return loft(profile_rings(circle(24), profile, 0.03))


def pear(rng: np.random.Generator) -> Solid:
    """Returns a standing turned figure: pear, bowling pin, pawn, vase lamp."""
    height, foot = 0.12 * rng.uniform(0.8, 1.4), rng.uniform(0.6, 0.85)
    waist, head = rng.uniform(0.3, 0.5), rng.uniform(0.45, 0.75)
    levels = [
        (foot, 0.0),
        (0.97, 0.15),
        (1.0, 0.28),
        (0.85, 0.42),
        (waist, 0.62),
        (head, 0.8),
        (0.9 * head, 0.9),
        (0.4 * head, 1.0),
    ]
    return loft(profile_rings(circle(SIDES), [(share, z * height) for share, z in levels], 0.033))


def mushroom(rng: np.random.Generator) -> Solid:
    """Returns a mushroom, knob or table lamp: a stem with a cap."""
    stem, cap_start = rng.uniform(0.35, 0.6), rng.uniform(0.35, 0.6)
    height = 0.07 * rng.uniform(0.8, 1.4)
    dome = [
        (float(np.cos(a)), cap_start + 0.06 + (0.94 - cap_start) * float(np.sin(a))) for a in np.linspace(0, 1.3, 6)
    ]
    profile = [(stem * 1.1, 0.0), (stem, 0.15), (stem, cap_start), (1.0, cap_start + 0.02), *dome]
    return loft(profile_rings(circle(SIDES), [(share, z * height) for share, z in profile], 0.035))


def donut(rng: np.random.Generator) -> Solid:
    """Returns a ring: donut, bracelet, gasket."""
    thin = rng.uniform(0.22, 0.45)
    path = 0.035 * arc(1.0, 0.0, 2.0 * np.pi, 21)[:-1]
    section = superellipse(12, rng.uniform(2.0, 4.0), rng.uniform(0.8, 1.4)) * 0.035 * thin
    return tube(path, section, closed=True).turned(np.pi / 2, _X)


def horseshoe(rng: np.random.Generator) -> Solid:
    """Returns a bent bar: horseshoe, hook, shackle, S-hook."""
    size = 0.035 * rng.uniform(0.22, 0.34)
    bend = arc(0.035, -0.15, np.pi + rng.uniform(-0.6, 0.3), 13)
    leg = np.array([[bend[0, 0], 0.0, -0.035 * rng.uniform(0.6, 1.8)]])
    section = superellipse(10, rng.uniform(2.0, 6.0), rng.uniform(0.7, 1.3)) * size
    return tube(np.concatenate([leg, bend]), section).turned(np.pi / 2, _X)
