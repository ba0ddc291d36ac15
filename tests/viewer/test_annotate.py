import numpy as np
import pytest
from PIL import Image

from icgnet.viewer.annotate import LABEL_SIZE, Label, draw_score_scale, shorten, text_width, write, write_labels
from icgnet.viewer.palette import instance_colours, score_colours

INK = (0.1, 0.1, 0.1)


def blank(width: int = 300, height: int = 200) -> Image.Image:
    return Image.new("RGB", (width, height), "white")


def border(image: Image.Image) -> np.ndarray:
    pixels = np.asarray(image)
    return np.concatenate([pixels[:2].ravel(), pixels[-2:].ravel(), pixels[:, :2].ravel(), pixels[:, -2:].ravel()])


def test_text_that_fits_is_not_changed():
    assert shorten("mug", 20, 200) == "mug"


@pytest.mark.parametrize("width", [0, 5, 40, 100])
def test_shortened_text_fits_its_width(width):
    line = shorten("a class name without any end " * 4, 20, width)
    assert text_width(line, 20) <= width
    assert line == "" or line.endswith("...")


def test_a_long_title_does_not_reach_the_border():
    image = blank()
    write(image, "words " * 50, (20, 20), 20)
    assert np.asarray(image).min() < 100
    assert border(image).min() == 255


@pytest.mark.parametrize("pixel", [(0, 0), (299, 0), (0, 199), (299, 199), (150, 3)])
def test_a_label_near_the_border_stays_in_the_picture(pixel):
    image = blank()
    write_labels(image, [Label("a rather long name", pixel, INK)])
    pixels = np.asarray(image).astype(int).sum(axis=2)
    rows, columns = np.nonzero(pixels < 300)
    # The words are as wide as they would be anywhere else: nothing of them is cut off.
    assert np.ptp(columns) >= 0.9 * min(text_width("a rather long name", LABEL_SIZE), 130)
    assert len(rows) > 50


def test_labels_of_the_same_thing_do_not_cover_each_other():
    single, many = blank(400, 400), blank(400, 400)
    write_labels(single, [Label("mug", (200, 300), (0.9, 0.2, 0.2))])
    write_labels(many, [Label("mug", (200, 300), (0.9, 0.2, 0.2)) for _ in range(5)])
    ink = [(np.asarray(image).astype(int).sum(axis=2) < 200).sum() for image in (single, many)]
    assert ink[1] > 4.2 * ink[0]


def test_more_labels_than_there_is_room_for_do_not_crash():
    image = blank(120, 80)
    write_labels(image, [Label(f"object {k}", (60.0, 40.0), INK) for k in range(30)])
    assert np.asarray(image).min() < 100


def test_the_score_scale_runs_from_dark_to_light():
    image = blank(500, 60)
    draw_score_scale(image, 480, 30, "score")
    row = np.asarray(image)[30].astype(int)
    bar = row[np.ptp(row, axis=1) > 40]
    assert bar[0].sum() < 300 < bar[-1].sum()


def test_score_colours_grow_lighter_with_the_score_and_clip_outside():
    lightness = score_colours(np.linspace(0, 1, 30)) @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness) > 0).all()
    assert np.array_equal(score_colours(np.array([-1.0, 2.0])), score_colours(np.array([0.0, 1.0])))


def test_twelve_instances_have_twelve_colours_and_none_is_grey():
    colours = instance_colours(np.arange(-1, 12))
    distance = np.linalg.norm(colours[:, None] - colours[None], axis=2) + 9 * np.eye(13)
    assert distance.min() > 0.1
    assert np.ptp(colours[0]) < 0.05
