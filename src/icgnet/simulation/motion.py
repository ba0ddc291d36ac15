"""Straight movements of the hand: one position for each step of the physics."""

import numpy as np
from jaxtyping import Float

from icgnet.simulation.config import Physics


def steps_in(duration: float, physics: Physics) -> int:
    """How many steps of the physics a duration [s] has."""
    return round(duration / physics.timestep)


def line_at_constant_speed(
    start: Float[np.ndarray, "3"], way: Float[np.ndarray, "3"], duration: float, physics: Physics
) -> Float[np.ndarray, "s 3"]:
    """Positions [m] of a movement at constant speed, as the published benchmark moves its hand.

    Args:
        start: where the hand is [m]; the first position is one step further.
        way: from there to the last position [m].
        duration: of the movement [s].
        physics: gives the length of a step.
    """
    steps = steps_in(duration, physics)
    return start + way * np.arange(1, steps + 1)[:, None] / steps


def smooth_line(
    start: Float[np.ndarray, "3"], way: Float[np.ndarray, "3"], duration: float, physics: Physics
) -> Float[np.ndarray, "s 3"]:
    """Positions [m] of a movement that begins and ends at rest; arguments as in `line_at_constant_speed`."""
    steps = steps_in(duration, physics)
    progress = np.arange(1, steps + 1)[:, None] / steps
    return start + way * progress**2 * (3.0 - 2.0 * progress)
