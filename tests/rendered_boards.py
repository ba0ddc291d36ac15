"""Pictures of a printed board as a camera on an arm, or beside it, would take them; everything about them is known."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from icgnet.camera_calibration.board import Board
from icgnet.camera_calibration.settings import BoardLayout
from icgnet.geometry.camera import look_at
from icgnet.geometry.transforms import invert_transform, make_transform, rotation_z

LAYOUT = BoardLayout()
SHAPE = (720, 1280)
K = np.array([[920.0, 0.0, 643.4], [0.0, 918.0, 357.1], [0.0, 0.0, 1.0]])
DISTORTION = np.array([0.08, -0.18, 0.001, -0.0008, 0.05])
PIXELS, AROUND = 100, 100
"""Of a square of the board, and of the white paper around it, in the picture that cameras look at."""
BLUR, NOISE = 0.7, 3.0
"""Of a lens [pixels], and of a sensor [grey levels of 255]."""


def turned(x: float, y: float, z: float, place: tuple[float, float, float]) -> np.ndarray:
    """A pose by angles about x, y and z [degrees] and a place [m]."""
    return make_transform(Rotation.from_euler("xyz", (x, y, z), degrees=True).as_matrix(), np.array(place))


T_TOOL_CAMERA = turned(5.0, -8.0, 88.0, (0.06, 0.01, 0.04))
T_BASE_CAMERA = turned(-150.0, 4.0, 35.0, (0.7, 0.3, 0.6))
T_BASE_BOARD = turned(180.0, 2.0, 30.0, (0.5, 0.05, 0.01))
T_TOOL_BOARD = turned(10.0, -5.0, 40.0, (-0.1, -0.06, 0.05))


@dataclass(frozen=True, eq=False)
class Taken:
    """Pictures by their names, and T_base_tool at each."""

    images: dict[str, np.ndarray]
    poses: dict[str, np.ndarray]


@cache
def camera_rays() -> np.ndarray:
    """Directions through all pixels, the lens's distortion undone."""
    v, u = np.indices(SHAPE, float)
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)[:, None]
    until = (cv2.TERM_CRITERIA_COUNT, 20, 0.0)
    straight = cv2.undistortPointsIter(pixels, K, DISTORTION, None, None, until)[:, 0]
    return np.concatenate([straight, np.ones((len(straight), 1))], axis=1)


def photograph(T_camera_board: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """What a camera sees of the board: each ray through the lens falls on the paper, or on grey beside it."""
    paper = cv2.GaussianBlur(np.pad(Board(LAYOUT).image(PIXELS), AROUND, constant_values=255), (0, 0), BLUR)
    T_board_camera = invert_transform(T_camera_board)
    rays = camera_rays() @ T_board_camera[:3, :3].T
    hits = T_board_camera[:3, 3] - T_board_camera[2, 3] / rays[:, 2:] * rays
    columns, rows = (hits[:, :2].T / LAYOUT.square * PIXELS + AROUND - 0.5).reshape(2, *SHAPE).astype(np.float32)
    seen = cv2.remap(paper, columns, rows, cv2.INTER_LINEAR, borderValue=140)
    seen = cv2.GaussianBlur(seen.astype(float), (0, 0), BLUR)
    return np.clip(0.8 * seen + 20.0 + rng.normal(0.0, NOISE, SHAPE), 0, 255).astype(np.uint8)


def views(count: int, rng: np.random.Generator) -> list[np.ndarray]:
    """T_board_camera of cameras that look at the board from its front, at different angles and turned differently."""
    width, height = Board(LAYOUT).size
    middle = np.array([width / 2, height / 2, 0.0])
    found = []
    for _ in range(count):
        polar, azimuth, away = rng.uniform(0.1, 0.6), rng.uniform(0.0, 2 * np.pi), rng.uniform(0.35, 0.5)
        # The front of the board looks along its -z.
        side = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), -np.cos(polar)])
        pose = look_at(middle + away * side, middle + rng.normal(0.0, 0.015, 3))
        found.append(pose @ make_transform(rotation_z(rng.uniform(-0.8, 0.8)), np.zeros(3)))
    return found


def on_the_arm(count: int = 12, seed: int = 0) -> Taken:
    """Pictures of a board that stands, by a camera on the arm."""
    rng = np.random.default_rng(seed)
    images, poses = {}, {}
    for number, T_board_camera in enumerate(views(count, rng)):
        images[f"{number:02d}.png"] = photograph(invert_transform(T_board_camera), rng)
        poses[f"{number:02d}.png"] = T_BASE_BOARD @ T_board_camera @ invert_transform(T_TOOL_CAMERA)
    return Taken(images, poses)


def beside_the_arm(count: int = 12, seed: int = 1) -> Taken:
    """Pictures of a board in the hand, by a camera that stands."""
    rng = np.random.default_rng(seed)
    images, poses = {}, {}
    for number, T_board_camera in enumerate(views(count, rng)):
        images[f"{number:02d}.png"] = photograph(invert_transform(T_board_camera), rng)
        poses[f"{number:02d}.png"] = T_BASE_CAMERA @ invert_transform(T_board_camera) @ invert_transform(T_TOOL_BOARD)
    return Taken(images, poses)
