import pytest

from icgnet.training.schedule import learning_rate_factor


def test_rate_rises_linearly_and_falls_to_the_floor():
    rise = [learning_rate_factor(step, 0.0, 10, 0.01) for step in range(10)]
    assert rise == pytest.approx([0.1 * (step + 1) for step in range(10)])
    assert learning_rate_factor(5000, 0.5, 10, 0.01) == pytest.approx(0.505)
    assert learning_rate_factor(5000, 1.0, 10, 0.01) == pytest.approx(0.01)


def test_rate_never_rises_again():
    factors = [learning_rate_factor(1000, progress / 100, 10, 0.01) for progress in range(101)]
    assert factors == sorted(factors, reverse=True)
