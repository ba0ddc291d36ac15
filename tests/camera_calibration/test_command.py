"""`icgnet calibrate-camera`."""

import numpy as np
import pytest
import yaml
from PIL import Image

import needs_opencv  # noqa: F401
from icgnet.arm.hand_eye import HandEye
from icgnet.cli.main import main
from icgnet.errors import MissingExtraError
from rendered_boards import DISTORTION, T_BASE_CAMERA, T_TOOL_CAMERA, K


@pytest.fixture(autouse=True)
def plain_output(monkeypatch, tmp_path):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.chdir(tmp_path)


def write(folder, taken):
    """A folder of pictures, and poses beside it."""
    (folder / "pictures").mkdir()
    for name, image in taken.images.items():
        Image.fromarray(image).save(folder / "pictures" / name)
    entries = [{"image": name, "T_base_tool": pose.tolist()} for name, pose in taken.poses.items()]
    (folder / "poses.yaml").write_text(yaml.safe_dump(entries))
    (folder / "camera.yaml").write_text(yaml.safe_dump({"K": K.tolist(), "D": DISTORTION.tolist()}))


@pytest.fixture
def folder(tmp_path, on_arm):
    write(tmp_path, on_arm)
    return tmp_path


COMMAND = ["calibrate-camera", "pictures", "--poses", "poses.yaml"]


def test_a_camera_on_the_arm(folder, capsys):
    assert main([*COMMAND, "--intrinsics", "camera.yaml", "--out", "eye.yaml"]) == 0
    output = capsys.readouterr().out
    assert "12 of 12 pictures; the board's pose differs from their mean by" in output
    for number in range(12):
        assert f"{number:02d}.png" in output
    assert "written to eye.yaml" in output
    eye = HandEye.read(folder / "eye.yaml")
    np.testing.assert_allclose(eye.T_tool_camera, T_TOOL_CAMERA, atol=1e-3)
    assert eye.joints is None
    assert (folder / "eye.yaml").read_text().startswith("# T_tool_camera: x y z = ")


def test_numbers_say_the_same_as_a_file(folder, capsys):
    numbers = [str(value) for value in (K[0, 0], K[1, 1], K[0, 2], K[1, 2])]
    distortion = [str(value) for value in DISTORTION]
    assert main([*COMMAND, "--intrinsics", *numbers, "--distortion", *distortion, "--out", "numbers.json"]) == 0
    assert main([*COMMAND, "--intrinsics", "camera.yaml", "--out", "file.json"]) == 0
    assert (folder / "numbers.json").read_text() == (folder / "file.json").read_text()


def test_a_camera_beside_the_arm_and_a_lens_nobody_knows(tmp_path, beside_arm, capsys):
    write(tmp_path, beside_arm)
    assert main([*COMMAND, "--setup", "eye-to-hand", "--out", "eye.json"]) == 0
    assert "estimated from these pictures" in capsys.readouterr().out
    np.testing.assert_allclose(HandEye.read(tmp_path / "eye.json").T_base_camera, T_BASE_CAMERA, atol=1.5e-3)


def test_every_picture_is_told_of(folder, capsys, on_arm):
    Image.fromarray(np.full((720, 1280), 128, np.uint8)).save(folder / "pictures" / "00.png")
    Image.fromarray(on_arm.images["01.png"]).save(folder / "pictures" / "extra.png")
    assert main([*COMMAND, "--intrinsics", "camera.yaml"]) == 0
    output, errors = capsys.readouterr()
    assert "board not found" in output
    assert "11 of 12 pictures" in output
    assert "1 pictures without a pose were not used: extra.png" in errors
    assert "pictures in which the board was not found were not used" in errors
    assert (folder / "hand_eye.yaml").is_file()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["calibrate-camera"], "give IMAGES, a folder of pictures, and --poses; or --print-board FILE"),
        (["calibrate-camera", "nowhere", "--poses", "poses.yaml"], "no such folder: nowhere"),
        (["calibrate-camera", "pictures", "--poses", "none.csv"], "no such file with poses: none.csv"),
        ([*COMMAND, "--out", "eye.txt"], "a hand-eye file ends in .yaml, .yml, .json, got 'eye.txt'"),
        ([*COMMAND, "--distortion", "0", "0", "0", "0"], "--distortion needs --intrinsics"),
        ([*COMMAND, "--intrinsics", "camera.yaml", "--distortion", "0", "x"], "distortion must be numbers k1 k2 p1 p2"),
        ([*COMMAND, "--square", "30"], "square must be in metres"),
        (["calibrate-camera", "pictures", "--print-board", "a.png"], "prints and calibrates nothing"),
        (["calibrate-camera", "--print-board", "a.svg"], "written as .png or .pdf"),
    ],
)
def test_wrong_use_is_one_line_and_exit_code_2(folder, capsys, arguments, message):
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (folder / "hand_eye.yaml").exists()


def test_a_pose_of_a_missing_picture_is_refused(folder, capsys):
    (folder / "pictures" / "04.png").unlink()
    assert main(COMMAND) == 2
    assert "pictures holds no picture '04.png' (1 are missing)" in capsys.readouterr().err


def test_a_broken_picture_is_refused(folder, capsys):
    (folder / "pictures" / "04.png").write_bytes(b"none")
    assert main(COMMAND) == 2
    assert "cannot read pictures/04.png" in capsys.readouterr().err


def test_another_model_of_a_lens_is_refused(folder, capsys):
    (folder / "camera.yaml").write_text(
        yaml.safe_dump({"K": K.tolist(), "D": [0.1] * 4, "distortion_model": "equidistant"})
    )
    assert main([*COMMAND, "--intrinsics", "camera.yaml"]) == 2
    assert "distortion_model must be plumb_bob or rational_polynomial, got 'equidistant'" in capsys.readouterr().err


def test_sixteen_bits_are_read_as_eight(tmp_path, on_arm):
    from icgnet.camera_calibration.pictures import read_grey

    image = on_arm.images["00.png"]
    Image.fromarray(image.astype(np.uint16) * 4).save(tmp_path / "deep.png")
    np.testing.assert_allclose(read_grey(tmp_path / "deep.png"), 255.0 / image.max() * image, atol=1.0)


def test_poses_may_be_joints(folder, capsys, on_arm):
    try:
        from icgnet.arm.arm import Arm
        from icgnet.arm.kinematics import make_solver
    except MissingExtraError:
        pytest.skip("needs icgnet[arm]")
    arm = Arm.load("fr3")
    solver = make_solver(arm)
    entries = []
    for name, pose in on_arm.poses.items():
        solutions = solver.solutions(pose)
        if len(solutions):
            entries.append({"image": name, "joints": solutions[0].tolist()})
    assert len(entries) >= 6
    (folder / "poses.yaml").write_text(yaml.safe_dump(entries))
    assert main([*COMMAND, "--intrinsics", "camera.yaml", "--arm", "fr3"]) == 0
    np.testing.assert_allclose(HandEye.read(folder / "hand_eye.yaml").T_tool_camera, T_TOOL_CAMERA, atol=1e-3)


def test_the_board_is_printed(tmp_path, capsys):
    assert main(["calibrate-camera", "--print-board", "board.pdf", "--squares", "5", "7"]) == 0
    assert "board.pdf: A4 upright; print at 100 %" in capsys.readouterr().out
    assert (tmp_path / "board.pdf").read_bytes().startswith(b"%PDF")
