import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from icgnet.geometry.transforms import invert_transform, make_transform, random_rotation
from icgnet.grasping.grasps import Grasps


def some_grasps(count: int, seed: int = 0) -> Grasps:
    rng = np.random.default_rng(seed)
    rotations = np.stack([random_rotation(rng) for _ in range(count)]) if count else np.zeros((0, 3, 3))
    return Grasps(
        poses=make_transform(rotations, rng.uniform(0, 0.3, (count, 3))),
        widths=rng.uniform(0.01, 0.06, count),
        openings=rng.uniform(0.07, 0.08, count),
        scores=rng.uniform(size=count),
        instances=rng.integers(5, size=count),
        contacts=rng.uniform(0, 0.3, (count, 3)),
        angles=rng.integers(12, size=count),
    )


def assert_same(first: Grasps, second: Grasps, atol: float = 0.0) -> None:
    for field in ("poses", "widths", "openings", "scores", "instances", "contacts", "angles"):
        assert np.allclose(getattr(first, field), getattr(second, field), atol=atol)


def test_sorted_grasps_fall_in_score_and_keep_the_order_of_equals():
    grasps = some_grasps(6)
    grasps.scores[:] = [0.5, 0.9, 0.5, 0.1, 0.9, 0.5]
    assert np.array_equal(grasps.sorted().contacts, grasps.contacts[[1, 4, 0, 2, 5, 3]])


def test_mask_index_and_slice_select_the_same():
    grasps = some_grasps(5)
    mask = np.array([False, True, True, False, False])
    assert_same(grasps.select(mask), grasps.select(np.array([1, 2])))
    assert_same(grasps.select(mask), grasps.select(slice(1, 3)))


@given(st.integers(0, 2**32 - 1))
def test_transforming_back_and_forth_changes_nothing(seed):
    grasps = some_grasps(4, seed)
    rng = np.random.default_rng(seed)
    T = make_transform(random_rotation(rng), rng.uniform(-1, 1, 3))
    moved = grasps.transformed(T)
    assert np.allclose(moved.poses[:, :3, 3], grasps.poses[:, :3, 3] @ T[:3, :3].T + T[:3, 3])
    assert np.abs(np.linalg.det(moved.poses[:, :3, :3]) - 1).max() < 1e-9
    assert_same(moved.transformed(invert_transform(T)), grasps, atol=1e-12)


def test_parts_are_joined_in_order():
    grasps = some_grasps(5)
    parts = [grasps.select(slice(0, 2)), Grasps.empty(), grasps.select(slice(2, 5))]
    assert_same(Grasps.concatenate(parts), grasps)
    assert len(Grasps.concatenate([])) == 0


def test_empty_grasps_can_be_sorted_selected_and_moved():
    empty = Grasps.empty()
    assert len(empty.sorted().transformed(np.eye(4)).select(np.zeros(0, dtype=bool))) == 0
