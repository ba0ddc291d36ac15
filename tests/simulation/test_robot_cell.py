"""The workcell with a whole arm: here a gantry of three sliding joints, of which everything is known."""

from dataclasses import replace

import numpy as np
import pytest

from box_objects import EDGE, RADIUS, BoxAndBall, placed
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.gripper import load_gripper
from icgnet.simulation.arm import ArmModel
from icgnet.simulation.config import Physics
from icgnet.simulation.robot_cell import NO_TARGET, Command, DropBox, PickCause, RobotCell
from icgnet.simulation.scene import BACKGROUND, TABLE
from icgnet.simulation.surroundings import Surroundings, block
from icgnet.simulation.world import World

OBJECTS, FRANKA = BoxAndBall(), load_gripper()
GANTRY = ArmModel(
    T_world_base=np.eye(4),
    frames=np.stack([np.eye(4)] * 3),
    motions=np.eye(6)[:3],
    ranges=np.array([[-1.0, 1.0]] * 3),
    efforts=np.full(3, 500.0),
    parts=(),
    T_joint_grasp=np.diag([-1.0, 1.0, -1.0, 1.0]),
)
"""Joint positions are the place of the grasp frame in the world; the hand looks down."""
BOX = DropBox(centre=(0.15, 0.55))
HIGH = np.array([0.15, 0.15, 0.35])
OPEN = FRANKA.max_opening
STANDING = ("box", (0.15, 0.15, TABLE_HEIGHT + EDGE / 2))
GRASP = np.array([0.15, 0.15, TABLE_HEIGHT + EDGE / 2])


def motion(name, *points, opening=OPEN, seconds=0.6):
    return Command(name, np.linspace(0.0, seconds, len(points)), np.array(points), opening)


def phases(grasp=GRASP, height=0.35):
    """A pick at this place, carried at this height."""
    up, away = np.array([*grasp[:2], height]), np.array([*BOX.centre, height])
    return [
        motion("reach", HIGH, up, seconds=0.3),
        motion("approach", up, grasp),
        motion("close", grasp, grasp, opening=None, seconds=0.1),
        motion("lift", grasp, up, opening=None),
        motion("carry", up, away, opening=None),
        motion("release", away, away, seconds=0.1),
    ]


def cell_of(scene):
    return RobotCell(scene, OBJECTS, FRANKA, GANTRY, BOX, HIGH)


def test_joints_follow_what_they_are_told_in_time():
    world = World([], Physics(timestep=0.002), FRANKA, arm=GANTRY)
    world.arm.place(HIGH)
    errors = []
    for step in range(500):
        x = 0.15 + 0.1 * (1 - np.cos(np.pi * step / 500))
        world.arm.follow(np.array([x, 0.15, 0.35]), np.array([0.1 * np.pi * np.sin(np.pi * step / 500), 0.0, 0.0]))
        world.step()
        errors.append(np.abs(world.arm.joints() - [x, 0.15, 0.35]).max())
    assert max(errors) < 0.002
    assert world.arm.joints()[0] == pytest.approx(0.35, abs=5e-4)
    assert world.arm.last_link()[:3, 3] == pytest.approx(world.arm.joints(), abs=1e-4)


def test_fingers_are_driven_to_an_opening():
    cell = cell_of(placed(STANDING))
    cell.move(motion("reach", HIGH, HIGH, opening=0.03))
    assert cell._world.hand.opening() == pytest.approx(0.03, abs=0.001)
    assert cell.hand_pose()[:3, 3] == pytest.approx(HIGH, abs=1e-3)


def test_an_object_comes_into_the_box_and_out_of_the_scene():
    cell = cell_of(placed(STANDING, ("ball", (0.05, 0.05, TABLE_HEIGHT + RADIUS))))
    result = cell.pick(phases(), 0)
    assert result.success
    assert result.carried
    assert (result.removed, result.lost, result.displaced, result.touched, result.hit) == ((0,), (), (), (), ())
    assert cell.remaining.tolist() == [1]
    assert [each.name for each in cell.scene().objects] == ["ball"]
    assert 2.3 < result.seconds < 4.0
    assert 0.0 < result.tracking < 0.03  # the gantry is told to move at once, and to stop at once


def test_a_hand_that_closes_beside_the_object_misses_it():
    cell = cell_of(placed(STANDING))
    result = cell.pick(phases(GRASP + [0.0, 0.0, 0.15]), 0)
    assert (result.cause, result.carried, result.removed) == (PickCause.MISSED, False, ())
    # It stops there and goes back as it came, and not on to the box.
    assert cell.joints() == pytest.approx(HIGH, abs=2e-3)
    assert result.seconds < 2.6  # 1.0 s to the grasp, closing, 0.9 s back; the whole pick takes 3 s
    assert cell.pick(phases(), 0).success


def test_what_a_hand_touches_of_a_wall_is_told_also_on_its_way_back():
    wall = block("wall", (0.02, 0.3, 0.2), make_transform(np.eye(3), np.array([0.28, 0.15, TABLE_HEIGHT + 0.1])))
    scene = replace(placed(STANDING), surroundings=Surroundings(structures=(wall,)))
    aside = np.array([0.25, 0.05, 0.2])
    sweep = motion("reach", HIGH, [0.25, 0.05, 0.35], aside, [0.29, 0.05, 0.2], aside, [0.25, 0.05, 0.35], HIGH)
    result = cell_of(scene).pick([replace(sweep, times=4 * sweep.times), *phases()], 0)
    assert BACKGROUND in result.touched
    assert cell_of(scene).pick(phases(), 0).touched == ()


def test_what_is_for_no_object_is_missed_but_what_comes_into_the_box_is_counted():
    result = cell_of(placed(STANDING)).pick(phases(), NO_TARGET)
    assert not result.success
    assert result.removed == (0,)
    assert 0 in result.touched


def test_an_object_that_is_let_go_of_on_the_way_is_lost_there():
    steps = phases()
    steps[4] = replace(steps[4], opening=OPEN)  # opens while it carries
    result = cell_of(placed(STANDING)).pick(steps, 0)
    assert (result.cause, result.carried) == (PickCause.LOST_CARRYING, True)


def test_an_object_that_the_hand_does_not_let_go_of_is_stuck_in_it():
    steps = phases()
    steps[5] = replace(steps[5], opening=0.05)  # narrower than the box: it opens hardly at all
    result = cell_of(placed(STANDING)).pick(steps, 0)
    assert (result.cause, result.carried, result.removed) == (PickCause.STUCK, True, ())


def test_a_carried_object_that_meets_a_wall_has_hit_it():
    wall = block("wall", (0.3, 0.02, 0.22), make_transform(np.eye(3), np.array([0.15, 0.30, TABLE_HEIGHT + 0.11])))
    scene = replace(placed(STANDING), surroundings=Surroundings(structures=(wall,)))
    result = cell_of(scene).pick(phases(height=0.28), 0)
    assert BACKGROUND in result.hit
    assert result.hit_force > 1.0
    free = cell_of(scene).pick(phases(height=0.35), 0)
    assert (free.hit, free.success) == ((), True)


def test_the_table_that_an_object_stood_on_is_not_hit_by_it():
    result = cell_of(placed(STANDING)).pick(phases(), 0)
    assert TABLE not in result.hit


def test_a_neighbour_that_is_pushed_aside_is_touched_and_displaced():
    ball = ("ball", (0.18, 0.05, TABLE_HEIGHT + RADIUS))
    low = np.array([0.25, 0.05, TABLE_HEIGHT + 0.02])
    sweep = motion("reach", HIGH, [0.25, 0.05, 0.35], low, low - [0.08, 0.0, 0.0], HIGH, opening=0.01, seconds=2.0)
    result = cell_of(placed(STANDING, ball)).pick([sweep, *phases()], 0)
    assert 1 in result.touched
    assert 1 in (*result.displaced, *result.lost)
    assert 0 not in result.displaced


def test_the_box_holds_what_is_between_its_walls():
    x, y = BOX.centre
    inside = BOX.holds(np.array([[x, y, 0.08], [x + 0.14, y - 0.14, 0.1], [x, y, 0.3], [x + 0.2, y, 0.08]]))
    assert inside.tolist() == [True, True, False, False]
    assert len(BOX.structures()) == 5
