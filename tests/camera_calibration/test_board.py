"""The board is found where it is, and printed in its true size."""

import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

import needs_opencv  # noqa: F401
from icgnet.camera_calibration.board import Board
from icgnet.camera_calibration.settings import BoardLayout
from icgnet.errors import InputError

INCH_MM = 25.4


def test_corners_are_found_where_they_are():
    board = Board(BoardLayout())
    image = np.pad(board.image(60), 40, constant_values=255)
    count, found = board.find(image)
    assert count == 6 * 4
    # Pixel centres have integer coordinates: the corner of a square lies between two of them.
    np.testing.assert_allclose(found.in_image, found.on_board[:, :2] / 0.03 * 60 + 40 - 0.5, atol=0.1)


def test_a_picture_without_the_board_has_no_corners():
    assert Board(BoardLayout()).find(np.full((200, 300), 255, np.uint8)) == (0, None)


def test_corners_in_one_line_are_too_few():
    board = Board(BoardLayout(squares=(9, 3)))
    image = np.pad(board.image(60), 40, constant_values=255)
    count, found = board.find(image[: 40 + 2 * 60 - 2])  # one row of corners, the lower one is cut off
    assert count > 0
    assert found is None


@pytest.mark.parametrize(
    ("squares", "paper"), [((7, 5), "A4 across"), ((5, 7), "A4 upright"), ((11, 9), "350 x 308 mm")]
)
def test_the_print_has_its_true_size(tmp_path, squares, paper):
    board = Board(BoardLayout(squares=squares))
    assert board.print_to(tmp_path / "board.png") == paper
    with Image.open(tmp_path / "board.png") as page:
        per_mm = page.info["dpi"][0] / INCH_MM
        pixels = np.asarray(page.convert("L"))
    _, found = board.find(pixels)
    first, last = found.in_image[0], found.in_image[-1]
    wanted = 30.0 * np.array([squares[0] - 2, squares[1] - 2])
    np.testing.assert_allclose((last - first) / per_mm, wanted, atol=0.1)
    bar = pixels[-round(11 * per_mm)]  # a row through the bar, 1 mm above the margin
    assert (bar < 128).sum() / per_mm == pytest.approx(100.0, abs=0.2)


def test_the_pdf_is_as_large_as_the_paper(tmp_path):
    Board(BoardLayout()).print_to(tmp_path / "board.pdf")
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", (tmp_path / "board.pdf").read_bytes())
    np.testing.assert_allclose([float(each) / 72 * INCH_MM for each in box.groups()], (297.0, 210.0), atol=0.2)


def test_another_kind_of_file_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"written as .png or .pdf, got 'board.svg'"):
        Board(BoardLayout()).print_to(tmp_path / "board.svg")


def test_a_board_needs_markers_enough():
    layout = BoardLayout(squares=(12, 10))
    with pytest.raises(InputError, match="need 60 markers, DICT_4X4_50 has 50"):
        Board(layout)
    Board(replace(layout, dictionary="DICT_4X4_100"))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"squares": (2, 5)}, "squares must be from 3 to 40 each, got (2, 5)"),
        ({"square": 30.0}, "square must be in metres, from 0.005 to 0.3, got 30"),
        ({"marker": 0.03}, "marker must be above 0 and below square = 0.03 m, got 0.03"),
    ],
)
def test_wrong_layouts_are_refused(values, message):
    with pytest.raises(InputError) as error:
        BoardLayout(**values)
    assert message in str(error.value)
