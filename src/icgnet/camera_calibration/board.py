"""The ChArUco board: found in pictures, and drawn to be printed in its true size."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image, ImageDraw, ImageFont
from scipy.spatial.distance import pdist

from icgnet.camera_calibration.libraries import cv2
from icgnet.camera_calibration.settings import BoardLayout
from icgnet.errors import InputError
from icgnet.files import new_file

INCH = 0.0254
FINEST = 300.0
"""About so many pixels an inch are drawn; a square is a whole number of pixels."""
A4 = (0.210, 0.297)
MARGIN, FOOTER = 0.010, 0.018
"""Of the page, and height of the line with the bar [m]."""
BAR = 0.1
"""Length of the bar that tells whether the print has its true size [m]."""
FEWEST_CORNERS = 6
"""A picture counts from so many corners on, not all in one line."""
FINEST_STEP = 0.005
"""The search for a corner ends once it moves by less than this [pixels]."""
LARGEST_WINDOW = 10
"""It looks at so many pixels to each side, at most."""
FORMATS = (".png", ".pdf")


@dataclass(frozen=True, eq=False)
class FoundCorners:
    """Corners of the squares in one picture.

    Attributes:
        on_board: where they are on the board, z = 0 [m].
        in_image: and in the picture, columns and rows [pixels].
    """

    on_board: Float[np.ndarray, "n 3"]
    in_image: Float[np.ndarray, "n 2"]


class Board:
    """A board of a layout.

    Args:
        layout: sizes and markers.

    Raises:
        InputError: more markers than the dictionary has.
    """

    def __init__(self, layout: BoardLayout) -> None:
        self.layout = layout
        columns, rows = layout.squares
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, layout.dictionary))
        needed, there = columns * rows // 2, len(dictionary.bytesList)
        if needed > there:
            raise InputError(f"{columns} x {rows} squares need {needed} markers, {layout.dictionary} has {there}")
        self._board = cv2.aruco.CharucoBoard((columns, rows), layout.square, layout.marker, dictionary)
        self._board.setLegacyPattern(layout.legacy_pattern)
        self._detector = cv2.aruco.CharucoDetector(self._board)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        columns, rows = self.layout.squares
        return columns * self.layout.square, rows * self.layout.square

    def find(self, image: UInt8[np.ndarray, "h w"]) -> tuple[int, FoundCorners | None]:
        """How many corners are found in a picture, and which; None if they are too few or in one line."""
        corners, ids, _, _ = self._detector.detectBoard(image)
        if ids is None:
            return 0, None
        if len(ids) < FEWEST_CORNERS or self._board.checkCharucoCornersCollinear(ids):
            return len(ids), None
        matched = self._board.matchImagePoints(corners, ids)  # pyright: ignore
        on_board, in_image = (np.asarray(each, np.float64).reshape(len(ids), -1) for each in matched)
        return len(ids), FoundCorners(on_board, self._refined(image, on_board, in_image))

    def _refined(
        self, image: UInt8[np.ndarray, "h w"], on_board: Float[np.ndarray, "n 3"], in_image: Float[np.ndarray, "n 2"]
    ) -> Float[np.ndarray, "n 2"]:
        """Corners of the squares to a fraction of a pixel.

        The detector's own search looks at a window in which corners of markers may lie, which draw it away by 0.2
        pixels, and it stops at steps of 0.1; this one looks no farther than to the nearest marker.
        """
        scale = float((pdist(in_image) / pdist(on_board)).min())
        window = min(int((self.layout.square - self.layout.marker) / 2 * scale) - 1, LARGEST_WINDOW)
        if window < 2:
            return in_image
        until = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, FINEST_STEP)
        corners = np.ascontiguousarray(in_image[:, None], np.float32)
        return np.asarray(cv2.cornerSubPix(image, corners, (window, window), (-1, -1), until), np.float64)[:, 0]

    def image(self, pixels: int) -> UInt8[np.ndarray, "h w"]:
        """The board without a margin, each square so many pixels wide."""
        columns, rows = self.layout.squares
        return np.asarray(self._board.generateImage((columns * pixels, rows * pixels), marginSize=0))

    def page(self) -> tuple[Image.Image, float, str]:
        """A page to print: the board, its measures, and a bar to check them by.

        Returns:
            The page in black and white, its pixels an inch, and what it is called: A4, or its size.
        """
        pixels = round(self.layout.square * FINEST / INCH)
        per_metre = pixels / self.layout.square
        width, height = self.size
        needed = (width + 2 * MARGIN, height + 2 * MARGIN + FOOTER)
        names = {A4: "A4 upright", A4[::-1]: "A4 across"}
        fits = (sheet for sheet in names if needed[0] <= sheet[0] and needed[1] <= sheet[1])
        paper = next(fits, (max(needed[0], BAR + 2 * MARGIN), needed[1]))
        page = Image.new("L", (round(paper[0] * per_metre), round(paper[1] * per_metre)), 255)
        left, top = round((paper[0] - width) / 2 * per_metre), round((paper[1] - FOOTER - height) / 2 * per_metre)
        page.paste(Image.fromarray(self.image(pixels)), (left, top))
        self._draw_footer(page, per_metre)
        name = names.get(paper, f"{1e3 * paper[0]:.0f} x {1e3 * paper[1]:.0f} mm")
        return page.convert("1", dither=Image.Dither.NONE), per_metre * INCH, name

    def _draw_footer(self, page: Image.Image, per_metre: float) -> None:
        draw, margin = ImageDraw.Draw(page), round(MARGIN * per_metre)
        bottom = page.height - margin
        draw.rectangle((margin, bottom - margin // 4, margin + round(BAR * per_metre) - 1, bottom), fill=0)
        columns, rows = self.layout.squares
        text = (
            f"{columns} x {rows} squares of {1e3 * self.layout.square:g} mm, markers {1e3 * self.layout.marker:g} mm, "
            f"{self.layout.dictionary}; print at 100 %: the bar is {1e3 * BAR:g} mm long"
        )
        room, size = page.width - 2 * margin, 0.0035 * per_metre
        font = ImageFont.load_default(size)
        size *= min(1.0, room / draw.textlength(text, font=font))
        draw.text((margin, bottom - margin // 2), text, fill=0, font=ImageFont.load_default(size), anchor="ls")

    def print_to(self, path: Path) -> str:
        """Writes the page as PNG or PDF, in its true size, and says which paper it is for.

        Raises:
            InputError: a file of another kind.
            DataError: the system cannot write.
        """
        kind = path.suffix.lower()
        if kind not in FORMATS:
            raise InputError(f"the board is written as {' or '.join(FORMATS)}, got {path.name!r}")
        page, resolution, paper = self.page()
        path.parent.mkdir(parents=True, exist_ok=True)
        with new_file(path) as file:
            if kind == ".pdf":
                page.save(file, "PDF", resolution=resolution)
            else:
                page.save(file, "PNG", dpi=(resolution, resolution))
        return paper
