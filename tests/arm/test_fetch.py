"""Fetching: the order of the fewest picks, and what is said to be in the way."""

import pytest

import needs_arm  # noqa: F401
from arm_scenes import DROP, T_BASE_FRAME, box
from icgnet.arm.fetch import plan_fetch, shortest_order, ways_to_take
from icgnet.errors import InputError

CUBOID = (0.05, 0.04, 0.10)
FREE = frozenset()


def sets(*names: int) -> frozenset[int]:
    return frozenset(names)


def test_what_is_free_is_taken_at_once():
    assert shortest_order({0: [FREE], 1: [FREE]}, 0) == (0,)


def test_of_several_ways_the_one_with_the_fewest_picks_is_taken():
    # Either 1 and 2 must go, or 3 alone.
    ways = {0: [sets(1, 2), sets(3)], 1: [FREE], 2: [FREE], 3: [FREE]}
    assert shortest_order(ways, 0) == (3, 0)


def test_what_blocks_may_be_blocked_itself_and_then_more_picks_can_be_fewer():
    # 3 alone would do, but 4 and 5 lie on it.
    ways = {0: [sets(1, 2), sets(3)], 1: [FREE], 2: [FREE], 3: [sets(4, 5)], 4: [FREE], 5: [FREE]}
    assert shortest_order(ways, 0) == (1, 2, 0)
    assert shortest_order(ways | {2: [sets(1)]}, 0) == (1, 2, 0)


def test_one_that_blocks_twice_is_taken_once():
    ways = {0: [sets(1, 2)], 1: [sets(2)], 2: [FREE]}
    assert shortest_order(ways, 0) == (2, 1, 0)


@pytest.mark.parametrize("ways", [{0: []}, {}, {0: [sets(1)], 1: [sets(0)]}, {0: [sets(7)]}])
def test_where_no_order_leads_there_is_none(ways):
    assert shortest_order(ways, 0) == ()


def test_what_lies_on_the_target_goes_first_and_the_reason_is_told(fr3, seen):
    # A plate on the target: the hand would come through it from above.
    meshes = [box(CUBOID), box((0.12, 0.03, 0.02), z=0.05 + 0.10 + 0.01)]
    fetch = plan_fetch(seen(meshes, grasped=(0, 1), width=0.03), fr3, T_BASE_FRAME, DROP, 0)
    assert fetch.order == (1, 0)
    assert fetch.reasons == {1: "is in the way of the hand at object 0"}
    assert fetch.pick.instance == 1


def test_a_neighbour_where_the_fingers_should_be_goes_first(fr3, seen):
    meshes = [box(CUBOID), box(CUBOID, y=0.194)]
    prediction = seen(meshes, grasped=(0, 1))
    ways = ways_to_take(prediction, fr3, T_BASE_FRAME)
    assert [way.blockers for way in ways[0]] == [sets(1)]
    # The neighbour is in the same place.
    assert [way.blockers for way in ways[1]] == [sets(0)]
    assert plan_fetch(prediction, fr3, T_BASE_FRAME, DROP, 0).order == ()


def test_what_lies_on_the_end_of_the_target_goes_first_though_no_hand_comes_there(fr3, seen):
    # A long bar with a block on its end, far from the hand at its middle.
    meshes = [box((0.30, 0.04, 0.05)), box((0.03, 0.04, 0.05), x=0.28, z=0.05 + 0.05 + 0.025)]
    prediction = seen(meshes, grasped=(0, 1))
    ways = ways_to_take(prediction, fr3, T_BASE_FRAME)
    assert [dict(way.reasons) for way in ways[0]] == [{1: "lies on or over"}]
    fetch = plan_fetch(prediction, fr3, T_BASE_FRAME, DROP, 0)
    assert fetch.order == (1, 0)


def test_a_free_target_is_picked_whatever_else_is_higher(fr3, seen):
    meshes = [box(CUBOID), box((0.05, 0.04, 0.2), x=0.25, y=0.25)]
    fetch = plan_fetch(seen(meshes, grasped=(1, 0)), fr3, T_BASE_FRAME, DROP, 0)
    assert (fetch.order, fetch.reasons) == ((0,), {})
    assert fetch.pick.is_found
    assert fetch.pick.instance == 0


def test_without_grasps_there_is_no_order_and_no_plan(fr3, seen):
    fetch = plan_fetch(seen([box(CUBOID), box(CUBOID, x=0.25)], grasped=(1,)), fr3, T_BASE_FRAME, DROP, 0)
    assert fetch.order == ()
    assert not fetch.pick.is_found


def test_an_object_that_is_not_there_is_refused(fr3, seen):
    with pytest.raises(InputError, match="no object 5"):
        plan_fetch(seen([box(CUBOID)]), fr3, T_BASE_FRAME, DROP, 5)
