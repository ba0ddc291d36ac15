"""Random things of the class "other": blocks, toys, and shapes without a name.

As in `containers`: every function returns one solid [m], upright as it would stand or lie on a table.
"""

import numpy as np
from trimesh.transformations import scale_and_translate

from icgnet.objects.containers import SIDES, profile_rings
from icgnet.objects.outlines import circle, rectangle, rounded_rectangle, superellipse
from icgnet.objects.solids import Solid, extrude, hull, loft, ring, tube
from icgnet.objects.sundries import arc

_X = (1.0, 0.0, 0.0)


def block(rng: np.random.Generator) -> Solid:
    """Returns an upright column whose outline is a letter, a cross or a profile: L, T, U, X, Z, H, step, arrow."""
    t = rng.uniform(0.28, 0.42)
    b = rng.uniform(0.7, 1.3)
    corner_l = [(0, 0), (1, 0), (1, t), (t, t), (t, b), (0, b)]
    letter_t = [
        (-t / 2, 0),
        (t / 2, 0),
        (t / 2, b - t),
        (0.5, b - t),
        (0.5, b),
        (-0.5, b),
        (-0.5, b - t),
        (-t / 2, b - t),
    ]
    letter_u = [(0, 0), (1, 0), (1, b), (1 - t, b), (1 - t, t), (t, t), (t, b), (0, b)]
    h = t / 2
    cross = [
        (h, 0.5),
        (-h, 0.5),
        (-h, h),
        (-0.5, h),
        (-0.5, -h),
        (-h, -h),
        (-h, -0.5),
        (h, -0.5),
        (h, -h),
        (0.5, -h),
        (0.5, h),
        (h, h),
    ]
    letter_z = [
        (0, 0),
        (1, 0),
        (1, t),
        (0.5 + h, t),
        (0.5 + h, b),
        (-0.2, b),
        (-0.2, b - t),
        (0.5 - h, b - t),
        (0.5 - h, t),
        (0, t),
    ]
    steps = [(0, 0), (1, 0), (1, 0.35), (0.66, 0.35), (0.66, 0.7), (0.33, 0.7), (0.33, 1.05), (0, 1.05)]
    arrow = [(-h, 0), (h, 0), (h, 0.5), (0.5, 0.5), (0, 1.1), (-0.5, 0.5), (-h, 0.5)]
    outlines = [corner_l, letter_t, letter_u, cross, letter_z, steps, arrow]
    outline = np.array(outlines[rng.integers(len(outlines))], np.float64)
    outline = 0.07 * (outline - 0.5 * (outline.min(axis=0) + outline.max(axis=0)))
    return extrude(outline, 0.07 * rng.uniform(0.4, 2.0))


def star(rng: np.random.Generator) -> Solid:
    """Returns a star, gear or flower prism."""
    teeth = int(rng.integers(4, 9))
    depth = rng.uniform(0.5, 0.8)
    if rng.random() < 0.5:
        radius = np.where(np.arange(2 * teeth) % 2 == 0, 1.0, depth)
        outline = circle(2 * teeth) * radius[:, None]
    else:
        radius = np.where(np.arange(4 * teeth) % 4 < 2, 1.0, max(depth, 0.65))
        outline = circle(4 * teeth) * radius[:, None]
    return extrude(0.035 * outline, 0.07 * rng.uniform(0.3, 1.4))


def brick(rng: np.random.Generator) -> Solid:
    """Returns a building brick with studs."""
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(1, 3))
    pitch, height = 0.03, 0.03 * rng.uniform(0.8, 2.0)
    solid = loft([ring(rectangle(columns * pitch, rows * pitch), 1.0, z) for z in (0.0, height)])
    stud = loft([ring(circle(12), 0.3 * pitch, height - 0.002), ring(circle(12), 0.3 * pitch, height + 0.2 * pitch)])
    for column in range(columns):
        for row in range(rows):
            solid = solid + stud.moved(x=(column - (columns - 1) / 2) * pitch, y=(row - (rows - 1) / 2) * pitch)
    return solid


def house(rng: np.random.Generator) -> Solid:
    """Returns a prism over an irregular convex outline: house, wedge, gem, cheese, segment."""
    style = rng.integers(3)
    if style == 0:
        outline = np.array([[-0.5, 0], [0.5, 0], [0.5, 0.6], [0, rng.uniform(0.8, 1.2)], [-0.5, 0.6]])
    elif style == 1:
        outline = np.array([[-0.5, 0], [0.5, 0], [rng.uniform(-0.5, 0.3), rng.uniform(0.5, 1.0)]])
    else:
        angle = np.linspace(0.0, rng.uniform(1.2, np.pi), 9)
        outline = np.column_stack([np.cos(angle), np.sin(angle)])
        outline = np.concatenate([outline, [[0.0, 0.0]]]) if angle[-1] < 3.1 else outline
    outline = 0.07 * (outline - outline.mean(axis=0))
    return extrude(outline, 0.07 * rng.uniform(0.4, 1.3))


def cone(rng: np.random.Generator) -> Solid:
    """Returns a cone, pyramid or bishop's hat, sharp or cut off."""
    outline = circle(int(rng.choice([3, 4, 5, SIDES, SIDES])))
    height, tip = 0.08 * rng.uniform(0.7, 1.8), rng.uniform(0.05, 0.5)
    base = rng.choice([0.0, 0.1]) * height
    profile = [(1.0, 0.0), *([(1.0, base)] if base else []), (tip, height)]
    return loft(profile_rings(outline, profile, 0.035))


def rock(rng: np.random.Generator) -> Solid:
    """Returns a stone: the hull of random points in a stretched ball."""
    points = rng.normal(size=(int(rng.integers(12, 40)), 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return hull(0.04 * points * rng.uniform(0.75, 1.0, (len(points), 1)) * rng.uniform(0.6, 1.3, 3))


def camera(rng: np.random.Generator) -> Solid:
    """Returns a camera, radio or stapled gadget: a box with a cylinder at its front and a knob on top."""
    x, y, z = 0.1 * np.array([1.0, rng.uniform(0.3, 0.5), rng.uniform(0.55, 0.8)])
    outline = rounded_rectangle(x, y, 0.2 * y, corner_points=4)
    body = loft([ring(outline, 1.0, 0.0), ring(outline, 1.0, z)])
    lens_radius, lens = z * rng.uniform(0.25, 0.42), y * rng.uniform(0.4, 1.2)
    barrel = loft(
        [ring(circle(20), lens_radius, 0.0), ring(circle(20), lens_radius * rng.uniform(0.8, 1.0), lens + 0.003)]
    )
    barrel = barrel.turned(np.pi / 2, _X).moved(x=x * rng.uniform(-0.15, 0.15), y=-y / 2 + 0.003, z=0.5 * z)
    knob = loft([ring(circle(16), 0.35 * y, z - 0.002), ring(circle(16), 0.35 * y, z + 0.25 * y)]).moved(x=0.3 * x)
    return body + barrel + knob


def toy_car(rng: np.random.Generator) -> Solid:
    """Returns a car or shoe: a long low body, a cabin, wheels."""
    length, width, low = 0.11, 0.11 * rng.uniform(0.38, 0.5), 0.11 * rng.uniform(0.14, 0.2)
    wheel = low * rng.uniform(0.55, 0.75)
    hood = rng.uniform(0.1, 0.35)
    side = np.array([[-0.5, 0], [0.5, 0], [0.5, 0.8], [0.5 - hood, 1.0], [0.32 - hood, 2.0], [-0.3, 2.0], [-0.5, 1.0]])
    outline = side * np.array([length, low])
    solid = extrude(outline, width).turned(np.pi / 2, _X).moved(y=width / 2, z=0.5 * wheel)
    disc = loft([ring(circle(14), wheel, z) for z in (0.0, 0.22 * width)]).turned(np.pi / 2, _X)
    for x in (-0.3, 0.3):
        solid = (
            solid
            + disc.moved(x=x * length, y=-0.42 * width, z=wheel * 0.9)
            + disc.moved(x=x * length, y=0.64 * width, z=wheel * 0.9)
        )
    return solid


def shoe(rng: np.random.Generator) -> Solid:
    """Returns a shoe or boot: a sole lofted from heel to toe, with a shaft."""
    length = 0.13
    stations = np.array(
        [
            [-0.5, 0.3, 0.3],
            [-0.4, 0.36, 0.42],
            [-0.1, 0.33, 0.4],
            [0.2, 0.42, 0.27],
            [0.42, 0.36, 0.18],
            [0.5, 0.2, 0.12],
        ]
    )
    outline = rounded_rectangle(1.0, 1.0, 0.3, corner_points=4)
    rings = []
    for x, width, height in stations * np.array([length, 0.9 * length, length]):
        flat = outline * np.array([height, width])
        rings.append(np.column_stack([np.full(len(flat), x), flat[:, 1], height / 2 - flat[:, 0]]))
    shaft_height = length * rng.uniform(0.45, 0.8)
    oval = superellipse(16, 2.3, 0.75)
    shaft = loft(
        [
            ring(oval, 0.15 * length, 0.2 * length, x=-0.28 * length),
            ring(oval, 0.17 * length, shaft_height, x=-0.3 * length),
        ]
    )
    return loft(rings) + shaft


def chair(rng: np.random.Generator) -> Solid:
    """Returns a toy chair, stool or table."""
    width, leg, seat = 0.06, 0.06 * rng.uniform(0.14, 0.2), 0.06 * rng.uniform(0.15, 0.22)
    height = 0.06 * rng.uniform(0.6, 1.0)
    solid = loft([ring(rectangle(width, width), 1.0, height), ring(rectangle(width, width), 1.0, height + seat)])
    post = loft([ring(rectangle(leg, leg), 1.0, 0.0), ring(rectangle(leg, leg), 1.0, height + 0.002)])
    offset = (width - leg) / 2
    for x in (-offset, offset):
        for y in (-offset, offset):
            solid = solid + post.moved(x=x, y=y)
    if rng.random() < 0.6:
        back = loft([ring(rectangle(leg, width), 1.0, z) for z in (height + seat - 0.002, height + seat + 0.9 * width)])
        solid = solid + back.moved(x=-offset)
    return solid


def padlock(rng: np.random.Generator) -> Solid:
    """Returns a padlock, kettlebell or bag: a body with a closed bow."""
    width, depth, height = 0.05, 0.05 * rng.uniform(0.35, 0.9), 0.05 * rng.uniform(0.7, 1.2)
    outline = rounded_rectangle(width, depth, 0.25 * depth, corner_points=4)
    body = loft(
        [
            ring(outline, 0.9, 0.0),
            ring(outline, 1.0, 0.1 * height),
            ring(outline, 1.0, 0.9 * height),
            ring(outline, 0.9, height),
        ]
    )
    bow = arc(1.0, 0.0, np.pi, 9) * np.array([0.34 * width, 0.0, height * rng.uniform(0.35, 0.7)])
    ends = np.array([[0.34 * width, 0.0, -0.1 * height], [-0.34 * width, 0.0, -0.1 * height]])
    path = np.concatenate([ends[:1], bow, ends[1:]]) + np.array([0.0, 0.0, height])
    return body + tube(path, superellipse(10, 2.5) * 0.05 * rng.uniform(0.07, 0.11))


def ellipsoid(sides: np.ndarray, centre: np.ndarray, exponent: float = 2.0) -> Solid:
    """Returns an ellipsoid or, with an exponent over 2, a rounded block [m]."""
    t = np.linspace(0.08, 0.92, 7) * np.pi
    power = 2.0 / exponent
    profile = [(float(np.sin(a) ** power), float(-np.sign(np.cos(a)) * np.abs(np.cos(a)) ** power)) for a in t]
    solid = loft([ring(superellipse(16, exponent), share, z) for share, z in profile])
    return solid.transformed(scale_and_translate(sides, centre))


def animal(rng: np.random.Generator) -> Solid:
    """Returns a toy animal: ellipsoids for body, head, ears and legs, and a tail."""
    body = 0.035 * np.array([1.0, rng.uniform(0.5, 0.75), rng.uniform(0.5, 0.9)])
    leg, exponent = 0.035 * rng.uniform(0.4, 1.1), rng.uniform(2.0, 3.0)
    middle = leg + 0.8 * body[2]
    head = 0.035 * rng.uniform(0.4, 0.65)
    head_at = np.array([0.9 * body[0] + 0.3 * head, 0.0, middle + body[2] * rng.uniform(0.3, 1.1)])
    solid = ellipsoid(body, np.array([0.0, 0.0, middle]), exponent)
    solid = solid + ellipsoid(head * np.array([1.2, 0.9, 1.0]), head_at, exponent)
    foot = loft([ring(circle(10), 0.28 * body[1], z) for z in (0.0, middle)])
    ear = ellipsoid(head * np.array([0.25, 0.3, rng.uniform(0.5, 1.1)]), np.zeros(3))
    for side in (-1.0, 1.0):
        solid = solid + ear.moved(head_at[0], side * 0.5 * head, head_at[2] + 0.9 * head)
        for x in (-0.6, 0.55):
            solid = solid + foot.moved(x * body[0], side * 0.5 * body[1])
    tail = np.array([[-0.85, 0.0, 0.2], [-1.15, 0.0, 0.5], [-1.25, 0.0, 1.2]]) * body + np.array([0.0, 0.0, middle])
    return solid + tube(tail, circle(8) * 0.035 * rng.uniform(0.1, 0.16))


def lump(rng: np.random.Generator) -> Solid:
    """Returns something without a name: two or three rounded blocks grown into each other."""
    centre = np.zeros(3)
    solid = ellipsoid(0.03 * rng.uniform(0.45, 1.0, 3), centre, rng.uniform(2.0, 5.0))
    for _ in range(int(rng.integers(1, 3))):
        direction = rng.normal(size=3) * np.array([1.0, 1.0, 0.5])
        centre = centre + 0.024 * direction / np.linalg.norm(direction)
        solid = solid + ellipsoid(0.03 * rng.uniform(0.45, 1.0, 3), centre, rng.uniform(2.0, 5.0))
    return solid


def twisted_column(rng: np.random.Generator) -> Solid:
    """Returns a leaning, twisted or swelling column with a flat foot."""
    outline = superellipse(20, rng.uniform(2.0, 7.0), rng.uniform(0.5, 1.0))
    twist, lean = rng.uniform(-0.8, 0.8), 0.02 * rng.uniform(-1.0, 1.0)
    height, sizes = 0.08 * rng.uniform(0.8, 1.8), rng.uniform(0.7, 1.1, 3)
    rings = []
    for t in np.linspace(0.0, 1.0, 7):
        angle = twist * t
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        size = 0.03 * float(np.interp(t, [0.0, 0.5, 1.0], sizes))
        rings.append(ring(outline @ turn, size, t * height, x=lean * t))
    return loft(rings)
