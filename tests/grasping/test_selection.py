import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform, random_rotation, rotation_z
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.selection import (
    in_cone,
    in_region,
    non_maximum_suppression,
    of_class,
    of_instances,
    ranked,
)

DOWN = np.diag([1.0, -1.0, -1.0])


def grasps_at(positions, scores=None, rotations=DOWN, instances=None) -> Grasps:
    positions = np.asarray(positions, dtype=float)
    count = len(positions)
    return Grasps(
        poses=make_transform(np.broadcast_to(rotations, (count, 3, 3)), positions),
        widths=np.full(count, 0.04),
        openings=np.full(count, 0.052),
        scores=np.linspace(0.9, 0.1, count) if scores is None else np.asarray(scores, dtype=float),
        instances=np.zeros(count, dtype=np.int64) if instances is None else np.asarray(instances),
        contacts=positions.copy(),
        angles=np.zeros(count, dtype=np.int64),
    )


def heights(*values: float) -> np.ndarray:
    return np.array([[0.1, 0.1, value] for value in values])


def test_the_best_come_first_and_equals_keep_their_order():
    grasps = ranked(grasps_at(heights(0.0, 0.1, 0.2), [0.3, 0.8, 0.8]))
    assert grasps.poses[:, 2, 3].tolist() == [0.1, 0.2, 0.0]
    assert len(ranked(Grasps.empty())) == 0


@pytest.mark.parametrize(
    ("scores", "expected"),
    [
        ([0.95, 0.91, 0.99, 0.5], [1, 2, 0]),  # three above 0.9: the highest of them
        ([0.85, 0.81, 0.90, 0.95], [3, 1, 2, 0]),  # 0.9 itself does not exceed 0.9, so it competes at 0.8
        ([0.75, 0.10, 0.10, 0.5], [0]),
        ([0.70, 0.10, 0.10, 0.69], []),  # nothing good enough: look again
    ],
)
def test_ladder_takes_the_highest_grasps_of_the_best_step(scores, expected):
    levels = (0.1, 0.2, 0.15, 0.3)
    grasps = ranked(grasps_at(heights(*levels), scores), "highest")
    assert grasps.poses[:, 2, 3].tolist() == [levels[index] for index in expected]


def test_ladder_follows_the_given_up_direction():
    grasps = grasps_at([[0.1, 0, 0.3], [0.3, 0, 0.1]], [0.95, 0.95])
    assert ranked(grasps, "highest").poses[0, 2, 3] == 0.3
    assert ranked(grasps, "highest", up=np.array([1.0, 0, 0])).poses[0, 0, 3] == 0.3
    assert len(ranked(Grasps.empty(), "highest")) == 0


def test_grasps_of_instances_and_classes():
    grasps = grasps_at(heights(0, 0, 0, 0), instances=[0, 1, 2, 1])
    classes = {0: "mug", 1: "bottle", 2: "bottle"}
    assert of_instances(grasps, [1]).instances.tolist() == [1, 1]
    assert of_class(grasps, "bottle", classes).instances.tolist() == [1, 2, 1]
    assert len(of_class(grasps, "box", classes)) == 0
    assert len(of_instances(grasps, [])) == 0


def test_region_includes_its_border():
    grasps = grasps_at(heights(0.1, 0.2, 0.3))
    kept = in_region(grasps, np.array([0.0, 0.1, 0.1]), np.array([0.1, 0.2, 0.2]))
    assert kept.poses[:, 2, 3].tolist() == [0.1, 0.2]


def test_region_with_swapped_corners_is_refused():
    with pytest.raises(InputError, match=r"lower <= upper, got \[0\.2, 0\.0, 0\.0\]"):
        in_region(Grasps.empty(), np.array([0.2, 0.0, 0.0]), np.ones(3) * 0.1)


@given(st.floats(0, np.pi), st.floats(0, np.pi), st.floats(0.1, 10))
def test_cone_keeps_approaches_within_its_angle(tilt, half_angle, length):
    c, s = np.cos(tilt), np.sin(tilt)
    tilted = np.array([[1, 0, 0], [0, c, -s], [0, s, c]]) @ DOWN
    grasps = grasps_at(heights(0.1), rotations=tilted)
    kept = len(in_cone(grasps, np.array([0, 0, -length]), half_angle)) == 1
    if abs(tilt - half_angle) > 1e-4:
        assert kept == (tilt < half_angle)


def test_cone_of_angle_zero_keeps_its_own_direction():
    rng = np.random.default_rng(0)
    for _ in range(20):
        grasps = grasps_at(heights(0.1), rotations=random_rotation(rng))
        assert len(in_cone(grasps, 3.0 * grasps.poses[0, :3, 2], 0.0)) == 1


@pytest.mark.parametrize(("direction", "angle"), [([0.0, 0, 0], 0.1), ([0, 0, np.nan], 0.1), ([0, 0, -1.0], 4.0)])
def test_impossible_cone_is_refused(direction, angle):
    with pytest.raises(InputError, match="must be"):
        in_cone(Grasps.empty(), np.array(direction), angle)


def test_suppression_keeps_the_best_of_each_group():
    grasps = grasps_at([[0, 0, 0], [0.1, 0, 0], [0.01, 0, 0], [0.105, 0, 0]], [0.5, 0.6, 0.9, 0.3])
    kept = non_maximum_suppression(grasps)
    assert kept.scores.tolist() == [0.9, 0.6]


def test_suppression_keeps_other_orientations_at_the_same_place():
    turned = DOWN @ rotation_z(np.deg2rad(40))
    grasps = grasps_at(heights(0, 0, 0), rotations=np.stack([DOWN, turned, DOWN @ rotation_z(0.1)]))
    assert non_maximum_suppression(grasps).scores.tolist() == grasps.scores[:2].tolist()


def test_hand_turned_by_half_a_turn_is_the_same_hand():
    grasps = grasps_at(heights(0, 0), rotations=np.stack([DOWN, DOWN @ rotation_z(np.pi)]))
    assert len(non_maximum_suppression(grasps)) == 1
    opposite_approach = grasps_at(heights(0, 0), rotations=np.stack([DOWN, np.eye(3)]))
    assert len(non_maximum_suppression(opposite_approach)) == 2


@given(st.integers(0, 2**32 - 1), st.integers(0, 12))
def test_suppression_matches_comparing_all_pairs(seed, count):
    rng = np.random.default_rng(seed)
    rotations = np.stack([random_rotation(rng) for _ in range(count)]) if count else np.zeros((0, 3, 3))
    grasps = grasps_at(rng.uniform(0, 0.05, (count, 3)), rng.uniform(size=count), rotations)
    kept: list[int] = []
    half_turn = rotation_z(np.pi)
    for index in np.argsort(-grasps.scores, kind="stable"):
        pose = grasps.poses[index]
        alike = False
        for other in kept:
            best = grasps.poses[other]
            near = np.linalg.norm(pose[:3, 3] - best[:3, 3]) < 0.03
            traces = [np.trace(best[:3, :3].T @ pose[:3, :3] @ turn) for turn in (np.eye(3), half_turn)]
            alike |= near and np.arccos(np.clip((max(traces) - 1) / 2, -1, 1)) < 1.0
        if not alike:
            kept.append(int(index))
    result = non_maximum_suppression(grasps, distance=0.03, angle=1.0)
    assert np.array_equal(result.scores, grasps.scores[kept])


def test_limit_returns_the_first_of_the_full_list():
    grasps = grasps_at([[0.05 * i, 0, 0] for i in range(6)])
    assert np.array_equal(non_maximum_suppression(grasps, limit=2).scores, grasps.scores[:2])
    assert len(non_maximum_suppression(grasps, limit=0)) == 0
