import numpy as np
import pytest

from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, look_at, pixel_rays
from icgnet.geometry.depth_scale import depth_scale

POSE = look_at(np.array([0.15, -0.4, 0.5]), np.array([0.15, 0.15, 0.05]))


def table_picture(height: float = 0.05) -> np.ndarray:
    """Depth of a table with a box of 10 cm on it, in the middle of the picture."""
    slopes = pixel_rays(DEFAULT_INTRINSICS, DEFAULT_SHAPE) @ POSE[2, :3]
    depth = (height - POSE[2, 3]) / slopes
    box = (height + 0.1 - POSE[2, 3]) / slopes
    depth[150:330, 200:440] = box[150:330, 200:440]
    return depth


@pytest.mark.parametrize("gain", [0.93, 1.0, 1.06])
def test_a_gain_of_the_depth_is_found_by_the_table(gain):
    rng = np.random.default_rng(0)
    depth = gain * table_picture() + rng.normal(scale=0.002, size=DEFAULT_SHAPE)
    depth[:20] = 0.0
    depth[20:25] = np.nan
    assert depth_scale(depth, DEFAULT_INTRINSICS, POSE, 0.05) == pytest.approx(1 / gain, abs=1e-3)


def test_without_a_table_there_is_no_scale():
    assert depth_scale(np.full(DEFAULT_SHAPE, 0.2), DEFAULT_INTRINSICS, POSE, 0.05) is None
    assert depth_scale(np.zeros(DEFAULT_SHAPE), DEFAULT_INTRINSICS, POSE, 0.05) is None
    up = POSE.copy()
    up[:3, 1:3] *= -1
    assert depth_scale(table_picture(), DEFAULT_INTRINSICS, up, 0.05) is None
