import numpy as np
import pytest
from PIL import Image

from icgnet.errors import InputError
from icgnet.viewer.reliability_diagram import ReliabilityPanel, draw_reliability, reliability_figure, short_count


def panel(**more):
    scores = np.array([0.1, np.nan, 0.5, 0.7, 0.9])
    shares = np.array([0.0, np.nan, 0.4, 0.6, 1.0])
    return ReliabilityPanel("made up", scores, shares, np.array([5000, 0, 20, 10, 3]), **more)


def test_bars_reach_to_the_share_of_successes_and_below_to_the_counts():
    shares, counts = reliability_figure([panel()]).axes
    assert [bar.get_height() for bar in shares.patches] == [0.0, 0.4, 0.6, 1.0]
    assert [bar.get_height() for bar in counts.patches] == [5000, 20, 10, 3]
    middles = [bar.get_x() + bar.get_width() / 2 for bar in shares.patches]
    assert middles == pytest.approx([0.1, 0.5, 0.7, 0.9])


def test_dots_stand_at_the_mean_scores():
    diagonal, dots = reliability_figure([panel()]).axes[0].lines
    np.testing.assert_array_equal(diagonal.get_xydata(), [[0, 0], [1, 1]])
    np.testing.assert_allclose(dots.get_xydata(), [[0.1, 0.0], [0.5, 0.4], [0.7, 0.6], [0.9, 1.0]])


def test_the_best_grasps_are_marked_where_they_belong():
    assert len(reliability_figure([panel()]).axes[0].lines) == 2
    *_, mark = reliability_figure([panel(best_score=0.9, best_success=0.5)]).axes[0].lines
    np.testing.assert_array_equal(mark.get_xydata(), [[0.9, 0.5]])
    assert "score 0.90, success 0.50" in mark.get_label()


def test_diagrams_stand_side_by_side_in_one_picture(tmp_path):
    for name, panels in (("one", [panel()]), ("two", [panel(), panel()])):
        draw_reliability(panels, tmp_path / "folder" / f"{name}.png")
    with Image.open(tmp_path / "folder" / "one.png") as one, Image.open(tmp_path / "folder" / "two.png") as two:
        assert two.size == (2 * one.size[0], one.size[1])


@pytest.mark.parametrize(("count", "text"), [(0, "0"), (987, "987"), (1234, "1.2k"), (9949, "9.9k"), (45_123, "45k")])
def test_counts_are_written_short(count, text):
    assert short_count(count) == text


def test_a_diagram_without_grasps_is_refused(tmp_path):
    empty = ReliabilityPanel("empty", np.full(3, np.nan), np.full(3, np.nan), np.zeros(3, np.int64))
    for panels in ([], [empty]):
        with pytest.raises(InputError, match="needs grasps"):
            draw_reliability(panels, tmp_path / "diagram.png")
