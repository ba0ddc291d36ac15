"""Cameras are found where they are, and what cannot be calibrated is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import needs_opencv  # noqa: F401
from icgnet.camera_calibration.board import Board
from icgnet.camera_calibration.calibrate import calibrate, make_lens
from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform, make_transform
from rendered_boards import (
    DISTORTION,
    LAYOUT,
    T_BASE_BOARD,
    T_BASE_CAMERA,
    T_TOOL_BOARD,
    T_TOOL_CAMERA,
    K,
    Taken,
    on_the_arm,
    turned,
)

BOARD, LENS = Board(LAYOUT), make_lens(K, DISTORTION)


def apart(found: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    """Distance of two poses [mm, degrees]."""
    turn = Rotation.from_matrix(true[:3, :3].T @ found[:3, :3]).magnitude()
    return 1e3 * float(np.linalg.norm(found[:3, 3] - true[:3, 3])), float(np.rad2deg(turn))


def assert_near(found: np.ndarray, true: np.ndarray, most_mm: float, most_deg: float) -> None:
    millimetres, degrees = apart(found, true)
    assert millimetres < most_mm
    assert degrees < most_deg


def test_a_camera_on_the_arm(on_arm):
    found = calibrate(on_arm.images, on_arm.poses, BOARD, "eye-in-hand", LENS)
    assert_near(found.pose, T_TOOL_CAMERA, 0.5, 0.05)
    assert_near(found.T_fixed_board, T_BASE_BOARD, 0.5, 0.05)
    assert [each.name for each in found.residuals] == list(on_arm.images)
    assert all(each.pixels < 0.2 and each.millimetres < 1.0 and each.degrees < 0.1 for each in found.residuals)
    assert not any(each.stands_out for each in found.residuals)
    assert found.lens_error is None
    assert 0.0 < found.error_mm < 0.5


def test_a_camera_beside_the_arm(beside_arm):
    found = calibrate(beside_arm.images, beside_arm.poses, BOARD, "eye-to-hand", LENS)
    assert_near(found.pose, T_BASE_CAMERA, 0.8, 0.08)
    assert_near(found.T_fixed_board, T_TOOL_BOARD, 0.8, 0.08)


@pytest.mark.parametrize(("setup", "true"), [("eye-in-hand", T_TOOL_CAMERA), ("eye-to-hand", T_BASE_CAMERA)])
def test_the_lens_is_estimated_from_the_pictures(on_arm, beside_arm, setup, true):
    taken = on_arm if setup == "eye-in-hand" else beside_arm
    found = calibrate(taken.images, taken.poses, BOARD, setup)
    assert_near(found.pose, true, 1.0, 0.1)
    assert 0.0 < found.lens_error < 0.2
    np.testing.assert_allclose(found.lens.intrinsics, K, atol=2.5)


def test_the_standard_error_tells_of_an_arm_that_errs(on_arm):
    rng = np.random.default_rng(3)
    poses = {
        name: pose
        @ make_transform(Rotation.from_rotvec(rng.normal(0.0, 0.002, 3)).as_matrix(), rng.normal(0.0, 1e-3, 3))
        for name, pose in on_arm.poses.items()
    }
    exact = calibrate(on_arm.images, on_arm.poses, BOARD, "eye-in-hand", LENS)
    found = calibrate(on_arm.images, poses, BOARD, "eye-in-hand", LENS)
    millimetres, degrees = apart(found.pose, T_TOOL_CAMERA)
    assert found.error_mm > 5 * exact.error_mm
    assert millimetres < 3 * found.error_mm
    assert degrees < 3 * found.error_deg


def test_pictures_without_the_board_are_told_and_not_used(on_arm):
    images = dict(on_arm.images) | {"03.png": np.full((720, 1280), 128, np.uint8)}
    found = calibrate(images, on_arm.poses, BOARD, "eye-in-hand", LENS)
    missed = [each for each in found.residuals if each.pixels is None]
    assert [(each.name, each.corners, each.millimetres) for each in missed] == [("03.png", 0, None)]
    assert len(found.residuals) == 12
    assert_near(found.pose, T_TOOL_CAMERA, 0.5, 0.05)


def test_a_wrong_pose_stands_out_and_is_used_all_the_same(on_arm):
    wrong = on_arm.poses["05.png"] @ turned(0.0, 0.0, 2.0, (0.01, 0.0, 0.0))
    found = calibrate(on_arm.images, on_arm.poses | {"05.png": wrong}, BOARD, "eye-in-hand", LENS)
    assert [each.name for each in found.residuals if each.stands_out] == ["05.png"]
    assert next(each for each in found.residuals if each.name == "05.png").millimetres > 5.0


def first(taken: Taken, count: int) -> Taken:
    names = list(taken.images)[:count]
    return Taken({name: taken.images[name] for name in names}, {name: taken.poses[name] for name in names})


def refusal(taken: Taken, setup: str = "eye-in-hand", board: Board = BOARD, lens: object = LENS) -> str:
    with pytest.raises(InputError) as error:
        calibrate(taken.images, taken.poses, board, setup, lens)
    assert "\n" not in str(error.value)
    return str(error.value)


def test_too_few_pictures_are_refused(on_arm):
    assert "at least 6 pictures with poses, got 5" in refusal(first(on_arm, 5))


def test_another_board_is_refused(on_arm):
    board = Board(replace(LAYOUT, dictionary="DICT_5X5_50"))
    assert "the board was found in 0 of 12 pictures" in refusal(on_arm, board=board)


def test_a_board_in_few_of_the_pictures_is_refused(on_arm):
    empty = {name: np.full((720, 1280), 128, np.uint8) for name in list(on_arm.images)[:7]}
    assert "the board was found in 5 of 12 pictures" in refusal(Taken(on_arm.images | empty, on_arm.poses))


def test_an_arm_that_only_moves_is_refused(on_arm):
    name = next(iter(on_arm.images))
    names = [f"{number}.png" for number in range(8)]
    rng = np.random.default_rng(0)
    poses = {each: make_transform(on_arm.poses[name][:3, :3], rng.normal(0.5, 0.05, 3)) for each in names}
    told = refusal(Taken(dict.fromkeys(names, on_arm.images[name]), poses))
    assert "the arm must turn about two axes by 5 degrees and more" in told


def test_an_arm_that_turns_about_one_axis_is_refused(on_arm):
    name = next(iter(on_arm.images))
    names = [f"{number}.png" for number in range(8)]
    poses = {each: turned(0.0, 0.0, 20.0 * number, (0.5, 0.0, 0.5)) for number, each in enumerate(names)}
    told = refusal(Taken(dict.fromkeys(names, on_arm.images[name]), poses))
    assert "about one and 0.0 about a second" in told


def test_the_other_setup_is_recognised(on_arm, beside_arm):
    assert "they would fit with --setup eye-to-hand" in refusal(beside_arm)
    assert "they would fit with --setup eye-in-hand" in refusal(on_arm, "eye-to-hand")
    turned_round = Taken(on_arm.images, {name: invert_transform(pose) for name, pose in on_arm.poses.items()})
    assert "or if they are T_tool_base and not T_base_tool" in refusal(turned_round)


def test_poses_of_other_pictures_are_refused(on_arm):
    names = list(on_arm.images)
    shifted = {name: on_arm.poses[names[index - 1]] for index, name in enumerate(names)}
    assert "poses and pictures do not fit each other" in refusal(Taken(on_arm.images, shifted))


def test_pictures_of_two_sizes_are_refused(on_arm):
    images = on_arm.images | {"11.png": on_arm.images["11.png"][:400]}
    assert "all pictures must have one size: 11.png has 1280 x 400, 00.png 1280 x 720" in refusal(
        Taken(images, on_arm.poses)
    )


def test_the_camera_matrix_of_another_size_is_refused(on_arm):
    lens = make_lens(np.array([[1840.0, 0.0, 1286.8], [0.0, 1836.0, 714.2], [0.0, 0.0, 1.0]]))
    assert "outside of the 1280 x 720 pictures" in refusal(on_arm, lens=lens)


@pytest.mark.parametrize("distortion", [(0.1, 0.2, 0.3), (0.1, float("nan"), 0.0, 0.0)])
def test_wrong_distortion_is_refused(distortion):
    with pytest.raises(InputError, match="distortion must be 4, 5, 8, 12, 14 finite numbers"):
        make_lens(K, distortion)


def test_a_straight_lens_needs_no_distortion():
    assert make_lens(K).distortion.tolist() == [0.0] * 5


def test_different_pictures_give_the_same_camera():
    other = on_the_arm(10, seed=7)
    assert_near(calibrate(other.images, other.poses, BOARD, "eye-in-hand", LENS).pose, T_TOOL_CAMERA, 0.5, 0.05)
