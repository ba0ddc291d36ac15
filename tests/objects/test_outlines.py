import numpy as np
import pytest

from icgnet.objects.outlines import circle, convex_cells, cut_ears, is_convex, rounded_rectangle, superellipse

STAR = circle(10) * np.where(np.arange(10) % 2 == 0, 1.0, 0.4)[:, None]
LETTER_U = np.array([[0, 0], [1, 0], [1, 1], [0.7, 1], [0.7, 0.3], [0.3, 0.3], [0.3, 1], [0, 1]], float)
CROSS = np.array(
    [[1, 3], [0, 3], [0, 2], [-1, 2], [-1, 1], [0, 1], [0, 0], [1, 0], [1, 1], [2, 1], [2, 2], [1, 2]], float
)
OUTLINES = {"star": STAR, "u": LETTER_U, "cross": CROSS, "circle": circle(17)}


def area(outline: np.ndarray) -> float:
    x, y = outline.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))


@pytest.mark.parametrize("name", OUTLINES)
def test_convex_cells_are_convex_and_fill_the_outline(name):
    outline = OUTLINES[name]
    cells = convex_cells(outline)
    assert all(is_convex(outline[cell]) for cell in cells)
    assert sum(area(outline[cell]) for cell in cells) == pytest.approx(area(outline))


@pytest.mark.parametrize("name", OUTLINES)
def test_ears_have_area_and_fill_the_outline(name):
    areas = [area(OUTLINES[name][ear]) for ear in cut_ears(OUTLINES[name])]
    assert min(areas) > 1e-6
    assert sum(areas) == pytest.approx(area(OUTLINES[name]))


def test_convex_outline_stays_in_one_piece():
    assert len(convex_cells(circle(17))) == 1


def test_outlines_run_counter_clockwise():
    for outline in (circle(12), superellipse(24, 4.0, 0.6), rounded_rectangle(0.1, 0.05, 0.01)):
        assert area(outline) > 0.0
        assert is_convex(outline)
