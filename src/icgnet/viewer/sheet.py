"""Depth and id images in colour, and many pictures on one sheet."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

from icgnet.errors import InputError
from icgnet.viewer.annotate import shorten, write
from icgnet.viewer.palette import instance_colours, score_colours

GAP = 12
CAPTION_SIZE = 17
NOTHING = (235, 236, 238)
"""Colour of pixels where nothing was measured or seen."""
TABLE = (206, 209, 214)
SMALLEST, LARGEST = 16, 4000
"""Height and width of a picture on a sheet [pixels]."""


def check_panel(panel: tuple[int, int]) -> None:
    """Makes sure that pictures of this height and width can be drawn [pixels].

    Raises:
        InputError: too small or too large.
    """
    if min(panel) < SMALLEST or max(panel) > LARGEST:
        raise InputError(
            f"panel must be between {SMALLEST} and {LARGEST} pixels high and wide, got {panel[0]} x {panel[1]}"
        )


def colour_depth(depth: Float[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """A depth image [m] in colour: near is yellow, far violet, not measured (0 or not finite) light grey."""
    measured = np.isfinite(depth) & (depth > 0)
    image = np.full((*depth.shape, 3), NOTHING, np.uint8)
    if measured.any():
        near, far = np.percentile(depth[measured], [1, 99])
        nearness = (far - depth[measured]) / max(far - near, 1e-6)
        image[measured] = np.round(255 * score_colours(nearness))
    return image


def colour_ids(ids: Int[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w 3"]:
    """An id image in the colours of the instances; -1 (nothing) is light grey, -2 (table) darker grey."""
    image = np.round(255 * instance_colours(ids.ravel())).astype(np.uint8).reshape(*ids.shape, 3)
    image[ids == -1] = NOTHING
    image[ids == -2] = TABLE
    return image


def draw_sheet(
    images: Sequence[UInt8[np.ndarray, "_ _ 3"] | Image.Image],
    captions: Sequence[str],
    path: str | Path,
    columns: int | None = None,
) -> None:
    """Writes a PNG with all images in rows, each with its caption below.

    Args:
        images: RGB; smaller ones are centred in their cell.
        captions: one for each image; what is too long for its cell is shortened.
        path: file to write.
        columns: images in a row; about as many as rows if None.

    Raises:
        InputError: no images, or another number of captions.
    """
    if not images or len(images) != len(captions):
        raise InputError(
            f"a sheet needs one caption for each image, got {len(images)} images, {len(captions)} captions"
        )
    pictures = [image if isinstance(image, Image.Image) else Image.fromarray(image) for image in images]
    across = columns or int(np.ceil(np.sqrt(len(pictures))))
    cell_width = max(picture.width for picture in pictures) + GAP
    cell_height = max(picture.height for picture in pictures) + GAP + CAPTION_SIZE + 10
    down = -(-len(pictures) // across)
    sheet = Image.new("RGB", (across * cell_width + GAP, down * cell_height + GAP), "white")
    for index, (picture, caption) in enumerate(zip(pictures, captions, strict=True)):
        left, top = GAP + index % across * cell_width, GAP + index // across * cell_height
        inset = (cell_width - GAP - picture.width) // 2, (cell_height - GAP - CAPTION_SIZE - 10 - picture.height) // 2
        sheet.paste(picture.convert("RGB"), (left + inset[0], top + inset[1]))
        line = shorten(caption, CAPTION_SIZE, cell_width - GAP)
        write(sheet, line, (left, top + cell_height - GAP - CAPTION_SIZE - 6), CAPTION_SIZE)
    sheet.save(path)
