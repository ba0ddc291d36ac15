import numpy as np

from icgnet.simulation.config import Physics
from icgnet.simulation.motion import line_at_constant_speed, smooth_line, steps_in

START, WAY = np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.03, -0.04])
PHYSICS = Physics(timestep=0.002)


def test_a_movement_has_a_position_for_each_step_and_ends_where_it_should():
    for line in (line_at_constant_speed, smooth_line):
        positions = line(START, WAY, 0.31, PHYSICS)
        assert len(positions) == steps_in(0.31, PHYSICS) == 155
        np.testing.assert_allclose(positions[-1], START + WAY, atol=1e-12)
        assert (np.abs(np.cross(positions - START, WAY)) < 1e-12).all()


def test_constant_speed_has_equal_steps_from_the_first_on():
    positions = line_at_constant_speed(START, WAY, 0.2, PHYSICS)
    np.testing.assert_allclose(np.diff(positions, axis=0, prepend=START[None]), np.tile(WAY / 100, (100, 1)))


def test_a_smooth_movement_begins_and_ends_at_rest_and_is_fastest_in_the_middle():
    speeds = np.linalg.norm(np.diff(smooth_line(START, WAY, 0.2, PHYSICS), axis=0, prepend=START[None]), axis=1)
    assert speeds[0] < 0.1 * speeds.max()
    assert speeds[-1] < 0.1 * speeds.max()
    assert abs(int(speeds.argmax()) - 49) <= 1


def test_positions_are_those_of_the_formula_bit_by_bit():
    """Labels depend on every bit of them; both formulas are written out step by step."""
    steps = steps_in(0.24, PHYSICS)
    for step in (1, 7, 60, steps):
        progress = step / steps
        smooth = START + WAY * progress**2 * (3.0 - 2.0 * progress)
        np.testing.assert_array_equal(smooth_line(START, WAY, 0.24, PHYSICS)[step - 1], smooth)
        even = START + WAY * step / steps
        np.testing.assert_array_equal(line_at_constant_speed(START, WAY, 0.24, PHYSICS)[step - 1], even)
