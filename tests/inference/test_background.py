import numpy as np
import pytest

from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.inference.background import extents, is_background


def slab(length: float, width: float, height: float, turn: float = 0.4) -> np.ndarray:
    """Points in a box that stands on the table, turned about the vertical."""
    points = np.random.default_rng(0).uniform(0.0, 1.0, (4000, 3)) * [length, width, height] + [0, 0, TABLE_HEIGHT]
    c, s = np.cos(turn), np.sin(turn)
    return points @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T


def test_extents_are_along_the_principal_axes():
    np.testing.assert_allclose(extents(slab(0.3, 0.1, 0.05)), np.array([0.05, 0.1, 0.3]) * 0.94, atol=0.004)


@pytest.mark.parametrize(
    ("size", "score", "background"),
    [
        ((0.05, 0.04, 0.012), 0.6, True),
        ((0.05, 0.04, 0.012), 0.9, False),
        ((0.05, 0.04, 0.05), 0.6, False),
        ((0.5, 0.02, 0.12), 0.99, True),
        ((0.25, 0.02, 0.12), 0.99, False),
        ((0.4, 0.25, 0.05), 0.99, False),
        ((0.5, 0.02, 0.02), 0.99, False),
    ],
    ids=["doubted wave", "flat thing", "doubted thing", "wall", "short board", "large box", "stick on the table"],
)
def test_waves_and_walls_are_no_objects(size, score, background):
    assert is_background(slab(*size), score, 100_000) == background


def test_a_low_speck_is_no_object_and_a_high_one_is():
    low, high = slab(0.02, 0.02, 0.01)[:60], slab(0.02, 0.02, 0.05)[:60]
    assert is_background(low, 0.99, 100_000)
    assert not is_background(high, 0.99, 100_000)
    assert not is_background(low, 0.99, 19_200)


def test_what_lies_along_the_line_of_sight_is_a_smear_and_what_faces_the_camera_is_not():
    spread = slab(0.06, 0.04, 0.03)[:200]
    assert is_background(spread, 0.99, 100_000, covered=0.0004)
    assert not is_background(spread, 0.99, 100_000, covered=0.0012)
    assert not is_background(spread, 0.99, 100_000)
    assert not is_background(slab(0.25, 0.2, 0.15), 0.99, 100_000, covered=0.004)  # a large thing with holes
