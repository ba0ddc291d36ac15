import pytest

from icgnet.benchmark.statistics import Metric, Quantiles, Spread, evaluate, mean, table

NUMBERS = {"count": Metric("things", len, "d"), "mean": Metric("their mean", mean, ".1%")}


def test_every_number_is_a_row_and_says_so_where_it_is_not_defined():
    columns = [evaluate(NUMBERS, values) for values in ([0.5, 0.25], [])]
    assert columns == [{"count": 2, "mean": 0.375}, {"count": 0, "mean": None}]
    found = table(("", "some", "none", "elsewhere"), NUMBERS, *columns, {"mean": 0.1})
    assert found.rows == [("things", "2", "0", "-"), ("their mean", "37.5%", "-", "10.0%")]


def test_quantiles_of_many_values():
    found = Quantiles.of(float(value) for value in range(11))
    assert (found.p10, found.median, found.p90, found.mean) == pytest.approx((1.0, 5.0, 9.0, 5.0))
    assert f"{found:.1f}" == "5.0 (1.0 to 9.0)"


def test_a_spread_is_written_with_its_deviation_if_there_is_one():
    assert f"{Spread(84.0, 6.1, 80.0, 88.0):.1f}" == "84.0 ± 6.1 [80.0, 88.0]"
    assert f"{Spread(84.0, None, 80.0, 88.0):.0f}" == "84 [80, 88]"
