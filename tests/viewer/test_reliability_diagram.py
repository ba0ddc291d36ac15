import numpy as np
import pytest
from PIL import Image

from icgnet.errors import InputError
from icgnet.viewer.palette import to_bytes
from icgnet.viewer.reliability_diagram import (
    BAR,
    BEST,
    LEFT,
    PANEL_SIZE,
    PLOT,
    TOP,
    ReliabilityPanel,
    draw_reliability,
    short_count,
)


def panel(**more):
    scores = np.array([0.1, np.nan, 0.5, 0.7, 0.9])
    shares = np.array([0.0, np.nan, 0.4, 0.6, 1.0])
    return ReliabilityPanel("made up", scores, shares, np.array([5000, 0, 20, 10, 3]), **more)


def drawn(panels, tmp_path):
    draw_reliability(panels, tmp_path / "folder" / "diagram.png")
    with Image.open(tmp_path / "folder" / "diagram.png") as image:
        return np.asarray(image.convert("RGB"))


def has(image, colour):
    return (image == to_bytes(colour)).all(axis=-1)


def test_bars_reach_to_the_share_of_successes(tmp_path):
    plot = has(drawn([panel()], tmp_path), BAR)[TOP : TOP + PLOT, LEFT : LEFT + PLOT]
    columns = [plot[:, round(PLOT * (k + 0.25) / 5)] for k in range(5)]
    heights = [1 - column.argmax() / PLOT if column.any() else 0.0 for column in columns]
    assert heights == pytest.approx([0.0, 0.0, 0.4, 0.6, 1.0], abs=0.02)


def test_the_best_grasps_are_marked_where_they_belong(tmp_path):
    assert not has(drawn([panel()], tmp_path), BEST).any()
    marked = has(drawn([panel(best_score=0.9, best_success=0.5)], tmp_path), BEST)
    assert marked[round(TOP + PLOT * 0.5), round(LEFT + PLOT * 0.9)]


def test_diagrams_stand_side_by_side(tmp_path):
    assert drawn([panel(), panel()], tmp_path).shape == (PANEL_SIZE[1], 2 * PANEL_SIZE[0], 3)


@pytest.mark.parametrize(("count", "text"), [(0, "0"), (987, "987"), (1234, "1.2k"), (9949, "9.9k"), (45_123, "45k")])
def test_counts_are_written_short(count, text):
    assert short_count(count) == text


def test_a_diagram_without_grasps_is_refused(tmp_path):
    empty = ReliabilityPanel("empty", np.full(3, np.nan), np.full(3, np.nan), np.zeros(3, np.int64))
    for panels in ([], [empty]):
        with pytest.raises(InputError, match="needs grasps"):
            draw_reliability(panels, tmp_path / "diagram.png")
