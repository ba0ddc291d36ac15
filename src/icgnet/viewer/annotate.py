"""Words on pictures: labels with leaders, a score scale, titles. Text never leaves the picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from icgnet.viewer.palette import INK, MARK, QUIET_INK, score_colours, to_bytes

LABEL_SIZE = 19
LABEL_LIFT = 34
"""How far [pixels] a label floats above what it names."""
EDGE = 8
"""Free border [pixels] around text."""
MARK_RADIUS = 4
"""Of the dots that mark points [pixels]."""

Colour = tuple[float, float, float]
Length = int | float
"""Of a distance or coordinate in a picture [pixels]."""
Pixel = tuple[Length, Length]
Rectangle = tuple[Length, Length, Length, Length]


@dataclass(frozen=True)
class Label:
    """A name at a pixel of the picture, with the colour of the thing it names."""

    text: str
    pixel: Pixel
    colour: Colour


def write(image: Image.Image, text: str, corner: Pixel, size: int, colour: Colour = INK, bold: bool = False) -> None:
    """Writes one line with its upper left corner at a pixel, shortened to what fits into the picture."""
    pen = ImageDraw.Draw(image)
    font = _font(size)
    line = shorten(text, size, image.width - corner[0] - EDGE)
    pen.text(corner, line, fill=to_bytes(colour), font=font, stroke_width=0.4 if bold else 0)


def text_width(text: str, size: int) -> float:
    """Width [pixels] of one line."""
    return _font(size).getlength(text)


def shorten(text: str, size: int, width: Length) -> str:
    """The text on one line, with an ellipsis where it is too long for `width` [pixels]."""
    line = text.replace("\n", " ")
    if text_width(line, size) <= width:
        return line
    while line and text_width(line + "...", size) > width:
        line = line[:-1]
    return line.rstrip() + "..." if line else ""


def write_labels(image: Image.Image, labels: list[Label]) -> None:
    """Writes labels above what they name, moved apart where they would cover each other; never outside.

    The nearer to the upper border a thing is, the earlier it gets its place, so that labels stack upwards.
    """
    pen = ImageDraw.Draw(image, "RGBA")
    taken: list[Rectangle] = []
    for label in sorted(labels, key=lambda label: label.pixel[1]):
        text = shorten(label.text, LABEL_SIZE, image.width / 2)
        box = _free_place(image, text, label.pixel, taken)
        taken.append(box)
        _draw_label(pen, label, text, box)


def draw_score_scale(image: Image.Image, right: Length, middle: Length, caption: str, width: int = 180) -> None:
    """A caption and a bar from 0 to 1 in the colours of the hands, with its right end at a pixel."""
    pen = ImageDraw.Draw(image)
    height, size = 12, 18
    bar_right = round(right - text_width("1", size) - 10)
    bar_left = bar_right - width
    colours = score_colours(np.linspace(0, 1, width))
    bar = np.repeat((255 * colours[None]).astype(np.uint8), height, axis=0)
    image.paste(Image.fromarray(bar), (bar_left, round(middle - height / 2)))
    ink = to_bytes(QUIET_INK)
    pen.text((right, middle), "1", fill=ink, font=_font(size), anchor="rm")
    pen.text((bar_left - 10, middle), f"{caption}   0", fill=ink, font=_font(size), anchor="rm")


def mark_pixels(image: Image.Image, pixels: Float[np.ndarray, "k 2"]) -> None:
    """Draws a red dot at each pixel (u, v)."""
    pen = ImageDraw.Draw(image)
    for u, v in pixels:
        box = [u - MARK_RADIUS, v - MARK_RADIUS, u + MARK_RADIUS, v + MARK_RADIUS]
        pen.ellipse(box, fill=to_bytes(MARK), outline="white")


def write_legend(image: Image.Image, entries: Sequence[tuple[str, Colour]], corner: Pixel, size: int) -> None:
    """Writes what colours stand for in one line, each after a square of its colour, from an upper left corner on."""
    pen = ImageDraw.Draw(image)
    left, top = corner
    for text, colour in entries:
        pen.rounded_rectangle([left, top + 2, left + size, top + size + 2], radius=4, fill=to_bytes(colour))
        write(image, text, (left + size + 8, top), size, QUIET_INK)
        left += size + 8 + text_width(text, size) + 26


def _font(size: int) -> ImageFont.FreeTypeFont:
    font = ImageFont.load_default(size=size)
    assert isinstance(font, ImageFont.FreeTypeFont), "Pillow is built without FreeType"
    return font


def _free_place(image: Image.Image, text: str, pixel: Pixel, taken: list[Rectangle]) -> Rectangle:
    width, height = text_width(text, LABEL_SIZE) + 20, LABEL_SIZE + 11
    left = float(np.clip(pixel[0] - width / 2, EDGE, max(EDGE, image.width - width - EDGE)))
    top = pixel[1] - LABEL_LIFT - height
    # Upwards first; when there is no room left at the top, downwards from the thing itself.
    for step in (-(height + 4) / 4, (height + 4) / 4):
        place = top if step < 0 else pixel[1] + 10
        while EDGE <= place <= image.height - height - EDGE:
            box = (left, place, left + width, place + height)
            if not any(_overlap(box, other) for other in taken):
                return box
            place += step
    place = float(np.clip(top, EDGE, max(EDGE, image.height - height - EDGE)))
    return left, place, left + width, place + height


def _overlap(one: Rectangle, other: Rectangle) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _draw_label(pen: ImageDraw.ImageDraw, label: Label, text: str, box: Rectangle) -> None:
    left, top, right, bottom = box
    x, y = label.pixel
    ink, colour = to_bytes(INK), to_bytes(label.colour)
    end = bottom if y > bottom else top
    pen.line([(x, y), (np.clip(x, left + 8, right - 8), end)], fill=(*ink, 150), width=2)
    pen.ellipse([x - 4, y - 4, x + 4, y + 4], fill=colour, outline=(255, 255, 255), width=1)
    pen.rounded_rectangle(box, radius=7, fill=(255, 255, 255, 225), outline=(*colour, 255), width=2)
    pen.text(((left + right) / 2, (top + bottom) / 2), text, fill=ink, font=_font(LABEL_SIZE), anchor="mm")
