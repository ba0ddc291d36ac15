import numpy as np

from icgnet.geometry.workspace import CENTRE, SIZE, TABLE_HEIGHT, TABLE_MARGIN, above_table, contains


def test_cube_contains_its_centre_and_corners_but_nothing_outside():
    points = np.array([CENTRE, [0, 0, 0], [SIZE] * 3, [0.1, 0.1, 0.301], [-1e-6, 0.1, 0.1]])
    assert contains(points).tolist() == [True, True, True, False, False]


def test_margin_shrinks_the_cube_on_all_sides():
    points = np.array([[0.009, 0.1, 0.1], [0.011, 0.1, 0.1], [0.1, 0.1, 0.291], [0.1, 0.1, 0.289]])
    assert contains(points, margin=0.01).tolist() == [False, True, False, True]


def test_points_within_the_margin_belong_to_the_table():
    heights = TABLE_HEIGHT + np.array([-0.01, 0.0, 0.9 * TABLE_MARGIN, 1.1 * TABLE_MARGIN])
    points = np.column_stack([np.zeros(4), np.zeros(4), heights])
    assert above_table(points).tolist() == [False, False, False, True]
