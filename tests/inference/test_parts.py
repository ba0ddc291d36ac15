"""Whether two parts are one object."""

import numpy as np
import pytest

from icgnet.geometry.clouds import PointCloud
from icgnet.inference.parts import group_parts

SPACING = 0.002
EYE = np.array([0.15, -0.2, 0.6])


def surface(width: float, height_at) -> np.ndarray:
    """A patch, 5 cm wide in y, whose height depends on x alone."""
    x, y = np.meshgrid(np.arange(0, width, SPACING), np.arange(0.1, 0.15, SPACING), indexing="ij")
    return np.stack([x, y, height_at(x)], axis=-1).reshape(-1, 3)


def cut(points: np.ndarray, *borders: float) -> tuple[list[np.ndarray], PointCloud]:
    """The patch in pieces along x."""
    piece = np.digitize(points[:, 0], borders)
    rows = [np.flatnonzero(piece == number) for number in range(len(borders) + 1)]
    return rows, PointCloud(points, EYE, "table")


@pytest.mark.parametrize(
    ("height_at", "objects"),
    [
        (lambda x: 0.1 + 0 * x, 1),
        (lambda x: 0.1 - np.abs(x - 0.06), 2),
        (lambda x: 0.05 + np.sqrt(0.065**2 - (x - 0.06) ** 2), 1),
        (lambda x: 0.06 + np.abs(x - 0.06), 2),
        (lambda x: np.where(x < 0.06, 0.1, 0.06), 2),
    ],
    ids=["flat", "roof", "cylinder", "valley", "step"],
)
def test_parts_of_one_surface_are_joined_unless_there_is_a_groove_or_an_edge(height_at, objects):
    parts, cloud = cut(surface(0.12, height_at), 0.06)
    assert len(np.unique(group_parts(parts, cloud))) == objects


def test_a_crumb_of_one_part_on_another_object_is_no_bridge():
    points = surface(0.3, lambda x: np.where((x > 0.12) & (x < 0.16), 0.06, 0.1))
    far = points[:, 0] > 0.16
    crumb = far & (points[:, 0] < 0.19)
    rows = [np.flatnonzero((points[:, 0] < 0.12) | crumb), np.flatnonzero(far & ~crumb)]
    assert len(np.unique(group_parts(rows, PointCloud(points, EYE, "table")))) == 2


def test_parts_apart_are_two_objects():
    points = surface(0.12, lambda x: 0.1 + 0 * x)
    parts, cloud = cut(points[np.abs(points[:, 0] - 0.06) > 0.006], 0.06)
    assert len(np.unique(group_parts(parts, cloud))) == 2


def test_three_parts_in_a_row_are_one_object_and_a_stranger_keeps_its_number():
    points = surface(0.3, lambda x: np.where(x < 0.2, 0.1, 0.06))
    parts, cloud = cut(points, 0.06, 0.12, 0.2)
    np.testing.assert_array_equal(group_parts([parts[0], parts[3], parts[1], parts[2]], cloud), (0, 1, 0, 0))


def test_no_parts_are_no_objects():
    assert len(group_parts([], PointCloud(np.zeros((0, 3)), EYE, "table"))) == 0
