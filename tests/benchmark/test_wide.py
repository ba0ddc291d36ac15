"""Tables and bins in the benchmark: their cameras, clouds, rounds and pictures drawn again."""

from dataclasses import asdict, replace

import numpy as np
import pytest
import trimesh

from box_objects import BoxAndBall
from icgnet.benchmark import rounds
from icgnet.benchmark.clutter import summarise, tables
from icgnet.benchmark.config import ClutterConfig, LatencyConfig
from icgnet.benchmark.gallery import Replay, draw_replay, scene_again
from icgnet.benchmark.observation import Observation, observe, take_picture
from icgnet.benchmark.planner import Plan
from icgnet.benchmark.rounds import WIDE_ATTEMPTS, Attempt, ClutterJob, Round, Shot, play_round, round_scene, until_over
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.kinds import WIDE_KINDS
from icgnet.objects.object_set import load_object_set
from icgnet.sensors import wide
from icgnet.sensors.wide import SEEN_PIXELS, WIDE_CAMERA, draw_wide_camera
from icgnet.simulation.physics import Body
from icgnet.simulation.scene import PlacedObject, Scene
from icgnet.simulation.surroundings import Surroundings, block
from icgnet.simulation.workcell import Cause, Execution, Workcell, _planes

OBJECTS, FRANKA = load_object_set("procedural"), load_gripper()
CONFIG = ClutterConfig(
    planner="random", scene="table", split="val", noise="stereo", protocol="strict", runs=1, rounds=2
)


@pytest.fixture(scope="module", params=WIDE_KINDS)
def job(request) -> ClutterJob:
    return ClutterJob(replace(CONFIG, scene=request.param), OBJECTS, FRANKA)


@pytest.fixture(scope="module")
def scene(job) -> Scene:
    return round_scene(job.config, 0, 0, OBJECTS)


class Somewhere:
    needs_truth = False

    def plan(self, observation: Observation) -> Plan:
        return Plan(np.eye(4)[None], np.array([0.08]), np.ones(1))


class Nothing:
    needs_truth = False

    def plan(self, observation: Observation) -> Plan:
        return Plan.nothing()


def test_the_camera_shows_the_support_up_to_the_middle_of_each_edge(scene):
    x0, y0, x1, y1 = scene.surroundings.extent
    x, y = (x0 + x1) / 2, (y0 + y1) / 2
    edges = np.array([[x0, y, TABLE_HEIGHT], [x1, y, TABLE_HEIGHT], [x, y0, TABLE_HEIGHT], [x, y1, TABLE_HEIGHT]])
    for seed in range(20):
        pose = draw_wide_camera(scene.kind, scene.surroundings, np.random.default_rng(seed))
        seen = (edges - pose[:3, 3]) @ pose[:3, :3] @ WIDE_CAMERA.intrinsics.T
        pixels = seen[:, :2] / seen[:, 2:]
        assert (pixels > 0).all()
        assert (pixels < WIDE_CAMERA.shape[::-1]).all()


def test_a_camera_behind_a_wall_is_drawn_again(monkeypatch):
    """A wall hides the only object from one half of the directions."""
    name = OBJECTS.names("table", "val")[0]
    wall = block("wall", (2.0, 0.02, 1.5), make_transform(np.eye(3), np.array([0.15, 0.03, TABLE_HEIGHT + 0.75])))
    surroundings = Surroundings((-0.15, -0.15, 0.45, 0.45), (wall,))
    pose = make_transform(np.eye(3), np.array([0.15, 0.15, TABLE_HEIGHT + 0.05]))
    scene = Scene("table", (PlacedObject(name, 1.0, pose),), surroundings)
    seen = [take_picture(scene, OBJECTS, "random", np.random.default_rng(seed)) for seed in range(8)]
    assert all((each.image.ids == 0).sum() >= SEEN_PIXELS for each in seen)
    monkeypatch.setattr(wide, "PLACES", 1)
    once = [take_picture(scene, OBJECTS, "random", np.random.default_rng(seed)) for seed in range(8)]
    assert any((each.image.ids == 0).sum() < SEEN_PIXELS for each in once)


def test_the_cloud_is_measured_above_the_support_and_shows_what_is_no_object_too(scene):
    seen = observe(scene, OBJECTS, "random", "none", FRANKA, False, np.random.default_rng(0))
    assert seen.is_wide
    assert seen.cloud.points[:, 2].min() >= 0.055
    assert np.ptp(seen.cloud.points[:, :2], axis=0).max() > 0.3 or scene.kind == "bin"
    owners = TrueShapes(scene, OBJECTS).owners(seen.cloud.points)
    assert (owners >= 0).any()
    noisy = observe(scene, OBJECTS, "random", "stereo", FRANKA, False, np.random.default_rng(0))
    np.testing.assert_array_equal(noisy.T_world_camera, seen.T_world_camera)
    assert (noisy.depth == 0).sum() > (seen.depth == 0).sum(), "a stereo camera has shadows"


def test_a_round_can_be_drawn_again_from_what_is_recorded(job, scene):
    played = play_round(job, 0, 0, Nothing())
    assert 1 <= played.placed == len(scene.objects) <= 12
    again = scene_again(job, played.skipped[0])
    for one, other in zip(again.objects, scene.objects, strict=True):
        assert (one.name, one.scale, one.stretch) == (other.name, other.scale, other.stretch)
    for one, other in zip(again.surroundings.structures, scene.surroundings.structures, strict=True):
        np.testing.assert_array_equal(one.corners, other.corners)
    assert again.surroundings.extent == scene.surroundings.extent
    assert asdict(played.skipped[0])["camera"] == job.look(0, 0, 0, again, False).T_world_camera.tolist()


def test_a_round_counts_what_the_hand_could_hold_and_what_of_it_was_grasped(job, scene, monkeypatch):
    """Every object but the last could be held; the hand takes the first and the last one."""
    count, last = len(scene.objects), len(scene.objects) - 1
    monkeypatch.setattr(rounds, "can_hold", lambda scene, index, *given: index != last)
    taken = iter([0, last])

    def take_one(self, *given):
        index = next(taken, None)
        removed = () if index is None else (index,)
        self.grasped += removed
        pose = np.eye(4)
        return Execution(bool(removed), Cause.HELD if removed else Cause.MISSED, 0, (), (), removed, (), 0.05, pose)

    monkeypatch.setattr(Workcell, "execute", take_one)
    played = play_round(job, 0, 0, Somewhere())
    assert (played.placed, played.successes) == (count, 2)
    assert (played.holdable, played.holdable_grasped) == (count - 1, 1)


def test_pictures_show_the_walls_of_a_bin_but_neither_the_edge_of_a_table_nor_the_floor(job, scene):
    shot = Shot(0, 0, 0, [], [], [], np.eye(4).tolist())
    seen = observe(scene, OBJECTS, "random", "none", FRANKA, False, np.random.default_rng(0))
    drawn = draw_replay(Replay(shot, TrueShapes(scene, OBJECTS), seen, Plan.nothing())).structures
    tall = [each for each in scene.surroundings.structures if each.corners[:, 2].max() > TABLE_HEIGHT + 0.01]
    assert len(drawn) == len(tall) < len(scene.surroundings.structures)
    assert scene.kind == "table" or len(drawn) >= 4


def test_the_rate_of_what_the_hand_could_hold_is_pooled(job):
    played = Round(0, 0, 8, 5, [], [], None, 4, 2)
    numbers = summarise([played, replace(played, round=1, holdable=6, holdable_grasped=6)])
    assert (numbers.holdable, numbers.dr_holdable.mean) == (10, 80.0)
    assert any("10 objects that the hand could hold" in row[0] for row in tables(numbers)[0].rows)
    of_old = summarise([Round(0, 0, 8, 5, [], [])])
    assert of_old.dr_holdable is None
    assert not any("could hold" in row[0] for row in tables(of_old)[0].rows)


def test_a_wide_round_has_a_limit_of_attempts():
    pose = np.eye(4).tolist()
    held = Attempt(0, 0, 0, [], [], [], pose, pose, 0.08, 1.0, True, "held", "a", "box", [], [], [], 0.5)
    attempts, _ = until_over(lambda number: held, lambda: 100, WIDE_ATTEMPTS)
    assert len(attempts) == 12


def test_a_view_of_the_cube_is_refused():
    with pytest.raises(InputError, match="view must be random in table scenes, got 'side'"):
        LatencyConfig(scene="table", view="side")


def test_a_stretched_object_is_measured_as_it_is():
    name = OBJECTS.names("table", "val")[0]
    pose = make_transform(np.eye(3), np.array([0.15, 0.15, 0.1]))
    plain, wide = (
        TrueShapes(Scene("table", (PlacedObject(name, 1.0, pose, stretch),)), OBJECTS)
        for stretch in ((1.0, 1.0, 1.0), (1.15, 1.0, 1.0))
    )
    half = OBJECTS.model(name).visual.extents[0] / 2
    middle = OBJECTS.model(name).visual.bounds.mean(axis=0)
    line = pose[:3, 3] + middle + np.linspace(0.0, 1.2 * half, 200)[:, None] * np.array([1.0, 0.0, 0.0])
    assert (wide.distance(0, line) < 0).sum() > (plain.distance(0, line) < 0).sum()


def test_faces_without_area_do_not_make_a_stretched_object_the_target():
    """Such a face has no normal: what is not a number would be the smallest of all distances."""
    boxes = BoxAndBall()
    part = boxes.model("box").parts[0]
    corner = part.faces[0, 0]
    faces = np.concatenate([part.faces, [[corner, corner, corner]]])
    flawed = trimesh.Trimesh(part.vertices, faces, process=False)
    bodies = [Body(replace(boxes.model("box"), parts=(flawed,)), 1.0, np.eye(4), (1.1, 1.0, 1.0))]
    ((normals, offsets),) = _planes(bodies[0])
    assert np.isfinite(normals).all()
    assert np.isfinite(offsets).all()
