"""What the command line says of the board and of where the camera is; needs no OpenCV."""

from dataclasses import dataclass
from typing import Literal

from icgnet.errors import InputError
from icgnet.settings import check_choices

Setup = Literal["eye-in-hand", "eye-to-hand"]
"""A camera on the arm that sees a board which stands, or a camera beside the arm that sees a board in its hand."""
Dictionary = Literal[
    "DICT_4X4_50",
    "DICT_4X4_100",
    "DICT_4X4_250",
    "DICT_4X4_1000",
    "DICT_5X5_50",
    "DICT_5X5_100",
    "DICT_5X5_250",
    "DICT_5X5_1000",
    "DICT_6X6_50",
    "DICT_6X6_100",
    "DICT_6X6_250",
    "DICT_6X6_1000",
    "DICT_7X7_50",
    "DICT_7X7_100",
    "DICT_7X7_250",
    "DICT_7X7_1000",
    "DICT_ARUCO_ORIGINAL",
    "DICT_ARUCO_MIP_36h12",
    "DICT_APRILTAG_36h11",
]
"""Names that OpenCV gives to sets of markers."""
FEWEST_SQUARES, MOST_SQUARES = 3, 40
SMALLEST_SQUARE, LARGEST_SQUARE = 0.005, 0.3
"""Edges of the squares of a board [m]; others are a mistake in the unit."""


@dataclass(frozen=True)
class BoardLayout:
    """A ChArUco board: a chessboard with a marker in each white square."""

    squares: tuple[int, int] = (7, 5)
    """Squares of the board from left to right and from top to bottom."""
    square: float = 0.03
    """Edge of a square, measured on the print [m]."""
    marker: float = 0.022
    """Edge of a marker, its black border included [m]."""
    dictionary: Dictionary = "DICT_4X4_50"
    """Set of markers, by the name that OpenCV gives it."""
    legacy_pattern: bool = False
    """The board was made by OpenCV before 4.6: with an even number of rows its first square is white."""

    def __post_init__(self) -> None:
        check_choices(self)
        if not all(FEWEST_SQUARES <= count <= MOST_SQUARES for count in self.squares):
            raise InputError(f"squares must be from {FEWEST_SQUARES} to {MOST_SQUARES} each, got {self.squares}")
        if not SMALLEST_SQUARE <= self.square <= LARGEST_SQUARE:
            raise InputError(
                f"square must be in metres, from {SMALLEST_SQUARE:g} to {LARGEST_SQUARE:g}, got {self.square:g}"
            )
        if not 0.0 < self.marker < self.square:
            raise InputError(f"marker must be above 0 and below square = {self.square:g} m, got {self.marker:g}")
