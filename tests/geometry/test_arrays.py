"""What callers hand in is what it claims to be, or one clear error."""

import numpy as np
import pytest

from icgnet.errors import InputError
from icgnet.geometry.arrays import FARTHEST, position, real_array, real_number, truth_array

RECORDS = np.zeros((2, 3), dtype=[("x", float)])


@pytest.mark.parametrize(
    "value",
    [
        "text",
        [["a", "b"]],
        [[1.0], [1.0, 2.0]],
        RECORDS,
        np.ones((2, 3)) * 1j,
        np.ones((2, 3), bool),
        None,
        {},
        object(),
    ],
)
def test_what_is_not_made_of_real_numbers_is_refused(value):
    with pytest.raises(InputError, match="thing must be real numbers") as error:
        real_array(value, "thing", (None, 3), finite=False)
    assert len(str(error.value)) < 400
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("value", [np.ones((2, 3), np.float16), np.ones((2, 3), np.uint16), [[1, 1, 1], [1.0, 1, 1]]])
def test_numbers_of_any_kind_come_as_doubles(value):
    array = real_array(value, "thing", (None, 3))
    assert array.dtype == np.float64
    np.testing.assert_array_equal(array, np.ones((2, 3)))


def test_another_shape_is_named():
    with pytest.raises(InputError, match=r"shape \(n, 3\), got \(3,\)"):
        real_array(np.zeros(3), "thing", (None, 3))


def test_masked_entries_are_not_measured():
    masked = np.ma.masked_equal([[1.0, 2.0, 7.0]], 7.0)
    np.testing.assert_array_equal(real_array(masked, "thing", (None, 3), finite=False), [[1.0, 2.0, np.nan]])
    with pytest.raises(InputError, match="thing must be finite"):
        real_array(masked, "thing", (None, 3))


@pytest.mark.parametrize("value", ["0.5", [0.5], np.nan, np.inf, True, None, 1e300, -2.0 * FARTHEST])
def test_a_number_is_one_finite_number_of_a_sane_size(value):
    with pytest.raises(InputError, match="height"):
        real_number(value, "height")


def test_a_number_may_come_in_any_form():
    assert [real_number(value, "height") for value in (1, 1.0, np.float32(1), np.array(1))] == [1.0] * 4


@pytest.mark.parametrize("value", ["here", [0.0, 1.0], [0.0, 1.0, np.nan], [0.0, 1.0, 1e300]])
def test_a_position_is_three_finite_numbers_near_by(value):
    with pytest.raises(InputError, match="viewpoint"):
        position(value, "viewpoint")


@pytest.mark.parametrize(
    "value", [np.full((2, 2), "no"), np.full((2, 2), np.nan), np.ma.masked_equal([[0, 1], [1, 1]], 0)]
)
def test_a_mask_is_true_or_false_everywhere(value):
    with pytest.raises(InputError, match="mask must be tru"):
        truth_array(value, "mask", (2, 2))


def test_numbers_but_zero_are_true():
    np.testing.assert_array_equal(truth_array([[0, 255]], "mask", (1, 2)), [[False, True]])
