import numpy as np
import pytest
from PIL import Image

from icgnet.errors import InputError
from icgnet.viewer.palette import instance_colours
from icgnet.viewer.sheet import NOTHING, TABLE, colour_depth, colour_ids, draw_sheet


def test_near_is_lighter_than_far_and_missing_depth_is_grey():
    depth = np.full((10, 30), 0.5)
    depth[:, 10:20], depth[:, 20:] = 0.8, np.nan
    image = colour_depth(depth).astype(int)
    assert image[5, 5].sum() > image[5, 15].sum()
    assert tuple(image[5, 25]) == NOTHING


def test_a_depth_image_without_any_depth_is_grey():
    assert (colour_depth(np.zeros((4, 5))) == NOTHING).all()


def test_ids_have_the_colours_of_the_instances():
    image = colour_ids(np.array([[-2, -1, 0, 3]]))
    expected = np.round(255 * instance_colours(np.array([0, 3])))
    assert tuple(image[0, 0]) == TABLE
    assert tuple(image[0, 1]) == NOTHING
    assert np.array_equal(image[0, 2:], expected)


def test_a_sheet_holds_every_image_whole(tmp_path):
    colours = [(200, 0, 0), (0, 200, 0), (0, 0, 200), (200, 200, 0), (200, 0, 200)]
    images = [np.full((20 + 5 * k, 60, 3), colour, np.uint8) for k, colour in enumerate(colours)]
    draw_sheet(images, ["a", "b", "c" * 200, "d", "e"], tmp_path / "sheet.png")
    with Image.open(tmp_path / "sheet.png") as image:
        sheet = np.asarray(image)
    for k, colour in enumerate(colours):
        assert (sheet == colour).all(axis=2).sum() == 60 * (20 + 5 * k)


@pytest.mark.parametrize(("count", "captions"), [(0, 0), (2, 1)])
def test_a_sheet_without_images_or_captions_is_refused(count, captions, tmp_path):
    with pytest.raises(InputError, match="one caption for each image"):
        draw_sheet([np.zeros((5, 5, 3), np.uint8)] * count, ["x"] * captions, tmp_path / "sheet.png")
