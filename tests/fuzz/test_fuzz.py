"""A sample of what `make fuzz` does."""

from fuzz.calls import run


def test_a_sample_of_strange_calls_is_answered_or_refused_in_one_clear_line():
    counts, failures = run(calls=300, seed=0)
    assert failures == []
    assert sum(counts.values()) == 300
    assert {outcome for _, outcome in counts} == {"answered", "refused"}
