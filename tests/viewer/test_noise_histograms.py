import numpy as np
import pytest
from matplotlib.patches import Rectangle
from PIL import Image

from icgnet.errors import InputError
from icgnet.viewer.noise_histograms import BINS, HistogramRow, draw_histograms, histogram_figure


def row(caption="camera"):
    rng = np.random.default_rng(0)
    return HistogramRow(
        caption, {"noise": rng.random(50), "holes": np.zeros(0)}, {"noise": rng.random(80), "holes": rng.random(9)}
    )


def test_every_camera_and_measure_has_its_pair():
    noise, holes, *_ = histogram_figure([row(), row("another")]).axes
    assert noise.get_title() == "noise"
    assert noise.get_ylabel() == "camera"
    assert len(noise.patches) == 2 * BINS
    assert len(holes.patches) == BINS
    heights = [bar.get_bbox().height for bar in noise.patches[:BINS] if isinstance(bar, Rectangle)]
    assert sum(heights) * (noise.get_xlim()[1] - noise.get_xlim()[0]) / BINS == pytest.approx(1.0, rel=0.2)


def test_a_picture_is_written(tmp_path):
    draw_histograms([row()], tmp_path / "folder" / "a.png")
    with Image.open(tmp_path / "folder" / "a.png") as image:
        assert image.width > image.height


def test_without_cameras_there_is_no_picture(tmp_path):
    with pytest.raises(InputError, match="at least one camera"):
        draw_histograms([], tmp_path / "a.png")
