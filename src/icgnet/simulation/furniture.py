"""Random tables and bins, and the things around objects that are no objects themselves."""

import numpy as np
from jaxtyping import Float

from icgnet.geometry.transforms import make_transform, rotation_z
from icgnet.geometry.workspace import CENTRE, TABLE_HEIGHT
from icgnet.simulation.config import WideScenes
from icgnet.simulation.surroundings import BIN_WALL, Structure, Surroundings, block, rod

WALL, POST, ROBOT, SCREEN, EDGE, FLOOR = "wall", "post", "robot", "screen", "table edge", "floor"
FLOOR_EDGE = 3.0
"""Length and width of the floor that is modelled [m]."""
BELOW = 0.0005
"""The body of a table begins this far below its top, which the simulation and the camera have apart [m]."""
CHANCES = {"table": {WALL: 0.25, POST: 0.25, ROBOT: 0.2, SCREEN: 0.15}, "bin": {WALL: 0.25, POST: 0.1, ROBOT: 0.1}}
"""How often a scene has at least one of each; all of them are taller than any object, or hang from above."""


def draw_table(config: WideScenes, rng: np.random.Generator) -> Surroundings:
    """A table top with its edge, the floor below, and things on and beside it."""
    width, depth = rng.uniform(*config.table_edge, 2)
    extent = _extent(width, depth)
    thickness, height = rng.uniform(0.02, 0.05), rng.uniform(0.3, 0.8)
    top = _on(0.0, 0.0, TABLE_HEIGHT - BELOW - thickness / 2)
    structures = [block(EDGE, (width, depth, thickness), top), _floor(TABLE_HEIGHT - height)]
    structures += _things("table", width, depth, rng)
    return _rounded(extent, structures)


def draw_bin(config: WideScenes, rng: np.random.Generator) -> Surroundings:
    """A bin with upright or sloping walls and sometimes rounded corners, on a table or the floor."""
    width, depth = rng.uniform(*config.bin_edge, 2)
    height, wall = rng.uniform(*config.bin_height), rng.uniform(0.003, 0.015)
    slope = np.deg2rad(rng.uniform(*config.bin_slope_deg)) if rng.random() < 0.5 else 0.0
    structures = [_bin_wall(side, width, depth, height, wall, slope) for side in range(4)]
    if rng.random() < 0.5:
        structures += _corners(width, depth, height, wall, slope, rng.uniform(0.01, 0.04))
    structures.append(_floor(TABLE_HEIGHT - rng.uniform(0.003, 0.01)))
    reach = 2 * (wall + height * np.tan(slope))
    structures += _things("bin", width + reach, depth + reach, rng)
    return _rounded(_extent(width, depth), structures)


def _bin_wall(side: int, width: float, depth: float, height: float, wall: float, slope: float) -> Structure:
    """The wall on one of the four sides, leaning outwards by `slope` [rad]."""
    length, away = (depth, width) if side % 2 == 0 else (width, depth)
    yaw = rotation_z(side * np.pi / 2 - np.pi / 2)
    foot = yaw @ np.array([0.0, away / 2, 0.0])
    pose = make_transform(yaw @ _leaning(slope), _support_centre() + foot)
    centre = make_transform(np.eye(3), np.array([0.0, wall / 2, height / np.cos(slope) / 2]))
    flare = (length + 2 * wall + 2 * height * np.tan(slope)) / (length + 2 * wall)
    return block(BIN_WALL, (length + 2 * wall, wall, height / np.cos(slope)), pose @ centre, flare)


def _corners(width: float, depth: float, height: float, wall: float, slope: float, radius: float) -> list[Structure]:
    """Plates across the corners of a bin, which stand for rounded ones of about this radius [m]."""
    steep = float(np.arctan(np.tan(slope) * np.sqrt(2.0)))
    plates = []
    for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1)):
        yaw = rotation_z(float(np.arctan2(y, x)) - np.pi / 2)
        foot = np.array([x * (width - radius) / 2, y * (depth - radius) / 2, 0.0])
        pose = make_transform(yaw @ _leaning(steep), _support_centre() + foot)
        centre = make_transform(np.eye(3), np.array([0.0, wall / 2, height / np.cos(steep) / 2]))
        plates.append(block(BIN_WALL, (radius * np.sqrt(2.0), wall, height / np.cos(steep)), pose @ centre))
    return plates


def _things(kind: str, width: float, depth: float, rng: np.random.Generator) -> list[Structure]:
    """What stands on a table (beside a bin) of this size, and behind it."""
    things: list[Structure] = []
    chances = CHANCES[kind]
    if rng.random() < chances[WALL]:
        yaw, gap = rng.integers(4) * np.pi / 2, rng.uniform(0.0, 0.3)
        away = (depth if round(yaw / (np.pi / 2)) % 2 == 0 else width) / 2 + gap + 0.025
        things.append(_upright(WALL, (2.5, 0.05, rng.uniform(0.5, 1.2)), yaw, rotation_z(yaw)[:2, 1] * away))
    if rng.random() < chances[POST]:
        for _ in range(rng.integers(1, 3)):
            things.append(_post(_place(kind, width, depth, rng), rng))
    if rng.random() < chances[ROBOT]:
        things += _robot(_place(kind, width, depth, rng), rng)
    if rng.random() < chances.get(SCREEN, 0.0):
        things += _screen(width, depth, rng)
    return things


def _place(kind: str, width: float, depth: float, rng: np.random.Generator) -> Float[np.ndarray, "2"]:
    """Somewhere on the outer part of a table, or beside a bin, from the middle [m]."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    direction = np.array([np.cos(angle), np.sin(angle)])
    # Beside a bin, nothing that stands there reaches inside: the thickest of it is 18 cm wide.
    share, beside = (rng.uniform(0.6, 1.0), 0.0) if kind == "table" else (1.0, rng.uniform(0.095, 0.2))
    half = np.array([width, depth]) / 2 + beside
    return direction * share / np.abs(direction / half).max()


def _post(place: Float[np.ndarray, "2"], rng: np.random.Generator) -> Structure:
    height, thickness = rng.uniform(0.32, 0.7), rng.uniform(0.02, 0.08)
    if rng.random() < 0.5:
        return rod(POST, thickness, height, _on(place[0], place[1], TABLE_HEIGHT + height / 2))
    return _upright(POST, (thickness, rng.uniform(0.02, 0.08), height), rng.uniform(0.0, np.pi), place)


def _robot(place: Float[np.ndarray, "2"], rng: np.random.Generator) -> list[Structure]:
    """The foot and upper arm of a robot, or a forearm that comes in from above."""
    if rng.random() < 0.5:
        height, thickness = rng.uniform(0.32, 0.5), rng.uniform(0.11, 0.18)
        foot = rod(ROBOT, thickness, height, _on(place[0], place[1], TABLE_HEIGHT + height / 2))
        elbow = np.array([*place, height + TABLE_HEIGHT])
        return [foot, _limb(elbow, rng.uniform(0.25, 0.4), rng)]
    return [_limb(np.array([*place, TABLE_HEIGHT + rng.uniform(0.2, 0.45)]), rng.uniform(0.4, 0.6), rng)]


def _limb(start: Float[np.ndarray, "3"], length: float, rng: np.random.Generator) -> Structure:
    """A thick rod that leads upwards from a point, seen from the support's centre [m]."""
    yaw, tilt = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(0.2, 1.2)
    rotation = rotation_z(yaw) @ _leaning(tilt)
    at = np.array([CENTRE[0], CENTRE[1], 0.0]) + start + rotation[:, 2] * length / 2
    return rod(ROBOT, rng.uniform(0.07, 0.12), length, make_transform(rotation, at))


def _screen(width: float, depth: float, rng: np.random.Generator) -> list[Structure]:
    """A monitor on a stand near the edge of the table."""
    yaw = rng.integers(4) * np.pi / 2 + rng.normal(scale=0.2)
    away = 0.45 * (depth if round(yaw / (np.pi / 2)) % 2 == 0 else width)
    place = rotation_z(yaw)[:2, 1] * away
    size, lift = (rng.uniform(0.35, 0.55), 0.02, rng.uniform(0.22, 0.35)), rng.uniform(0.05, 0.12)
    pose = make_transform(
        rotation_z(yaw) @ _leaning(rng.uniform(0.0, 0.2)), _support_centre() + [*place, lift + size[2] / 2]
    )
    stand = _upright(SCREEN, (0.06, 0.02, lift + 0.1), yaw, place + 0.03 * rotation_z(yaw)[:2, 1])
    return [block(SCREEN, size, pose), stand, _upright(SCREEN, (0.22, 0.16, 0.012), yaw, place)]


def _upright(name: str, size: tuple[float, float, float], yaw: float, place: Float[np.ndarray, "2"]) -> Structure:
    """A block that stands on the support, turned by `yaw` [rad]."""
    at = _support_centre() + [*place, size[2] / 2]
    return block(name, size, make_transform(rotation_z(yaw), at))


def _floor(height: float) -> Structure:
    return block(FLOOR, (FLOOR_EDGE, FLOOR_EDGE, 0.1), _on(0.0, 0.0, height - 0.05))


def _on(x: float, y: float, z: float) -> Float[np.ndarray, "4 4"]:
    """An upright pose at this height [m], x and y from the middle of the support."""
    return make_transform(np.eye(3), np.array([CENTRE[0] + x, CENTRE[1] + y, z]))


def _support_centre() -> Float[np.ndarray, "3"]:
    return np.array([CENTRE[0], CENTRE[1], TABLE_HEIGHT])


def _leaning(angle: float) -> Float[np.ndarray, "3 3"]:
    """A turn about x that moves the z axis towards +y by this angle [rad]."""
    return np.array([[1.0, 0.0, 0.0], [0.0, np.cos(angle), np.sin(angle)], [0.0, -np.sin(angle), np.cos(angle)]])


def _extent(width: float, depth: float) -> tuple[float, float, float, float]:
    x, y = CENTRE[:2]
    return x - width / 2, y - depth / 2, x + width / 2, y + depth / 2


def _rounded(extent: tuple[float, float, float, float], structures: list[Structure]) -> Surroundings:
    """Surroundings in the single precision in which recipes keep them, so that labels are about the same ones."""
    lower_x, lower_y, upper_x, upper_y = np.array(extent, np.float32).tolist()
    kept = tuple(Structure(each.name, each.corners.astype(np.float32)) for each in structures)
    return Surroundings((lower_x, lower_y, upper_x, upper_y), kept)
