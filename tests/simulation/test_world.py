import numpy as np
import pytest

from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform
from icgnet.simulation.config import Physics
from icgnet.simulation.world import World


def _state(world):
    return np.concatenate([world.data.qpos, world.data.qvel, world.data.qacc_warmstart, [world.data.time]])


def test_a_box_on_the_table_stays_where_it_is(standing_box):
    world = World([standing_box(0.05, 0.06, 0.1)], Physics())
    before = world.object_poses()
    world.step(500)
    np.testing.assert_allclose(world.object_poses(), before, atol=2e-4)


def test_a_stack_of_boxes_does_not_creep(standing_box, box):
    lower, upper = standing_box(0.08, 0.08, 0.04), standing_box(0.06, 0.06, 0.04)
    upper.T_world_object[2, 3] += 0.04
    world = World([lower, upper], Physics())
    world.step(125)
    before = world.object_positions()
    world.step(500)
    assert np.abs(world.object_positions() - before).max() < 5e-4


def test_restore_repeats_the_same_motion_bit_for_bit(standing_box, gripper):
    world = World(
        [standing_box(0.05, 0.05, 0.1), standing_box(0.04, 0.04, 0.1, x=0.21)], Physics(), gripper, asleep=True
    )
    start = world.snapshot()

    def push(y):
        world.restore(start)
        world.hand.place(make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.15, 0.15 + y, 0.11])), 0.08)
        world.hand.squeeze(20.0)
        for step in range(40):
            world.hand.move_to(np.array([0.15, 0.15 + y, 0.11 + 0.002 * step]))
            world.step()
        return _state(world)

    first = push(0.01)
    other = push(0.02)
    assert not np.array_equal(first, other)
    assert np.array_equal(first, push(0.01))


def test_restore_brings_back_what_was_parked(standing_box):
    world = World([standing_box(0.05, 0.05, 0.1), standing_box(0.05, 0.05, 0.1, x=0.22)], Physics())
    start, poses = world.snapshot(), world.object_poses()
    world.park(0)
    world.step(50)
    world.restore(start)
    assert world.present.all()
    np.testing.assert_array_equal(world.object_poses(), poses)
    world.step(250)
    np.testing.assert_allclose(world.object_poses(), poses, atol=2e-4)


def test_parked_objects_do_not_move_and_touch_nothing(standing_box):
    world = World([standing_box(0.05, 0.05, 0.1), standing_box(0.05, 0.05, 0.1)], Physics())
    world.park(1)
    world.step()
    parked = world.object_positions()[1]
    world.step(250)
    np.testing.assert_array_equal(world.object_positions()[1], parked)
    np.testing.assert_allclose(world.object_positions()[0], [0.15, 0.15, 0.1], atol=2e-4)
    assert world.speeds()[1] == 0.0


def test_sleeping_objects_stay_exactly_in_place_until_touched(standing_box, gripper):
    body = standing_box(0.05, 0.05, 0.1)
    body.T_world_object[2, 3] += 0.01
    world = World([body], Physics(), gripper, asleep=True)
    before = world.object_poses()
    world.step(50)
    np.testing.assert_array_equal(world.object_poses(), before)
    world.hand.place(make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.15, 0.15, 0.13])), 0.06)
    world.hand.squeeze(20.0)
    world.step(50)
    assert np.abs(world.object_poses() - before).max() > 1e-5


@pytest.mark.parametrize(("gap", "touches"), [(0.0015, True), (0.004, False)])
def test_objects_nearer_than_the_margin_touch(standing_box, gap, touches):
    world = World([standing_box(0.05, 0.05, 0.1, x=0.1), standing_box(0.05, 0.05, 0.1, x=0.15 + gap)], Physics())
    pose = world.object_poses()[1]
    pose[2, 3] += 0.02
    world.place(1, pose)
    assert world.touches_anything(1, margin=0.002) == touches


def test_objects_cannot_leave_the_drop_box(standing_box):
    world = World([standing_box(0.05, 0.05, 0.05)], Physics(), drop_box=True)
    world.data.qvel[0] = 3.0
    world.step(250)
    assert world.object_positions()[0, 0] < 0.2761 - 0.02
    world.remove_drop_box()
    world.data.qvel[0] = 3.0
    world.step(100)
    assert world.object_positions()[0, 0] > 0.3


@pytest.mark.parametrize("settings", [{"timestep": 0.01}, {"timestep": 0.0}, {"object_mass": 0.0}])
def test_physics_settings_out_of_range_are_refused(settings):
    with pytest.raises(InputError, match=next(iter(settings))):
        Physics(**settings)
