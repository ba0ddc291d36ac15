"""The workcell: where things are, who looks, what is counted, and a round of one object from picture to box."""

import json
from dataclasses import asdict, replace

import numpy as np
import pytest
import trimesh

import needs_arm  # noqa: F401
from arm_scenes import box, boxes_seen
from box_objects import EDGE, BoxAndBall, placed
from icgnet.arm.bodies import bodies_of
from icgnet.benchmark.clutter import ROUNDS_FILE
from icgnet.benchmark.config import WorkcellConfig
from icgnet.benchmark.record import REPORT_FILE
from icgnet.benchmark.workcell import numbers, rounds
from icgnet.benchmark.workcell.eyes import TrueEyes, instance_under, take_look, true_object
from icgnet.benchmark.workcell.numbers import read_workcell_rounds, run_workcell, summarise, tables
from icgnet.benchmark.workcell.rounds import PickAttempt, Sight, WorkcellJob, WorkcellRound, draw_pool, workcell_scene
from icgnet.benchmark.workcell.station import (
    BOX,
    CAMERA,
    HAND_EYE_SHIFT,
    HAND_EYE_TURN,
    VIEWS_DEG,
    Station,
    misplaced,
    standing_arm,
)
from icgnet.cli.main import main
from icgnet.errors import DataError, InputError
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import invert_transform, make_transform, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.prediction import NO_INSTANCE
from icgnet.objects.object_set import load_object_set
from icgnet.simulation.robot_cell import RobotCell
from icgnet.simulation.scene import BACKGROUND
from icgnet.simulation.surroundings import BIN_WALL, ENDLESS

OBJECTS, FRANKA = BoxAndBall(), load_gripper()
CONFIG = WorkcellConfig(planner="oracle", rounds=1, split="val", noise="none", pool=2)
ONE_BOX = placed(("box", (0.15, 0.15, TABLE_HEIGHT + EDGE / 2)))


@pytest.fixture(scope="module")
def station():
    return Station(standing_arm("fr3"), FRANKA, ENDLESS)


def sight(**changes) -> Sight:
    values = {"view": 0, "objects": 3, "found": 3, "grasps": 9, "see_seconds": 1.0, "plan_seconds": 0.5}
    return Sight(**values | {"refused": {"no joint positions": 2}} | changes)


def attempt(cause: str = "in the box", phase: str = "", **changes) -> PickAttempt:
    values = {
        **asdict(sight()),
        **{"target": "a", "target_class": "box", "wanted": False, "score": 0.9, "pose": np.eye(4).tolist()},
        **{"success": not phase, "cause": cause, "phase": phase, "removed": [] if phase else ["a"], "lost": []},
        **{"touched": [], "displaced": [], "carried": True, "hit": [], "hit_force": 0.0, "hit_depth": 0.0},
        **{"cycle_seconds": 8.0, "tracking": 0.003, "kept": True, "replay_depth": 0.0},
    }
    return PickAttempt(**values | changes)


def played(*attempts: PickAttempt, placed: int = 4, empty: tuple[Sight, ...] = (), **changes) -> WorkcellRound:
    values = {"round": 0, "strategy": "clear", "left": 0, "move_seconds": 0.0}
    return WorkcellRound(**values | {"placed": placed, "attempts": list(attempts), "empty": list(empty)} | changes)


def test_rates_failures_and_carried_collisions_are_counted():
    slipped = attempt("slipped on closing", "close", carried=False, touched=["b"], lost=["b"])
    hit = attempt(hit=["c", "table"], displaced=["c"], plan_seconds=1.5, tracking=0.01, replay_depth=0.0002)
    found = summarise([played(attempt(), slipped, hit, empty=(sight(grasps=0), sight(found=0), sight()))])
    assert found.gsr.mean == pytest.approx(100 * 2 / 3)
    assert found.dr.mean == pytest.approx(50.0)
    assert found.failures == {"close: slipped on closing": 1}
    assert found.empty == {
        "nothing found: no grasp": 1,
        "nothing found: no object": 1,
        "nothing found: no grasp that the arm can carry out": 1,
    }
    assert found.refused == {"no joint positions": 12}
    assert (found.touching, found.displacing, found.lost, found.carries) == (1, 1, 1, 2)
    assert found.hits.mean == pytest.approx(50.0)
    assert found.hit_by == {"object": 1, "table": 1}
    assert (found.plan_median, found.tracking, found.deepest) == (0.5, 0.01, 0.0002)
    # Three picks of 8 s; six pictures of 1 s; planning of 0.5 s, once of 1.5 s.
    assert found.picks_per_hour == pytest.approx(3600 * 2 / (24 + 6 + 4))
    assert any("50.0" in row[1] for row in tables(found)[0].rows)


def test_fetches_are_told_by_strategy():
    first = {"target": "a", "fetched": True, "blocked": 1, "reasons": ["2: lies on or over object 0"]}
    both = [
        played(attempt(), attempt(wanted=True), strategy="order", **first),
        played(attempt("missed", "close"), strategy="order", target="a", round=1, blocked=0, reasons=[]),
        played(attempt(), attempt(), attempt(wanted=True), strategy="highest", target="a", fetched=True),
        played(attempt(), strategy="highest", target="a", round=1),
    ]
    found = summarise(both).fetch
    assert list(found) == ["order", "highest"]
    assert (found["order"].picks, found["highest"].picks) == (2.0, 3.0)
    assert found["order"].fetched.mean == found["highest"].fetched.mean == 50.0
    assert (found["order"].blocked, found["order"].blockers, found["highest"].blocked) == (1, 1.0, None)
    assert found["order"].reasons == {"lies on or over": 1}
    assert len(tables(summarise(both))) == 2


def test_nothing_played_but_empty_pictures_has_no_rates():
    found = summarise([played(empty=(sight(),))])
    assert (found.gsr, found.hits, found.picks_per_hour) == (None, None, 0.0)
    assert np.isnan(found.plan_median)


def test_every_place_to_look_from_is_reached_and_sees_the_middle(station):
    assert len(station.views) == len(VIEWS_DEG)
    middle = np.array([0.15, 0.15, TABLE_HEIGHT])
    places = []
    for joints in station.views:
        T_world_camera = station.T_world_base @ station.arm.mount_pose(joints) @ station.T_mount_camera
        seen = transform_points(invert_transform(T_world_camera), middle[None])[0]
        u, v, _ = CAMERA.intrinsics @ (seen / seen[2])
        assert 0.4 < seen[2] < 0.6
        assert abs(u - 320) < 160
        assert abs(v - 240) < 120
        places.append(T_world_camera[:3, 3])
    apart = [np.linalg.norm(a - b) for i, a in enumerate(places) for b in places[:i]]
    assert min(apart) > 0.1


def test_the_hand_eye_error_is_as_large_as_said_and_drawn(station):
    T = station.T_mount_camera
    errors = [invert_transform(T) @ misplaced(T, np.random.default_rng(seed)) for seed in (0, 1)]
    for error in errors:
        assert np.linalg.norm(error[:3, 3]) == pytest.approx(HAND_EYE_SHIFT)
        assert np.arccos((np.trace(error[:3, :3]) - 1) / 2) == pytest.approx(HAND_EYE_TURN, rel=1e-3)
    assert np.abs(errors[0] - errors[1]).max() > 1e-4


def test_objects_are_drawn_into_a_pool_once_for_all_rounds():
    config = WorkcellConfig(pool=5, split="val", seed=4)
    objects = load_object_set("procedural")
    names = draw_pool(config, objects).names("packed", "val")
    assert len(names) == 5
    assert names == draw_pool(replace(config, rounds=7, planner="oracle"), objects).names("packed", "val")
    assert names != draw_pool(replace(config, seed=5), objects).names("packed", "val")


def test_a_table_keeps_its_edge_and_floor_and_nothing_where_the_arm_is():
    config = WorkcellConfig(scene="table", split="val", seed=0, planner="oracle")
    job = WorkcellJob(config, draw_pool(config, load_object_set("procedural")), FRANKA)
    scene = workcell_scene(job, 0)
    assert 3 <= len(scene.objects) <= 6
    assert {each.name for each in scene.surroundings.structures} == {"table edge", "floor"}
    lower, upper = scene.surroundings.bounds
    assert (upper - lower).max() <= 0.51


def test_walls_of_a_bin_stand_in_the_cell_and_what_is_seen_of_them_is_an_obstacle():
    config = WorkcellConfig(scene="bin", split="val", seed=0, planner="oracle")
    job = WorkcellJob(config, draw_pool(config, load_object_set("procedural")), FRANKA)
    scene = workcell_scene(job, 0)
    station = Station(standing_arm("fr3"), FRANKA, scene.surroundings)
    cell = RobotCell(scene, job.pool, FRANKA, station.model, BOX, station.arm.home)
    assert (cell._name_of_geom == BACKGROUND).sum() >= len(scene.surroundings.structures) + len(BOX.structures())
    pose = make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.15, 0.15, 0.75]))
    look = take_look(scene, job.pool, pose, pose, "none", np.random.default_rng(0))
    mask = look.in_workspace()
    points, ids = look.points[mask], look.image.ids[mask]
    # As the network gives it: everything in the mask, and what is no object belongs to none.
    prediction = replace(
        boxes_seen([box((0.02, 0.02, 0.02))]),
        cloud=PointCloud(points, None, "world"),
        cloud_instances=np.where(ids >= 0, 0, NO_INSTANCE),
        input_rows=np.arange(len(points)),
        input_shape=(len(points),),
    )
    (seen,) = [each for each in bodies_of(prediction, station.T_base_world) if each.name == "background"]
    walls = trimesh.util.concatenate([each.mesh for each in station.walls if each.name == BIN_WALL])
    np.testing.assert_allclose(seen.mesh.bounds[:, :2], walls.bounds[:, :2], atol=0.025)
    assert seen.mesh.bounds[1, 2] == pytest.approx(walls.bounds[1, 2], abs=0.015)


def test_the_oracle_sees_true_shapes_where_the_camera_is_believed_to_be():
    off = make_transform(np.eye(3), np.array([0.0, 0.0, 0.01]))
    pose = make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.15, 0.15, 0.55]))
    look = take_look(ONE_BOX, OBJECTS, pose, off @ pose, "none", np.random.default_rng(0))
    prediction = TrueEyes(FRANKA).see(look, with_blocked=False)
    assert len(prediction.grasps)
    assert (prediction.grasps.scores > 0.7).all()
    mesh = prediction.objects[0].mesh()
    np.testing.assert_allclose(mesh.bounds[:, 2], [TABLE_HEIGHT + 0.01, TABLE_HEIGHT + EDGE + 0.01], atol=1e-6)
    assert prediction.T_frame_table[2, 3] == pytest.approx(0.01)
    assert true_object(prediction, 0, look.image.ids) == 0
    assert instance_under(prediction, look.image.ids == 0) == 0
    assert instance_under(prediction, look.image.ids == 5) == -1
    assert not look.in_workspace()[0, 0]
    assert look.in_workspace()[240, 320]


@pytest.fixture(scope="module")
def cleared():
    """A round with one box, from the picture to the drop-off box."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rounds, "workcell_scene", lambda job, number: ONE_BOX)
        (result,) = WorkcellJob(CONFIG, OBJECTS, FRANKA, "abc").make(0)
    return result


def test_one_object_is_seen_picked_carried_and_dropped_into_the_box(cleared):
    assert (cleared.placed, cleared.left, cleared.commit) == (1, 0, "abc")
    (only,) = cleared.attempts
    assert only.success, only
    assert (only.target, only.target_class, only.removed, only.phase) == ("box", "box", ["box"], "")
    assert (only.hit, only.lost, only.displaced) == ([], [], [])
    assert only.kept
    assert only.replay_depth <= 0.001
    assert only.tracking < 0.02
    assert 3.0 < only.cycle_seconds < 20.0


def test_rounds_are_written_read_back_and_not_played_again(tmp_path, monkeypatch, cleared):
    made = []

    def make(job, number):
        made.append(number)
        return [replace(cleared, round=number)]

    monkeypatch.setattr(numbers.WorkcellJob, "make", make)
    monkeypatch.setattr(numbers, "tools_of", lambda *_: None)
    config = replace(CONFIG, rounds=2)
    first = run_workcell(config, tmp_path)
    assert made == [0, 1]
    assert read_workcell_rounds(tmp_path / ROUNDS_FILE) == [replace(cleared, round=k) for k in (0, 1)]
    report = json.loads((tmp_path / REPORT_FILE).read_text())
    assert report["benchmark"] == "workcell"
    assert report["gsr"]["mean"] == first.gsr.mean == 100.0
    assert run_workcell(config, tmp_path) == first
    assert made == [0, 1]
    with pytest.raises(DataError, match="attached_check is True there, False now"):
        run_workcell(replace(config, attached_check=False), tmp_path)
    (tmp_path / ROUNDS_FILE).write_text('[{"round": 0}]\n')
    with pytest.raises(DataError, match="line 1: not a round of the workcell"):
        read_workcell_rounds(tmp_path / ROUNDS_FILE)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--planner", "antipodal"], "antipodal"),
        (["--rounds", "0"], "rounds must be at least 1"),
        (["--planner", "oracle", "--weights", "w.safetensors"], "only the planner icgnet takes weights"),
        (["--objects", "nowhere"], "no object set 'nowhere'"),
        (["--arm", "kuka"], "arm 'kuka' is neither a file nor one of"),
    ],
)
def test_bad_options_are_one_line(tmp_path, capsys, options, message):
    code = main(["benchmark", "workcell", "--out", str(tmp_path / "out"), *options])
    said = capsys.readouterr()
    assert code == 2
    assert message in said.err + said.out


def test_a_pool_of_nothing_is_refused():
    with pytest.raises(InputError, match="pool must be"):
        WorkcellConfig(pool=0)
