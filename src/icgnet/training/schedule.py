"""The learning rate over a run."""

import math


def learning_rate_factor(step: int, progress: float, warmup_steps: int, final: float) -> float:
    """Factor on the learning rate: a linear rise over the first steps, then half a cosine down to `final`.

    Paper: "Training Details" (linear warm-up, cosine annealing). Differs: the cosine ends with the budget; the
    published one ends early and rises again.

    Args:
        step: optimiser steps made before this one.
        progress: used share of the budget, 0 to 1.
        warmup_steps: steps of the rise.
        final: factor at the end of the budget.
    """
    rise = min(1.0, (step + 1) / max(warmup_steps, 1))
    return rise * (final + (1.0 - final) * 0.5 * (1.0 + math.cos(math.pi * progress)))
