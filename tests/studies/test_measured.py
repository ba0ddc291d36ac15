import pytest

from icgnet.studies.measured import Number, Quantiles, evaluate, mean, table

NUMBERS = {"count": Number("things", len, "d"), "mean": Number("their mean", mean, ".1%")}


def test_every_number_is_a_row_and_says_so_where_it_is_not_defined():
    columns = [evaluate(NUMBERS, values) for values in ([0.5, 0.25], [])]
    assert columns == [{"count": 2, "mean": 0.375}, {"count": 0, "mean": None}]
    found = table(("", "some", "none", "elsewhere"), NUMBERS, *columns, {"mean": 0.1})
    assert found.rows == [("things", "2", "0", "-"), ("their mean", "37.5%", "-", "10.0%")]


def test_quantiles_of_many_values():
    found = Quantiles.of(float(value) for value in range(11))
    assert (found.p10, found.median, found.p90, found.mean) == pytest.approx((1.0, 5.0, 9.0, 5.0))
    assert found.range(1) == "1.0 to 9.0"
