"""Random tools of real sizes: for the workshop, the desk and the kitchen.

As in `tableware`: every function returns one solid of its real size [m], lying as it would on a table.
"""

import numpy as np
from trimesh.transformations import scale_and_translate

from icgnet.objects import sundries
from icgnet.objects.outlines import circle, rectangle, rounded_rectangle, superellipse
from icgnet.objects.solids import Solid, extrude, hull, loft, ring, tube, vessel

_X, _Y, _Z = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)


def _sized(solid: Solid, length: float) -> Solid:
    """Returns a solid scaled until its longest side is `length` [m]."""
    factor = length / float(solid.extents.max())
    return solid.transformed(scale_and_translate(np.full(3, factor), np.zeros(3)))


def hammer(rng: np.random.Generator) -> Solid:
    """Returns a hammer or mallet, 22 to 33 cm long."""
    return _sized(sundries.hammer(rng), rng.uniform(0.22, 0.33))


def wrench(rng: np.random.Generator) -> Solid:
    """Returns an open or ring spanner, 12 to 28 cm long."""
    return _sized(sundries.wrench(rng), rng.uniform(0.12, 0.28))


def screwdriver(rng: np.random.Generator) -> Solid:
    """Returns a screwdriver, chisel or brush, 15 to 27 cm long."""
    return _sized(sundries.screwdriver(rng), rng.uniform(0.15, 0.27))


def _grip(length: float, half: float, exponent: float, aspect: float) -> Solid:
    """Returns a handle along -x from the origin, thickest in its hind half."""
    sizes = [(0.0, 0.75), (0.25, 0.85), (0.7, 1.0), (0.97, 0.9), (1.0, 0.6)]
    path = np.array([[-share * length, 0.0, 0.0] for share, _ in sizes])
    return tube(path, superellipse(14, exponent, aspect) * half, [size for _, size in sizes])


def pliers(rng: np.random.Generator) -> Solid:
    """Returns pliers, pincers or tongs: two bowed legs that cross at a pivot, with jaws in front of it."""
    length, thick = rng.uniform(0.09, 0.13), rng.uniform(0.008, 0.013)
    spread, jaw = rng.uniform(0.018, 0.032), rng.uniform(0.03, 0.06)
    t = np.linspace(0.0, 1.0, 6)
    bow = spread * (t**0.6 + rng.uniform(0.0, 0.35) * np.sin(np.pi * t))
    path = np.column_stack([-length * t, bow, np.full(6, 0.5 * thick)])
    leg = tube(path, superellipse(10, 3.0, 1.2) * rng.uniform(0.0045, 0.006), side=_Z)
    base, tip, gap = rng.uniform(0.008, 0.012), rng.uniform(0.002, 0.006), rng.uniform(0.0, 0.15)
    side = np.array([[-0.004, 0.0], [jaw, 0.0], [jaw, tip], [0.35 * jaw, base], [-0.004, base]])
    half_jaw = extrude(side, thick).turned(gap, _Z)
    other_jaw = extrude(side[::-1] * [1.0, -1.0], thick).turned(-gap, _Z)
    pivot = loft([ring(circle(16), base, z) for z in (-0.001, thick + 0.001)])
    return leg + leg.turned(np.pi, _X).moved(z=thick) + half_jaw + other_jaw + pivot


def scissors(rng: np.random.Generator) -> Solid:
    """Returns scissors, a little open or closed, with a ring for the thumb and a longer one for the fingers."""
    blade, thick = rng.uniform(0.06, 0.12), rng.uniform(0.0025, 0.004)
    width, shank = rng.uniform(0.009, 0.014), rng.uniform(0.03, 0.05)
    opening = rng.uniform(0.03, 0.3)
    size = rng.uniform(0.0032, 0.0045)
    halves = []
    for side, stretch in ((1.0, 1.0), (-1.0, rng.uniform(1.0, 1.5))):
        low = 0.0 if side > 0.0 else thick
        edge = np.array([[-0.012, -width / 2], [0.0, -width / 2], [blade, 0.0], [0.0, width / 2], [-0.012, width / 2]])
        wide, long = rng.uniform(0.014, 0.017), rng.uniform(0.017, 0.022) * stretch
        angle = np.linspace(0.0, 2.0 * np.pi, 13)[:-1]
        middle = np.array([-shank - long, wide + size])
        path = np.column_stack([middle[0] + long * np.cos(angle), middle[1] + wide * np.sin(angle), np.zeros(12)])
        loop = tube(path, superellipse(8, 2.5, 1.1) * size, side=_Z, closed=True)
        bar = np.array([[-0.008, 0.0, 0.0], [-0.55 * shank, 0.003, 0.0], [-shank - 0.3 * long, 0.5 * size, 0.0]])
        arm = tube(bar, superellipse(8, 3.0, 0.9) * size, side=_Z)
        half = extrude(edge, thick).moved(z=low) + (arm + loop).moved(z=thick)
        turn = -0.5 * opening
        halves.append(half.turned(turn, _Z) if side > 0.0 else _mirrored(half.turned(turn, _Z)))
    screw = loft([ring(circle(12), 0.0045, z) for z in (-0.001, 2.0 * thick + 0.001)])
    return halves[0] + halves[1] + screw


def _mirrored(solid: Solid) -> Solid:
    """Returns the mirror image in the plane y = 0, with its faces turned so that they point outwards again."""
    mirror = np.array([1.0, -1.0, 1.0])
    return Solid(solid.vertices * mirror, solid.faces[:, ::-1], tuple(part * mirror for part in solid.parts))


def spatula(rng: np.random.Generator) -> Solid:
    """Returns a turner, scraper or trowel: a thin blade on a bent stick."""
    blade, width = rng.uniform(0.07, 0.12), rng.uniform(0.05, 0.09)
    thick, lift = rng.uniform(0.002, 0.004), rng.uniform(0.01, 0.045)
    shape = rounded_rectangle(blade, width, rng.uniform(0.004, 0.02), corner_points=4)
    taper = 1.0 - rng.uniform(0.0, 0.35) * (0.5 - shape[:, 0] / blade)
    plate = loft([ring(shape * np.column_stack([np.ones(len(shape)), taper]), 1.0, z) for z in (0.0, thick)])
    neck, rod = rng.uniform(0.05, 0.1), rng.uniform(0.003, 0.0045)
    start = -0.5 * blade
    path = np.array(
        [[start + 0.012, 0.0, 0.5 * thick], [start - 0.3 * neck, 0.0, 0.6 * lift], [start - neck, 0.0, lift]]
    )
    stick = tube(path, superellipse(8, 2.5, 1.3) * rod)
    handle = _grip(rng.uniform(0.09, 0.13), rng.uniform(0.007, 0.011), 2.5, rng.uniform(1.0, 1.5))
    return plate + stick + handle.moved(x=start - neck + 0.01, z=lift)


def spoon(rng: np.random.Generator) -> Solid:
    """Returns a spoon or ladle: a hollow oval head on a flat or bent stick."""
    ladle = rng.random() < 0.35
    radius = rng.uniform(0.03, 0.045) if ladle else rng.uniform(0.018, 0.034)
    depth = radius * (rng.uniform(0.6, 0.9) if ladle else rng.uniform(0.25, 0.45))
    wall = rng.uniform(0.0015, 0.0025)
    outline = superellipse(24, 2.0, rng.uniform(0.9, 1.0) if ladle else rng.uniform(0.6, 0.85))
    t = np.linspace(0.35, 1.0, 4)
    outer = [ring(outline, radius * float(np.sqrt(1.0 - (1.0 - s) ** 2)), depth * float(s - t[0])) for s in t]
    top = depth * float(1.0 - t[0])
    inner = [
        ring(outline, radius * float(np.sqrt(1.0 - (1.0 - s) ** 2)) - wall, depth * float(s - t[0]))
        for s in np.linspace(0.35 + wall / depth, 1.0, 3)
    ]
    head = vessel(outer, inner, sectors=8)
    length, rod = rng.uniform(0.12, 0.26), rng.uniform(0.0028, 0.0045)
    lift = length * (rng.uniform(0.3, 0.7) if ladle else rng.uniform(0.02, 0.12))
    begin = radius - 0.5 * wall
    path = np.array(
        [[begin, 0.0, top - rod], [begin + 0.15 * length, 0.0, top + 0.5 * lift], [begin + length, 0.0, top + lift]]
    )
    return head + tube(path, superellipse(10, 3.0, rng.uniform(1.0, 2.2)) * rod, [0.8, 0.9, 1.5])


def knife(rng: np.random.Generator) -> Solid:
    """Returns a kitchen knife or cutter lying flat."""
    blade, height, thick = rng.uniform(0.08, 0.2), rng.uniform(0.018, 0.045), rng.uniform(0.0018, 0.003)
    drop = rng.uniform(0.2, 0.8) * height
    outline = np.array([[0.0, 0.0], [0.75 * blade, 0.0], [blade, drop], [0.8 * blade, height], [0.0, height]])
    half = rng.uniform(0.008, 0.011)
    handle = _grip(rng.uniform(0.09, 0.13), half, 3.0, rng.uniform(1.1, 1.6))
    edge = hull(np.concatenate([ring(outline, 1.0, z) for z in (0.0, thick)]))
    return edge.moved(x=-0.015, y=-0.6 * height, z=half - 0.5 * thick) + handle.moved(z=half)


def whisk(rng: np.random.Generator) -> Solid:
    """Returns a whisk: loops of wire that cross at the tip, on a handle."""
    length, radius = rng.uniform(0.09, 0.15), rng.uniform(0.022, 0.036)
    wire, loops = rng.uniform(0.0012, 0.0018), int(rng.integers(3, 5))
    angle = np.linspace(0.0, np.pi, 10)
    belly = rng.uniform(0.55, 0.7)
    x = length * (1.0 - np.abs(np.cos(angle)) ** 1.5)
    y = radius * np.sign(np.cos(angle)) * np.sin(np.pi * (1.0 - x / length) ** belly)
    y[[0, -1]] = [0.004, -0.004]
    x[[0, -1]] = -0.01
    loop = tube(np.column_stack([x, y, np.zeros(10)]), circle(6) * wire, side=_Z)
    body = _grip(rng.uniform(0.09, 0.13), rng.uniform(0.008, 0.012), 2.0, 1.0)
    for turn in np.arange(loops) * np.pi / loops:
        body = body + loop.turned(float(turn), _X)
    return body


def drill(rng: np.random.Generator) -> Solid:
    """Returns a cordless drill or hot-glue gun lying on its side: a barrel, a grip and perhaps a battery."""
    length, radius = rng.uniform(0.13, 0.19), rng.uniform(0.022, 0.032)
    tip = rng.uniform(0.25, 0.5)
    profile = [(0.85, 0.0), (1.0, 0.06), (1.0, 0.6), (tip + 0.15, 0.75), (tip, 0.8), (0.8 * tip, 1.0)]
    barrel = loft([ring(circle(20), share * radius, z * length) for share, z in profile]).turned(np.pi / 2, _Y)
    grip, lean = rng.uniform(0.09, 0.13), rng.uniform(0.0, 0.35)
    at = rng.uniform(0.15, 0.35) * length
    path = np.array([[at, 0.0, 0.0], [at - 0.6 * lean * grip, 0.0, -0.6 * grip], [at - lean * grip, 0.0, -grip]])
    body = barrel + tube(path, superellipse(12, 2.6, 0.75) * rng.uniform(0.017, 0.022), [1.0, 0.9, 1.0])
    if rng.random() < 0.7:
        base = rounded_rectangle(rng.uniform(0.07, 0.1), rng.uniform(0.05, 0.065), 0.008, corner_points=3)
        high = rng.uniform(0.02, 0.045)
        body = body + loft(
            [ring(base, 1.0, -grip - 0.8 * high, x=path[2, 0]), ring(base, 1.0, 0.2 * high - grip, x=path[2, 0])]
        )
    trigger = loft([ring(rectangle(0.016, 0.01), 1.0, z, x=at + 0.016) for z in (-radius - 0.025, -0.5 * radius)])
    return (body + trigger).turned(np.pi / 2, _X)
