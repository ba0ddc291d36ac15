import numpy as np
import pytest
from PIL import Image

from icgnet.errors import InputError
from icgnet.viewer.palette import instance_colour
from icgnet.viewer.sensor_sheet import COLUMNS, SeenCloud, draw_sensor_sheet

PANEL = (150, 180)


def box_cloud(caption, owner=0, count=4000):
    rng = np.random.default_rng(0)
    points = rng.uniform([0.12, 0.12, 0.05], [0.18, 0.18, 0.11], (count, 3))
    points[np.arange(count), rng.integers(0, 3, count)] = 0.12
    return SeenCloud(caption, points, np.full(count, owner), np.array([0.15, -0.3, 0.5]), 0.0011)


def test_every_cloud_has_its_panel(tmp_path):
    empty = SeenCloud("empty", np.zeros((0, 3)), np.zeros(0, int), np.array([0.15, -0.3, 0.5]), 0.0011)
    draw_sensor_sheet([box_cloud("first"), box_cloud("other colours", 2), empty], tmp_path / "a.png", PANEL)
    with Image.open(tmp_path / "a.png") as image:
        sheet = np.asarray(image.convert("RGB")).astype(int)
    cell = sheet.shape[1] // COLUMNS
    hues = [sheet[: PANEL[0], k * cell : (k + 1) * cell].reshape(-1, 3) for k in range(3)]
    drawn = [hue[np.ptp(hue, axis=1) > 25] for hue in hues]
    assert len(drawn[0]) > 500
    assert len(drawn[2]) == 0
    for k, owner in ((0, 0), (1, 2)):
        # The colour of light surfaces leans the same way as the palette's.
        assert np.corrcoef(drawn[k].mean(axis=0), instance_colour(owner))[0, 1] > 0.9


@pytest.mark.parametrize("clouds", [[], [box_cloud("table only", -2)]])
def test_without_objects_there_is_no_view(clouds, tmp_path):
    with pytest.raises(InputError, match="first cloud"):
        draw_sensor_sheet(clouds, tmp_path / "a.png", PANEL)
