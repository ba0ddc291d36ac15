"""Trajectories within the arm's limits."""

from itertools import pairwise

import numpy as np
import pytest

import needs_arm  # noqa: F401
from arm_scenes import link_meshes
from icgnet.arm.kinematics import straight_line
from icgnet.arm.timing import NoTrajectoryError, Timing, joined, slowed, still
from icgnet.errors import InputError


@pytest.fixture(scope="module")
def timing(fr3):
    return Timing(fr3)


@pytest.fixture(scope="module")
def path(fr3):
    return fr3.home + 0.4 * np.random.default_rng(0).normal(size=(4, 7))


@pytest.mark.parametrize("deviation", [0.0, 0.02, 0.1])
def test_the_limits_are_kept_and_the_ends_are_at_rest(fr3, timing, path, deviation):
    trajectory = timing.along(path, deviation)
    assert (np.abs(trajectory.velocities) <= fr3.velocity * (1 + 1e-9)).all()
    assert (np.abs(trajectory.all_accelerations) <= fr3.acceleration * (1 + 1e-9)).all()
    np.testing.assert_allclose(trajectory.positions[[0, -1]], path[[0, -1]], atol=1e-9)
    np.testing.assert_allclose(trajectory.velocities[[0, -1]], 0.0, atol=1e-9)
    # Velocities are those of the positions, and at least one limit is used.
    middle = (trajectory.velocities[1:] + trajectory.velocities[:-1]) / 2
    steps = np.diff(trajectory.positions, axis=0) / np.diff(trajectory.times)[:, None]
    np.testing.assert_allclose(steps, middle, atol=0.03)
    assert np.abs(trajectory.accelerations / fr3.acceleration).max() > 0.9


def test_rounded_corners_are_near_the_waypoints_and_save_time(timing, path):
    sharp, rounded = timing.along(path, 0.0), timing.along(path, 0.05)
    assert rounded.duration < sharp.duration
    times = np.arange(0.0, rounded.duration, 0.002)
    for waypoint in path:
        assert np.linalg.norm(rounded.at(times) - waypoint, axis=1).min() < 0.06


def test_a_straight_line_stays_straight(fr3, timing):
    way = np.array([0.1, 0.0, -0.1])
    trajectory = timing.along(straight_line(fr3, fr3.home, way), 0.002)
    start = fr3.mount_pose(fr3.home)[:3, 3]
    tips = np.array([fr3.mount_pose(q)[:3, 3] for q in trajectory.at(np.arange(0.0, trajectory.duration, 0.01))])
    along = way / np.linalg.norm(way)
    offsets = tips - start - np.outer((tips - start) @ along, along)
    assert np.abs(offsets).max() < 2e-4


def test_half_the_speed_takes_twice_as_long(timing, path):
    fast, slow = timing.along(path, 0.05), timing.along(path, 0.05, 0.5)
    assert slow.duration == pytest.approx(2 * fast.duration)
    assert np.abs(slow.velocities).max() == pytest.approx(np.abs(fast.velocities).max() / 2)
    assert slowed(fast, 2.0).accelerations.max() == pytest.approx(fast.accelerations.max() / 4)


@pytest.mark.parametrize(
    ("arguments", "message"), [((0.05, 0.0), "speed must be above 0"), ((0.05, 1.5), "at most 1, got 1.5")]
)
def test_wrong_speeds_are_refused(timing, path, arguments, message):
    with pytest.raises(InputError, match=message):
        timing.along(path, *arguments)


def test_a_path_must_lead_somewhere(timing, path):
    with pytest.raises(InputError, match="from one position to another"):
        timing.along(path[[0, 0]], 0.05)


def test_between_samples_nothing_moves_farther_than_asked_for(fr3, timing, path):
    samples = timing.along(path, 0.05).samples(fr3.reaches, 0.02)
    np.testing.assert_allclose(samples[[0, -1]], path[[0, -1]], atol=1e-9)
    corners = [np.concatenate([mesh.vertices for mesh in link_meshes(fr3, joints)]) for joints in samples]
    ways = [np.linalg.norm(b - a, axis=1).max() for a, b in pairwise(corners)]
    assert max(ways) <= 0.02


def test_one_after_the_other(timing, path):
    first, second = timing.along(path[:2], 0.05), timing.along(path[1:], 0.05)
    whole = joined([first, still(path[1], 0.5), second])
    assert whole.duration == pytest.approx(first.duration + 0.5 + second.duration)
    assert (np.diff(whole.times) > 0).all()
    np.testing.assert_allclose(whole.at(np.array([first.duration + 0.25]))[0], path[1], atol=1e-9)
    np.testing.assert_allclose(whole.at(np.array([whole.duration]))[0], path[-1], atol=1e-9)


def test_where_the_library_finds_no_trajectory_it_is_said(timing, path, monkeypatch):
    class Failing:
        def generate(self, given, options):
            raise RuntimeError("TOPPRA failed with return code 3")

    monkeypatch.setattr(timing, "_toppra", Failing())
    with pytest.raises(NoTrajectoryError, match="code 3"):
        timing.along(path, 0.05)
