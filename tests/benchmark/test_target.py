"""Grasping one named object: how much of it is hidden, which bins are filled, and what counts as a success."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from box_objects import EDGE, RADIUS, BoxAndBall, placed, predicted
from icgnet.benchmark import rounds, target
from icgnet.benchmark.config import NOTHING_FOUND, TargetConfig
from icgnet.benchmark.observation import Observation, sense
from icgnet.benchmark.planner import Plan
from icgnet.benchmark.planners.antipodal import AntipodalPlanner
from icgnet.benchmark.planners.chance import RandomPlanner
from icgnet.benchmark.planners.icgnet import wanted_grasps
from icgnet.benchmark.planners.oracle import OraclePlanner
from icgnet.benchmark.target import TargetAttempt, draw_targets, measure, occlusions, summarise
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.errors import InputError
from icgnet.geometry.camera import DEFAULT_INTRINSICS, DEFAULT_SHAPE, sphere_pose
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.grasps import Grasps
from icgnet.grasping.gripper import load_gripper
from icgnet.sensors.wide import Picture
from icgnet.simulation.camera import SceneRenderer
from icgnet.simulation.scene import Scene, scene_triangles
from icgnet.simulation.trials import Outcome, Trials
from icgnet.simulation.workcell import PROTOCOLS, Cause, Workcell

OBJECTS, FRANKA = BoxAndBall(), load_gripper()
HEIGHT = TABLE_HEIGHT + EDGE / 2
APART = placed(("box", (0.07, 0.15, HEIGHT)), ("ball", (0.23, 0.15, TABLE_HEIGHT + RADIUS)))


def picture_of(scene: Scene, polar_deg: float, azimuth_deg: float, distance: float = 0.7) -> Picture:
    """A picture by a camera that looks at the middle of what stands there."""
    pose = sphere_pose(
        np.array([0.15, 0.15, HEIGHT]), distance, float(np.deg2rad(polar_deg)), float(np.deg2rad(azimuth_deg))
    )
    renderer = SceneRenderer(*scene_triangles(scene, OBJECTS))
    return Picture(renderer.render(DEFAULT_INTRINSICS, DEFAULT_SHAPE, pose), DEFAULT_INTRINSICS, pose)


def look(scene: Scene, index: int) -> Observation:
    """Without noise, from above and aside, with the mask and the truth of one object."""
    picture = picture_of(scene, 30.0, 90.0)
    seen = sense(picture, False, "none", FRANKA, False, np.random.default_rng(0))
    return replace(seen, target=picture.image.ids == index, truth=TrueShapes(scene, OBJECTS, index))


def test_what_stands_alone_is_not_hidden():
    scene = placed(("box", (0.15, 0.15, HEIGHT)))
    assert occlusions(picture_of(scene, 45.0, 10.0), scene, OBJECTS) == pytest.approx([0.0], abs=0.01)


def test_half_of_a_box_is_hidden_behind_another_that_is_moved_aside_by_half_an_edge():
    """From far away and from the side, so that both boxes are squares."""
    scene = placed(("box", (0.15, 0.20, HEIGHT)), ("box", (0.15 + EDGE / 2, 0.10, HEIGHT)))
    hidden = occlusions(picture_of(scene, 89.0, -90.0, distance=1.5), scene, OBJECTS)
    assert hidden == pytest.approx([0.5, 0.0], abs=0.06)


def test_what_is_small_in_the_picture_is_no_target(monkeypatch):
    monkeypatch.setattr(target, "FEWEST_PIXELS", 10**6)
    assert np.isnan(occlusions(picture_of(APART, 30.0, 90.0), APART, OBJECTS)).all()


def test_one_target_is_drawn_in_every_bin():
    hidden = np.array([0.05, 0.02, 0.3, 0.55, 0.95, np.nan])
    drawn = [draw_targets(hidden, lambda index: True, np.random.default_rng(seed)) for seed in range(20)]
    assert all(each[1:] == [2, 3] for each in drawn)
    assert {each[0] for each in drawn} == {0, 1}


def test_what_may_be_no_target_is_replaced_by_the_next_of_its_bin_and_nothing_else_is_asked_for():
    hidden, asked = np.array([0.05, 0.02, 0.08, 0.3]), []

    def only_the_ball(index: int) -> bool:
        asked.append(index)
        return index == 1

    for seed in range(8):
        asked.clear()
        assert draw_targets(hidden, only_the_ball, np.random.default_rng(seed)) == [1]
        assert asked[-2:] == [1, 3], "no further object of a bin that has its target"


def held(planner, scene: Scene, index: int) -> Cause:
    observation = look(scene, index)
    plan = planner.plan(observation)
    assert len(plan) > 0
    cell = Workcell(scene, OBJECTS, FRANKA)
    return cell.execute(plan.poses[0], float(plan.openings[0]), PROTOCOLS["strict"], index).cause


@pytest.mark.parametrize("index", [0, 1])
def test_the_oracle_grasps_the_wanted_object(index):
    assert held(OraclePlanner(), APART, index) is Cause.HELD


@pytest.mark.parametrize(("careful", "first"), [(True, 1), (False, 0)])
def test_the_oracle_would_rather_leave_the_neighbours_of_a_target_alone(careful, first, monkeypatch):
    """The first trial holds the target and moves another object; the second one moves none."""
    tried = []

    def run(self, pose, opening, index):
        tried.append(pose)
        return Outcome(True, disturbed=len(tried) == 1)

    monkeypatch.setattr(Trials, "run", run)
    seen = look(APART, 1)
    plan = OraclePlanner().plan(seen if careful else replace(seen, target=None))
    np.testing.assert_array_equal(plan.poses[0], tried[first])
    assert len(tried) == first + 1


def test_holding_another_object_is_a_failure():
    plan = OraclePlanner().plan(look(APART, 1))
    executed = Workcell(APART, OBJECTS, FRANKA).execute(plan.poses[0], float(plan.openings[0]), PROTOCOLS["strict"], 0)
    assert (executed.success, executed.target) == (False, 0)
    assert executed.cause is Cause.WRONG_OBJECT


@pytest.mark.parametrize(("planner", "index"), [(AntipodalPlanner(), 1), (RandomPlanner(), 0), (RandomPlanner(), 1)])
def test_contacts_lie_on_the_target(planner, index):
    plan = planner.plan(look(APART, index))
    assert len(plan) > 0
    pads = plan.poses[:, :3, 3] - FRANKA.finger_reach * plan.poses[:, :3, 2]
    distance = [np.linalg.norm(pads - placed.T_world_object[:3, 3], axis=1) for placed in APART.objects]
    assert (distance[index] < distance[1 - index]).all()


@pytest.mark.parametrize("planner", [AntipodalPlanner(), RandomPlanner()])
def test_where_nothing_of_the_target_is_seen_nothing_is_planned(planner):
    seen = look(APART, 0)
    assert len(planner.plan(replace(seen, target=np.zeros_like(seen.depth, bool)))) == 0


def test_the_network_grasps_the_instance_that_has_most_of_the_mask():
    """Left of the middle is instance 0, right of it is instance 1, with grasps of both."""
    seen = look(APART, 1)
    points, both = seen.cloud.points, np.array([0, 1, 0])
    scores = np.array([0.9, 0.8, 0.7])
    grasps = Grasps(np.tile(np.eye(4), (3, 1, 1)), scores, scores, scores, both, np.zeros((3, 3)), 0 * both)
    labels = (points[:, 0] > 0.15).astype(int)
    prediction = replace(predicted([trimesh.creation.box(), trimesh.creation.box()], points, labels), grasps=grasps)
    assert wanted_grasps(prediction, seen).scores.tolist() == [0.8]
    assert wanted_grasps(prediction, replace(seen, target=None)) is grasps
    assert len(wanted_grasps(prediction, replace(seen, target=np.zeros_like(seen.depth, bool)))) == 0


def test_attempts_are_counted_by_occlusion():
    row = TargetAttempt(0, "box", 0.05, True, "held", 0.5)
    rows = [
        row,
        replace(row, occlusion=0.1, success=False, cause=NOTHING_FOUND),
        replace(row, occlusion=0.55),
        replace(row, occlusion=0.89, success=False, cause="wrong object"),
    ]
    numbers = summarise(rows, scenes=7, not_holdable=2)
    assert [group.targets for group in numbers.bins.values()] == [1, 1, 0, 0, 0, 1, 0, 0, 1]
    assert [(group.targets, group.successes) for group in numbers.groups.values()] == [(2, 1), (2, 1), (4, 2)]
    assert numbers.groups["all"].failures == {NOTHING_FOUND: 1, "wrong object": 1}
    assert numbers.bins["0.2 to 0.3"].rate is None
    assert numbers.groups["all"].rate is not None
    assert numbers.groups["all"].rate.low == pytest.approx(15.0, abs=0.1), "Wilson's of two in four"
    (table,) = target.tables(numbers)
    assert table.notes[0].startswith("7 scenes; 2 objects left out")
    assert len(table.rows) == 12


class Nothing:
    needs_truth = False

    def plan(self, observation: Observation) -> Plan:
        assert observation.truth is None
        assert observation.target is not None
        return Plan.nothing()


CONFIG = TargetConfig(scene="packed", noise="none", planner="random", split="val", scenes=3)


@pytest.mark.parametrize("holdable", [True, False])
def test_every_scene_has_its_targets_if_the_hand_could_hold_them(holdable, monkeypatch):
    monkeypatch.setattr(target, "load_object_set", lambda source: OBJECTS)
    monkeypatch.setattr(rounds, "load_planner", lambda config: Nothing())
    monkeypatch.setattr(target, "round_scene", lambda *given: APART)
    monkeypatch.setattr(target, "is_holdable", lambda *given: holdable)
    numbers = measure(CONFIG)
    assert numbers.scenes == 3
    assert (numbers.bins["0 to 0.1"].targets, numbers.groups["all"].targets) == (3 * holdable, 3 * holdable)
    assert numbers.groups["all"].failures == ({NOTHING_FOUND: 3} if holdable else {})
    assert numbers.not_holdable == (0 if holdable else 6)


@pytest.mark.slow
def test_the_attempts_are_the_same_for_any_number_of_workers():
    config = replace(CONFIG, scenes=2)
    one, two = ([replace(row, plan_seconds=0.0) for row in measure(config, count).rows] for count in (1, 2))
    assert one == two
    assert len(one) >= 2


def test_settings_out_of_range_are_refused():
    with pytest.raises(InputError, match="scenes"):
        TargetConfig(scenes=0)
    with pytest.raises(InputError, match="workers must be at least 1, got 0"):
        measure(CONFIG, 0)
