import numpy as np
import pytest
from scipy.special import expit

from icgnet.training.reliability import BINS, reliability


def drawn(shift, count=200_000):
    """Scores, and labels of grasps whose true logits are lower by `shift`."""
    rng = np.random.default_rng(0)
    logits = rng.normal(-1.0, 2.0, count)
    return expit(logits), rng.random(count) < expit(logits - shift)


@pytest.mark.parametrize("spread", ["mass", "width"])
def test_true_scores_have_no_error_and_shifted_ones_do(spread):
    assert reliability(*drawn(0.0), spread).error < 0.005
    assert reliability(*drawn(1.0), spread).error > 0.08


def test_error_of_a_hand_worked_case():
    scores = np.array([0.1, 0.3, 0.9, 0.9])
    labels = np.array([0, 0, 1, 0], bool)
    found = reliability(scores, labels, "width", bins=2)
    assert found.counts.tolist() == [2, 2]
    assert found.scores == pytest.approx([0.2, 0.9])
    assert found.shares == pytest.approx([0.0, 0.5])
    assert found.error == pytest.approx((2 * 0.2 + 2 * 0.4) / 4)


def test_bins_of_equal_mass_hold_equally_many():
    scores, labels = drawn(0.0, 30_000)
    assert reliability(scores, labels).counts == pytest.approx(30_000 / BINS, abs=2)


def test_equal_scores_are_never_torn_apart():
    # The successes stand together; bins that cut through equal scores would see all or none of them.
    labels = np.arange(100) < 30
    found = reliability(np.full(100, 0.3), labels)
    assert sorted(found.counts)[-2:] == [0, 100]
    assert found.error == pytest.approx(0.0)


def test_scores_of_exactly_0_and_1_are_counted():
    assert reliability(np.array([0.0, 1.0]), np.array([False, True]), "width").counts.sum() == 2


def test_without_grasps_there_is_no_error():
    assert reliability(np.zeros(0), np.zeros(0, bool)).error == 0.0
