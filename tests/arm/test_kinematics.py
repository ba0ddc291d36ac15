"""Joint positions for poses and along lines."""

from dataclasses import replace

import numpy as np
import pytest

import needs_arm  # noqa: F401
from icgnet.arm.arm import Arm
from icgnet.arm.description import read_description
from icgnet.arm.kinematics import LINE_STEP, FrankaSolver, NumericalSolver, make_solver, straight_line
from icgnet.errors import DataError


@pytest.fixture(scope="module")
def poses(fr3):
    rng = np.random.default_rng(0)
    middle, half = (fr3.lower + fr3.upper) / 2, (fr3.upper - fr3.lower) / 2
    return [fr3.mount_pose(joints) for joints in rng.uniform(middle - 0.6 * half, middle + 0.6 * half, (12, 7))]


@pytest.mark.parametrize("kind", [FrankaSolver, NumericalSolver])
def test_solutions_lead_to_the_pose_within_the_limits(fr3, poses, kind):
    solver, found = kind(fr3), 0
    for pose in poses[:5]:
        solutions = solver.solutions(pose)
        found += len(solutions) > 0
        for joints in solutions:
            assert fr3.within_limits(joints)
            np.testing.assert_allclose(fr3.mount_pose(joints), pose, atol=2e-4)
        assert (np.diff([np.linalg.norm(joints - fr3.home) for joints in solutions]) >= -1e-9).all()
    assert found >= 4


def test_closed_formulas_give_several_branches(fr3, poses):
    counts = [len(FrankaSolver(fr3).solutions(pose)) for pose in poses]
    assert min(counts) > 0
    assert np.median(counts) >= 8
    # Not only one branch over the grid of the last joint: at one position of it there are several.
    solutions = FrankaSolver(fr3).solutions(poses[0])
    assert max(np.unique(solutions[:, 6].round(6), return_counts=True)[1]) >= 2


def test_out_of_reach_there_is_nothing(fr3):
    pose = fr3.mount_pose(fr3.home)
    pose[0, 3] += 1.0
    for solver in (FrankaSolver(fr3), NumericalSolver(fr3)):
        assert solver.solutions(pose).shape == (0, 7)


def test_closed_formulas_are_refused_for_another_link():
    moved = read_description("fr3")
    with pytest.raises(DataError, match="solver franka is for the flange"):
        make_solver(Arm(replace(moved, mount_link="fr3_link7")))


def test_a_line_is_straight_and_keeps_the_orientation(fr3):
    way = np.array([0.06, -0.05, -0.09])
    line = straight_line(fr3, fr3.home, way)
    assert len(line) == 1 + np.ceil(np.linalg.norm(way) / LINE_STEP)
    start = fr3.mount_pose(fr3.home)
    for share, joints in zip(np.linspace(0.0, 1.0, len(line)), line, strict=True):
        pose = fr3.mount_pose(joints)
        np.testing.assert_allclose(pose[:3, 3], start[:3, 3] + share * way, atol=1e-4)
        np.testing.assert_allclose(pose[:3, :3], start[:3, :3], atol=1e-3)
    assert np.abs(np.diff(line, axis=0)).max() < 0.2


@pytest.mark.parametrize("length", [0.06, 0.065, 0.096, 0.104])
def test_a_line_is_as_long_as_it_was_asked_for(fr3, length):
    line = straight_line(fr3, fr3.home, np.array([0.0, 0.0, -length]))
    start, end = (fr3.mount_pose(joints)[:3, 3] for joints in line[[0, -1]])
    np.testing.assert_allclose(end - start, [0.0, 0.0, -length], atol=1e-4)


def test_a_line_ends_where_the_arm_does(fr3):
    line = straight_line(fr3, fr3.home, np.array([0.0, 0.0, 1.0]))
    assert 5 < len(line) < 60
    assert all(fr3.within_limits(joints) for joints in line)
