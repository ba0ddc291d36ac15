"""The workspace cube: [0, 0.3]^3 m, z up, the table plane at z = 0.05 m.

That is where packed and pile scenes are; tables and bins extend beyond it, in the same frame.
"""

import numpy as np
from jaxtyping import Bool, Float

SIZE = 0.3
"""Edge of the workspace cube [m]."""
TABLE_HEIGHT = 0.05
"""Height of the table plane in the workspace [m]."""
TABLE_MARGIN = 0.004
"""Points less than this above the table belong to the table [m]."""
CENTRE = np.array([SIZE / 2, SIZE / 2, SIZE / 2])
"""Centre of the cube [m]."""


def contains(points: Float[np.ndarray, "n 3"], margin: float = 0.0) -> Bool[np.ndarray, "n"]:
    """Which points [m] lie in the cube, at least `margin` [m] away from its faces."""
    inside = (points >= margin) & (points <= SIZE - margin)
    # Numpy is slow on short last axes.
    return inside[..., 0] & inside[..., 1] & inside[..., 2]


def above_table(points: Float[np.ndarray, "n 3"], table_height: float = TABLE_HEIGHT) -> Bool[np.ndarray, "n"]:
    """Which points [m] stand out of the table by more than `TABLE_MARGIN`."""
    return points[..., 2] > table_height + TABLE_MARGIN
