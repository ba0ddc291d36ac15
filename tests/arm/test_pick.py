"""Picks from scenes of which everything is known."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

import needs_arm  # noqa: F401
from arm_scenes import DROP, T_BASE_FRAME, box
from icgnet.arm.arm import Arm
from icgnet.arm.bodies import CollisionBody
from icgnet.arm.pick import DEVIATIONS, NO_REACH, _Planner, checked_phase, plan_pick
from icgnet.arm.replay import replay
from icgnet.arm.scene import CARRIED, CollisionChecker, Load
from icgnet.arm.settings import PickSettings
from icgnet.arm.timing import NoTrajectoryError, Timing, still
from icgnet.errors import InputError
from icgnet.geometry.transforms import invert_transform, make_transform, rotation_z, transform_points

CUBOID = (0.05, 0.04, 0.10)


@pytest.fixture(scope="module")
def plain(fr3, seen):
    """A pick of the one box among three that a grasp is for."""
    meshes = [box(CUBOID), box(CUBOID, y=0.26), box(CUBOID, x=0.24)]
    return plan_pick(seen(meshes), fr3, T_BASE_FRAME, DROP, PickSettings(clearances=True))


def carried_at(plan, arm, joints):
    """Where the carried object is at joint positions after it was gripped."""
    load = next(phase.load for phase in plan.phases if phase.name == "carry")
    moved = arm.grasp_pose(joints, plan.gripper) @ invert_transform(load.T_base_gripped)
    return load.carried.mesh.copy().apply_transform(moved)


def test_all_phases_follow_each_other_from_home_to_home(fr3, plain):
    names = [phase.name for phase in plain.phases]
    assert names == ["reach", "approach", "close", "lift", "carry", "release", "return"]
    assert plain.instance == 0
    assert plain.grasp == 0
    assert plain.refusals == ()
    np.testing.assert_allclose(plain.phases[0].trajectory.positions[0], fr3.home, atol=1e-9)
    np.testing.assert_allclose(plain.phases[-1].trajectory.positions[-1], fr3.home, atol=1e-9)
    assert [round(phase.opening, 3) for phase in plain.phases] == [0.052, 0.052, 0.04, 0.04, 0.04, 0.08, 0.08]
    assert [phase.moves_fingers for phase in plain.phases] == [name in ("close", "release") for name in names]


def test_a_plan_keeps_what_it_promises(fr3, plain):
    result = replay(plain, fr3)
    assert result.is_kept, result
    assert result.depth == 0.0
    assert result.steps > 2000
    assert {phase.name: phase.margin for phase in plain.phases}["carry"] == 0.005


def test_the_hand_is_at_the_grasp_and_goes_up_straight(fr3, seen, plain):
    approach, lift = plain.phases[1].trajectory.positions, plain.phases[3].trajectory.positions
    T_base_grasp = fr3.grasp_pose(approach[-1], plain.gripper)
    wanted = T_BASE_FRAME @ seen([box(CUBOID)]).grasps.poses[0]
    np.testing.assert_allclose(T_base_grasp[:3, 3], wanted[:3, 3], atol=1e-4)
    np.testing.assert_allclose(T_base_grasp[:3, 2], wanted[:3, 2], atol=1e-3)
    assert abs(T_base_grasp[:3, 1] @ wanted[:3, 1]) == pytest.approx(1.0, abs=1e-6)  # or turned by 180 degrees
    before = fr3.grasp_pose(approach[0], plain.gripper)[:3, 3]
    assert np.linalg.norm(before - T_base_grasp[:3, 3]) >= 0.06 - 1e-4
    up = fr3.grasp_pose(lift[-1], plain.gripper)[:3, 3] - T_base_grasp[:3, 3]
    assert up[2] >= 0.10 - 1e-4
    np.testing.assert_allclose(up[:2], 0.0, atol=1e-3)


def test_the_object_is_over_the_drop_off(fr3, plain):
    mesh = carried_at(plain, fr3, plain.phases[4].trajectory.positions[-1])
    lower, upper = mesh.bounds
    np.testing.assert_allclose((lower + upper)[:2] / 2, DROP[:2], atol=1e-3)
    assert lower[2] == pytest.approx(DROP[2], abs=1e-3)


def test_clearances_are_those_of_the_whole_phase(fr3, plain):
    carry = plain.phases[4]
    checker = CollisionChecker(fr3, plain.gripper, plain.bodies, carry.load)
    path = carry.trajectory.at(np.linspace(0.0, carry.trajectory.duration, 200))
    assert checker.first_collision(path, max(0.0, carry.clearance - 0.006)) is None


def test_a_placed_object_stands_where_it_was_asked_for(fr3, seen):
    place = np.array([0.35, 0.35, 0.0])
    plan = plan_pick(seen([box(CUBOID)]), fr3, T_BASE_FRAME, place, PickSettings(release="place"))
    names = [phase.name for phase in plan.phases]
    assert names == ["reach", "approach", "close", "lift", "carry", "lower", "release", "leave", "return"]
    assert replay(plan, fr3).is_kept
    mesh = carried_at(plan, fr3, plan.phases[5].trajectory.positions[-1])
    np.testing.assert_allclose((mesh.bounds[0] + mesh.bounds[1])[:2] / 2, place[:2], atol=1e-3)
    assert mesh.bounds[0, 2] == pytest.approx(0.002, abs=5e-4)
    (left,) = plan.phases[-1].extra
    np.testing.assert_allclose(left.mesh.bounds, mesh.bounds, atol=1e-3)


def on_table(prediction, lower, upper):
    """The same prediction with the table measured in a rectangle."""
    x, y = np.meshgrid(np.linspace(lower[0], upper[0], 30), np.linspace(lower[1], upper[1], 30))
    points = np.concatenate([prediction.cloud.points, np.stack([x, y, np.full_like(x, 0.05)], axis=-1).reshape(-1, 3)])
    return replace(
        prediction,
        cloud=replace(prediction.cloud, points=points),
        cloud_instances=np.concatenate([prediction.cloud_instances, np.full(x.size, -1)]),
        input_rows=np.arange(len(points)),
        input_shape=(len(points),),
    )


def test_an_object_falls_into_a_box_beside_the_table_that_stands_lower(fr3, seen):
    scene, box_beside = on_table(seen([box(CUBOID)]), (-0.1, -0.1), (0.4, 0.4)), np.array([0.3, 0.4, -0.25])
    plan = plan_pick(scene, fr3, T_BASE_FRAME, box_beside, PickSettings(drop_above=0.08))
    mesh = carried_at(plan, fr3, plan.phases[4].trajectory.positions[-1])
    lower, upper = mesh.bounds
    np.testing.assert_allclose((lower + upper)[:2] / 2, box_beside[:2], atol=1e-3)
    assert lower[2] == pytest.approx(0.08, abs=1e-3)
    assert replay(plan, fr3).is_kept


def test_a_drop_off_inside_of_the_table_is_refused_however_high_the_object_falls_from(fr3, seen):
    scene = on_table(seen([box(CUBOID)]), (-0.1, -0.1), (0.4, 0.8))
    with pytest.raises(InputError, match=r"it is 0\.250 m below it, and not beside what is seen of it"):
        plan_pick(scene, fr3, T_BASE_FRAME, np.array([0.3, 0.4, -0.25]), PickSettings(drop_above=0.08))


def test_the_same_seed_gives_the_same_plan(fr3, seen, plain):
    meshes = [box(CUBOID), box(CUBOID, y=0.26), box(CUBOID, x=0.24)]
    again = plan_pick(seen(meshes), fr3, T_BASE_FRAME, DROP)
    for first, second in zip(plain.phases, again.phases, strict=True):
        np.testing.assert_array_equal(first.trajectory.positions, second.trajectory.positions)


def test_another_frame_gives_the_same_plan(fr3, seen, plain):
    meshes = [box(CUBOID), box(CUBOID, y=0.26), box(CUBOID, x=0.24)]
    T_frame_table = make_transform(rotation_z(0.7), np.array([0.1, -0.2, 0.3]))
    prediction = seen(meshes)
    moved = replace(
        prediction,
        objects=tuple(
            replace(item, extract=lambda mesh=mesh: mesh.copy().apply_transform(T_frame_table))
            for item, mesh in zip(prediction.objects, meshes, strict=True)
        ),
        grasps=prediction.grasps.transformed(T_frame_table),
        T_frame_table=T_frame_table,
    )
    plan = plan_pick(moved, fr3, T_BASE_FRAME @ invert_transform(T_frame_table), DROP)
    last = [each.phases[1].trajectory.positions[-1] for each in (plain, plan)]
    np.testing.assert_allclose(*last, atol=1e-3)


def test_grasps_out_of_reach_are_refused_and_the_next_one_is_taken(fr3, seen):
    meshes = [box(CUBOID, x=1.2), box(CUBOID)]
    plan = plan_pick(seen(meshes, grasped=(0, 1)), fr3, T_BASE_FRAME, DROP)
    assert plan.instance == 1
    assert plan.refused == {"no joint positions": 1}
    assert [(each.grasp, each.instance) for each in plan.refusals] == [(0, 0)]


def test_a_hand_between_neighbours_is_refused_with_the_neighbour(fr3, seen):
    # 4 mm on either side of the target: no finger fits there.
    meshes = [box(CUBOID), box(CUBOID, y=0.194)]
    plan = plan_pick(seen(meshes), fr3, T_BASE_FRAME, DROP)
    assert not plan.is_found
    assert plan.refused == {"hand meets object 1": 1}
    assert plan.duration == 0


def test_an_arm_that_would_meet_a_tall_neighbour_is_refused_with_its_part(fr3, seen):
    # A board over the target, with room for the fingers but not for the arm.
    board = box((0.3, 0.3, 0.02), z=0.05 + 0.10 + 0.16)
    plan = plan_pick(seen([box(CUBOID), board]), fr3, T_BASE_FRAME, DROP)
    assert not plan.is_found
    (reason,) = plan.refused
    assert reason.endswith("meets object 1")
    assert reason.startswith("fr3_link") or reason.startswith("hand")


def test_a_carried_object_that_hits_is_refused_only_if_it_is_checked(fr3, seen):
    # A long bar whose ends lie under two shelves, with the hand between them.
    bar = box((0.34, 0.04, 0.03))
    shelves = [box((0.06, 0.2, 0.01), x=0.15 + side * 0.15, z=0.12) for side in (-1, 1)]
    prediction = seen([bar, *shelves])
    refused = plan_pick(prediction, fr3, T_BASE_FRAME, DROP)
    assert not refused.is_found
    assert next(iter(refused.refused)).startswith(f"{CARRIED} meets object ")
    plan = plan_pick(prediction, fr3, T_BASE_FRAME, DROP, PickSettings(check_carried=False))
    assert plan.is_found
    assert all(phase.load.carried is None for phase in plan.phases)


def test_an_object_may_part_from_a_neighbour_that_it_leans_on(fr3, seen):
    meshes = [box(CUBOID), box((0.04, 0.04, 0.06), x=0.194)]  # 1 mm inside of the target
    plan = plan_pick(seen(meshes), fr3, T_BASE_FRAME, DROP)
    assert plan.is_found
    assert {each.body for each in plan.phases[3].load.untested} == {"support", "object 1"}


def test_what_lies_on_an_object_is_not_lifted_with_it(fr3, seen):
    # A plate on the end of a bar, which touches it already; above it is nothing.
    bar, plate = box((0.30, 0.04, 0.05)), box((0.05, 0.05, 0.01), x=0.28, z=0.05 + 0.05 + 0.005)
    plan = plan_pick(seen([bar, plate]), fr3, T_BASE_FRAME, DROP)
    assert plan.refused == {f"{CARRIED} meets object 1": 1}
    beside = plan_pick(seen([bar, plate.copy().apply_translation([0.06, 0, -0.05])]), fr3, T_BASE_FRAME, DROP)
    assert beside.is_found


def test_a_way_without_a_trajectory_is_tried_with_other_corners_and_then_refused(fr3, seen, monkeypatch):
    along, asked = Timing.along, []

    def failing(self, path, deviation, speed=1.0):
        asked.append(deviation)
        if deviation > worst:
            raise NoTrajectoryError("none")
        return along(self, path, deviation, speed)

    monkeypatch.setattr(Timing, "along", failing)
    worst = DEVIATIONS[1]
    assert plan_pick(seen([box(CUBOID)]), fr3, T_BASE_FRAME, DROP).is_found
    assert DEVIATIONS[0] in asked
    worst = -1.0
    assert plan_pick(seen([box(CUBOID)]), fr3, T_BASE_FRAME, DROP).refused == {NO_REACH: 1}


def test_what_hand_and_object_meet_with_any_joints_is_not_asked_with_all_of_them(fr3, seen, monkeypatch):
    bar, plate = box((0.30, 0.04, 0.05)), box((0.05, 0.05, 0.01), x=0.28, z=0.05 + 0.05 + 0.005)
    lines, asked = _Planner._lines, []
    monkeypatch.setattr(_Planner, "_lines", lambda self, *given: asked.append(given) or lines(self, *given))
    plan = plan_pick(seen([bar, plate]), fr3, T_BASE_FRAME, DROP)
    assert plan.refused == {f"{CARRIED} meets object 1": 1}
    assert len(asked) == 2, "once for the hand as it is, once for the hand turned by half a turn"


def test_the_carried_object_keeps_its_margin_once_it_has_left_its_neighbours(fr3, seen):
    meshes = [box(CUBOID), box((0.04, 0.04, 0.06), x=0.197), box((0.06, 0.2, 0.01), x=0.25, z=0.20)]
    plan = plan_pick(seen(meshes), fr3, T_BASE_FRAME, DROP)  # a neighbour 2 mm away, a shelf that is passed by 45 mm
    lift = plan.phases[3]
    assert {each.body for each in lift.load.untested} == {"support"}
    assert {each.body for each in lift.load.unpadded} == {"support", "object 1"}
    bare = CollisionChecker(fr3, plan.gripper, plan.bodies, replace(plan.phases[4].load, padding=0.0))
    for phase, kept in ((lift, 0.0), (plan.phases[4], 0.0085)):
        path = phase.trajectory.at(np.linspace(0.0, phase.trajectory.duration, 100))
        met = [bare.meetings(joints, kept) for joints in path]
        assert not any(each.part == CARRIED and each.body != "support" for meetings in met for each in meetings)


def test_an_object_of_which_nothing_is_known_is_refused(fr3, seen):
    prediction = seen([box(CUBOID), box(CUBOID, x=0.24)], grasped=(0, 1))
    empty = replace(prediction.objects[0], extract=trimesh.Trimesh, points=np.zeros((0, 3)))
    plan = plan_pick(replace(prediction, objects=(empty, prediction.objects[1])), fr3, T_BASE_FRAME, DROP)
    assert plan.refused == {"neither shape nor points": 1}
    assert plan.instance == 1


def test_an_arm_that_leans_lifts_and_lets_go_by_the_vertical(fr3, seen):
    T_base_frame = make_transform(Rotation.from_rotvec([0.0, 0.3, 0.0]).as_matrix(), np.zeros(3)) @ T_BASE_FRAME
    arm = Arm(replace(fr3.description, T_world_base=invert_transform(T_base_frame)))
    drop = np.array([-0.05, 0.55, 0.20])
    plan = plan_pick(seen([box(CUBOID)]), arm, T_base_frame, transform_points(T_base_frame, drop[None])[0])
    lift = [
        T_world @ np.append(arm.grasp_pose(q, plan.gripper)[:3, 3], 1.0)
        for q in plan.phases[3].trajectory.positions[[0, -1]]
        for T_world in [arm.description.T_world_base]
    ]
    np.testing.assert_allclose((lift[1] - lift[0])[:2], 0.0, atol=1e-3)
    assert (lift[1] - lift[0])[2] >= 0.10 - 1e-4
    mesh = carried_at(plan, arm, plan.phases[4].trajectory.positions[-1]).apply_transform(arm.description.T_world_base)
    np.testing.assert_allclose([*mesh.bounds.mean(axis=0)[:2], mesh.bounds[0, 2]], drop, atol=1e-3)


def test_joints_outside_of_their_limits_make_no_phase(fr3, hand):
    load = Load(0.08, 0.08)
    checker = CollisionChecker(fr3, hand, [], load)
    outside = fr3.home.copy()
    outside[0] = fr3.upper[0] + 0.1
    assert not checker.collides(outside)
    assert checked_phase("still", still(outside, 1.0), load, checker, 0.0) is None
    assert checked_phase("still", still(fr3.home, 1.0), load, checker, 0.0) is not None


def test_a_hand_between_neighbours_of_the_place_opens_no_wider_than_it_came(fr3, seen):
    # Walls all around beside the fingers of a hand that is open by 52 mm, but not by 80.
    place, wall = np.array([0.35, 0.35, 0.0]), trimesh.creation.box((0.05, 0.01, 0.11))
    fixtures = []
    for angle in np.arange(8) * np.pi / 4:
        turned = make_transform(rotation_z(angle), place + [0, 0, 0.055])
        shifted = wall.copy().apply_translation([0, 0.057, 0]).apply_transform(turned)
        fixtures.append(CollisionBody(f"wall {len(fixtures)}", shifted))
    settings = PickSettings(release="place", carried_margin=0.0)
    plan = plan_pick(seen([box((0.04, 0.04, 0.10))]), fr3, T_BASE_FRAME, place, settings, fixtures=fixtures)
    assert plan.phases[6].opening == pytest.approx(0.052)
    assert replay(plan, fr3).is_kept


def test_measured_points_may_take_the_place_of_shapes(fr3, seen):
    meshes = [box(CUBOID), box(CUBOID, y=0.26)]
    plan = plan_pick(seen(meshes), fr3, T_BASE_FRAME, DROP, PickSettings(obstacles="points"))
    assert plan.is_found
    assert all(body.from_points for body in plan.bodies if body.name != "support")
    assert replay(plan, fr3).is_kept


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"drop": [0.3, 0.4, -0.02]}, "drop must be above the support, but it is 0.020 m below it"),
        ({"drop": [0.3, 0.4]}, "drop must have shape"),
        ({"drop": [0.3, 3.0, 0.2]}, "drop is 3.02 m from the first joint of the arm"),
        ({"T_base_frame": np.diag([1.0, 1.0, -1.0, 1.0])}, "T_base_frame must be right-handed"),
        ({"T_base_frame": make_transform(np.eye(3), np.array([350.0, -150.0, 0.0])) * 10}, "T_base_frame"),
        ({"start": np.zeros(7)}, "start: fr3_joint"),
        ({"start": [0.0, 1.2, 0.0, -1.2, 0.0, 2.0, 0.78]}, "start: the arm must be at least 0.005 m from everything"),
    ],
)
def test_wrong_input_is_one_line(fr3, seen, changes, message):
    given = {"T_base_frame": T_BASE_FRAME, "drop": DROP, "start": None} | changes
    with pytest.raises(InputError) as error:
        plan_pick(seen([box(CUBOID)]), fr3, given["T_base_frame"], given["drop"], start=given["start"])
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"margin": 0.0}, "margin must be at least 0.001"),
        ({"carried_margin": 0.05}, "carried_margin must be at least 0 and at most 0.02"),
        ({"lift": 0.5}, "lift must be at least 0.02 and at most 0.2"),
        ({"speed": 0.0}, "speed must be at least 0.01"),
        ({"drop_above": -0.1}, "drop_above must be at least 0 and at most 1"),
        ({"drop_above": 0.1, "release": "place"}, "drop_above is for release drop"),
    ],
)
def test_wrong_settings_are_refused(values, message):
    with pytest.raises(InputError, match=message):
        PickSettings(**values)


def test_what_always_stands_there_is_kept_clear_of_like_anything_else(fr3, seen):
    around = box((0.3, 0.3, 0.3)).apply_translation(T_BASE_FRAME[:3, 3])
    place = around.centroid + [0.0, 0.35, -0.1]
    fixture = CollisionBody("drop-off box", around.copy().apply_translation([0.0, 0.35, 0.0]))
    free = plan_pick(seen([box(CUBOID)]), fr3, T_BASE_FRAME, place)
    blocked = plan_pick(seen([box(CUBOID)]), fr3, T_BASE_FRAME, place, fixtures=(fixture,))
    assert free.is_found
    assert not blocked.is_found
    assert "drop-off box" in next(iter(blocked.refused))


def test_a_plan_without_measured_clearances_is_the_same_and_keeps_its_margin(fr3, seen, plain):
    meshes = [box(CUBOID), box(CUBOID, y=0.26), box(CUBOID, x=0.24)]
    plan = plan_pick(seen(meshes), fr3, T_BASE_FRAME, DROP)
    for first, second in zip(plain.phases, plan.phases, strict=True):
        np.testing.assert_array_equal(first.trajectory.positions, second.trajectory.positions)
        assert (second.clearance, second.nearest) == (None, None)
        assert second.caption == second.name
    assert replay(plan, fr3).is_kept
