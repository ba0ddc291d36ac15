"""From pictures of a board and poses of the arm to where the camera is: OpenCV's hand-eye calibration, and its checks.

All poses of one calibration obey T_base_tool X T_camera_board = Y. For a camera on the arm (eye-in-hand) X is
T_tool_camera and Y the board's pose in the base, which is the same in every picture. For a camera beside the arm the
same holds with T_tool_base in place of T_base_tool: X is T_base_camera, Y the board's pose in the hand.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from icgnet.camera_calibration.board import Board, FoundCorners
from icgnet.camera_calibration.libraries import cv2
from icgnet.camera_calibration.settings import Setup
from icgnet.errors import InputError
from icgnet.geometry.camera import check_intrinsics
from icgnet.geometry.transforms import invert_transform, make_transform

FEWEST_PICTURES = 6
"""Pictures with the board are at least so many: three determine the pose, the others tell whether it is right."""
LEAST_TURN_DEG = 5.0
"""The arm must have turned by this about a second axis [degrees], root mean square over all pairs of pictures."""
MOST_MM, MOST_DEG = 10.0, 2.0
"""A calibration whose median residuals are larger than these is wrong, not inaccurate."""
OUTLYING, OUTLYING_MM, OUTLYING_DEG = 3.0, 1.0, 0.2
"""A picture stands out if its residual is so many times the median, and above this [mm, degrees]."""
DISTORTIONS = (4, 5, 8, 12, 14)
"""So many distortion coefficients OpenCV knows."""

Pose = Float[np.ndarray, "4 4"]
Image = UInt8[np.ndarray, "h w"]


@dataclass(frozen=True, eq=False)
class Lens:
    """How a camera forms its picture.

    Attributes:
        intrinsics: camera matrix [pixels].
        distortion: k1 k2 p1 p2 [k3 ...] as OpenCV orders them.
    """

    intrinsics: Float[np.ndarray, "3 3"]
    distortion: Float[np.ndarray, "d"]


@dataclass(frozen=True)
class Residual:
    """How well one picture fits.

    Attributes:
        name: of the picture.
        corners: that were found of the board.
        pixels: of the corners, root mean square, the board's pose free [pixels]; None if the board was not found.
        millimetres: from the board's pose by this picture to the mean of all [mm]; None if it was not found.
        degrees: the same of its orientation [degrees].
        stands_out: whether that is much more than in the other pictures.
    """

    name: str
    corners: int
    pixels: float | None = None
    millimetres: float | None = None
    degrees: float | None = None
    stands_out: bool = False


@dataclass(frozen=True, eq=False)
class Calibration:
    """Where a camera is.

    Attributes:
        setup: whether it is on the arm or beside it.
        pose: T_tool_camera of a camera on the arm, T_base_camera of one beside it.
        T_fixed_board: mean pose of the board, in the base or in the link that carries the hand.
        error_mm: standard error of the position, by leaving out one picture after the other (jackknife) [mm].
        error_deg: the same of the orientation [degrees].
        lens: of the camera.
        lens_error: if the lens was estimated from these pictures, the error of the corners then [pixels].
        residuals: of every picture, in their order.
    """

    setup: Setup
    pose: Pose
    T_fixed_board: Pose
    error_mm: float
    error_deg: float
    lens: Lens
    lens_error: float | None
    residuals: tuple[Residual, ...]


def calibrate(
    images: Mapping[str, Image], poses: Mapping[str, Pose], board: Board, setup: Setup, lens: Lens | None = None
) -> Calibration:
    """Where the camera is.

    Args:
        images: grey pictures by their names, all of the same size.
        poses: T_base_tool at each of them: of the link that carries the hand.
        board: that is seen.
        setup: whether the camera is on the arm or beside it.
        lens: of the camera; estimated from the pictures if None.

    Raises:
        InputError: too few pictures, the board is not found in most of them, the arm did not turn enough, the camera
            matrix belongs to another picture, or poses and pictures do not fit each other.
    """
    if len(images) < FEWEST_PICTURES:
        raise InputError(f"a calibration needs at least {FEWEST_PICTURES} pictures with poses, got {len(images)}")
    shape = _common_shape(images)
    looked = {name: board.find(image) for name, image in images.items()}
    found = {name: corners for name, (_, corners) in looked.items() if corners is not None}
    if len(found) < max(FEWEST_PICTURES, (len(images) + 1) // 2):
        columns, rows = board.layout.squares
        raise InputError(
            f"the board was found in {len(found)} of {len(images)} pictures, needed are half of them and at least "
            f"{FEWEST_PICTURES}: is it {columns} x {rows} squares with markers of {board.layout.dictionary}, large and "
            "sharp enough?"
        )
    moved = np.stack([_moving(poses[name], setup) for name in found])
    _check_turns(moved, tuple(found))
    lens_error = None
    if lens is None:
        lens, lens_error = estimate_lens(list(found.values()), shape)
    _check_lens(lens, shape)
    seen = [_board_pose(corners, lens) for corners in found.values()]
    T_camera_board, pixels = np.stack([pose for pose, _ in seen]), [error for _, error in seen]
    pose = _solve(moved, T_camera_board)
    T_fixed_board, millimetres, degrees = _compare(moved @ pose @ T_camera_board)
    if np.median(millimetres) > MOST_MM or np.median(degrees) > MOST_DEG:
        raise InputError(_unfit(moved, T_camera_board, setup, float(np.median(millimetres)), float(np.median(degrees))))
    out = (millimetres > max(OUTLYING_MM, OUTLYING * float(np.median(millimetres)))) | (
        degrees > max(OUTLYING_DEG, OUTLYING * float(np.median(degrees)))
    )
    of_found = {
        name: Residual(name, looked[name][0], pixels[row], float(millimetres[row]), float(degrees[row]), bool(out[row]))
        for row, name in enumerate(found)
    }
    error_mm, error_deg = _jackknife(moved, T_camera_board)
    return Calibration(
        setup=setup,
        pose=pose,
        T_fixed_board=T_fixed_board,
        error_mm=error_mm,
        error_deg=error_deg,
        lens=lens,
        lens_error=lens_error,
        residuals=tuple(of_found.get(name, Residual(name, looked[name][0])) for name in images),
    )


def make_lens(intrinsics: Any, distortion: Any = ()) -> Lens:
    """A lens of plain values; without distortion coefficients it draws straight.

    Raises:
        InputError: not a camera matrix, or numbers that OpenCV takes for no distortion.
    """
    try:
        numbers = np.array(distortion, float).reshape(-1)
    except (TypeError, ValueError) as error:
        raise InputError(f"distortion must be numbers, got {distortion!r:.60}") from error
    if len(numbers) and (len(numbers) not in DISTORTIONS or not np.isfinite(numbers).all()):
        counts = ", ".join(map(str, DISTORTIONS))
        raise InputError(f"distortion must be {counts} finite numbers k1 k2 p1 p2 ..., got {numbers.tolist()}")
    return Lens(check_intrinsics(intrinsics), numbers if len(numbers) else np.zeros(5))


def estimate_lens(found: list[FoundCorners], shape: tuple[int, int]) -> tuple[Lens, float]:
    """Camera matrix and distortion from pictures of the board, and the error that is left [pixels]."""
    on_board = [corners.on_board.astype(np.float32) for corners in found]
    in_image = [corners.in_image.astype(np.float32) for corners in found]
    error, matrix, distortion, _, _ = cv2.calibrateCamera(on_board, in_image, shape[::-1], None, None)  # pyright: ignore
    return Lens(np.asarray(matrix, float), np.asarray(distortion, float).reshape(-1)), float(error)


def _common_shape(images: Mapping[str, Image]) -> tuple[int, int]:
    first, shape = next((name, image.shape) for name, image in images.items())
    for name, image in images.items():
        if image.shape != shape:
            sizes = [f"{width} x {height}" for height, width in (image.shape, shape)]
            raise InputError(f"all pictures must have one size: {name} has {sizes[0]}, {first} {sizes[1]}")
    return shape


def _moving(T_base_tool: Pose, setup: Setup) -> Pose:
    """The pose that multiplies the unknown one from the left."""
    return T_base_tool if setup == "eye-in-hand" else invert_transform(T_base_tool)


def _check_turns(moved: Float[np.ndarray, "n 4 4"], names: tuple[str, ...]) -> None:
    """Makes sure that the arm turned about two axes: else the position along one is not determined.

    Raises:
        InputError: it did not.
    """
    first, second = np.triu_indices(len(moved), 1)
    turns = Rotation.from_matrix(np.swapaxes(moved[first, :3, :3], 1, 2) @ moved[second, :3, :3]).as_rotvec(
        degrees=True
    )
    about = np.sqrt(np.maximum(np.linalg.eigvalsh(turns.T @ turns / len(turns)), 0.0))[::-1]
    if about[1] < LEAST_TURN_DEG:
        raise InputError(
            f"the arm must turn about two axes by {LEAST_TURN_DEG:g} degrees and more: over the {len(names)} pictures "
            f"with the board it turned by {about[0]:.1f} about one and {about[1]:.1f} about a second (root mean square)"
        )


def _check_lens(lens: Lens, shape: tuple[int, int]) -> None:
    height, width = shape
    cx, cy = lens.intrinsics[:2, 2]
    if not (0 < cx < width and 0 < cy < height):
        raise InputError(
            f"the camera matrix has its centre at ({cx:.1f}, {cy:.1f}), outside of the {width} x {height} pictures: "
            "it belongs to another size, or the lens cannot be estimated from these pictures"
        )


def _board_pose(corners: FoundCorners, lens: Lens) -> tuple[Pose, float]:
    """T_camera_board of one picture, and the error of its corners [pixels]."""
    given = (corners.on_board, corners.in_image, lens.intrinsics, lens.distortion)
    # A plane seen from afar has two poses that fit nearly as well; this method tells both, the better one first.
    _, turns, places, _ = cv2.solvePnPGeneric(*given, flags=cv2.SOLVEPNP_IPPE)
    turn, place = cv2.solvePnPRefineLM(*given, turns[0], places[0])
    drawn, _ = cv2.projectPoints(corners.on_board, turn, place, lens.intrinsics, lens.distortion)
    error = np.sqrt(((drawn.reshape(-1, 2) - corners.in_image) ** 2).sum(axis=1).mean())
    return make_transform(np.asarray(cv2.Rodrigues(turn)[0]), np.asarray(place).reshape(3)), float(error)


def _solve(moved: Float[np.ndarray, "n 4 4"], T_camera_board: Float[np.ndarray, "n 4 4"]) -> Pose:
    """The unknown pose X.

    Paper: none; Park and Martin (1994), by OpenCV. Moving all corners together onto the pictures afterwards was tried:
    it is no better where the arm's own poses err, and worse in the orientation.
    """
    turn, place = cv2.calibrateHandEye(
        list(moved[:, :3, :3]),
        list(moved[:, :3, 3]),
        list(T_camera_board[:, :3, :3]),
        list(T_camera_board[:, :3, 3]),
        method=cv2.CALIB_HAND_EYE_PARK,
    )
    # Poses that fit nothing give a matrix that is no rotation; the nearest one shows it in the residuals.
    left, _, right = np.linalg.svd(np.nan_to_num(np.asarray(turn, float)))
    rotation = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
    return make_transform(rotation, np.nan_to_num(np.asarray(place, float)).reshape(3))


def _compare(
    poses: Float[np.ndarray, "n 4 4"],
) -> tuple[Pose, Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """The mean of poses, and how far each is from it [mm, degrees]."""
    turns = Rotation.from_matrix(poses[:, :3, :3])
    mean = make_transform(turns.mean().as_matrix(), poses[:, :3, 3].mean(axis=0))
    away = np.linalg.norm(poses[:, :3, 3] - mean[:3, 3], axis=1)
    return mean, 1e3 * away, np.rad2deg((turns.mean().inv() * turns).magnitude())


def _jackknife(moved: Float[np.ndarray, "n 4 4"], T_camera_board: Float[np.ndarray, "n 4 4"]) -> tuple[float, float]:
    """Standard error of the unknown pose [mm, degrees], by leaving out one picture after the other."""
    count = len(moved)
    kept = [np.delete(np.arange(count), index) for index in range(count)]
    _, millimetres, degrees = _compare(np.stack([_solve(moved[rows], T_camera_board[rows]) for rows in kept]))
    scale = np.sqrt((count - 1) / count)
    return float(scale * np.linalg.norm(millimetres)), float(scale * np.linalg.norm(degrees))


def _unfit(
    moved: Float[np.ndarray, "n 4 4"],
    T_camera_board: Float[np.ndarray, "n 4 4"],
    setup: Setup,
    millimetres: float,
    degrees: float,
) -> str:
    """Why no camera pose explains the pictures, as far as can be told."""
    turned = invert_transform(moved)
    _, other_mm, other_deg = _compare(turned @ _solve(turned, T_camera_board) @ T_camera_board)
    if np.median(other_mm) < MOST_MM and np.median(other_deg) < MOST_DEG:
        other = "eye-to-hand" if setup == "eye-in-hand" else "eye-in-hand"
        cause = f"they would fit with --setup {other}, or if they are T_tool_base and not T_base_tool"
    else:
        cause = "are they of the right pictures, in metres, and their quaternions in the right order?"
    return (
        f"poses and pictures do not fit each other: the board's pose differs by {millimetres:.1f} mm and "
        f"{degrees:.1f} degrees from picture to picture (median); {cause}"
    )
