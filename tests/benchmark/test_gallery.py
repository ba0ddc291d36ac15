import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from PIL import Image

from box_objects import EDGE, BoxAndBall, placed
from icgnet.benchmark import attempt_story, gallery
from icgnet.benchmark.attempt_story import grip_line, is_same, meeting_points, story, target_index
from icgnet.benchmark.clutter import ROUNDS_FILE, read_rounds
from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.gallery import draw_gallery, draw_replay, look_again, worst
from icgnet.benchmark.observation import observe
from icgnet.benchmark.planner import Plan
from icgnet.benchmark.planners.chance import RandomPlanner
from icgnet.benchmark.record import settings
from icgnet.benchmark.rounds import Attempt, ClutterJob, Round, Shot, play_round
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.object_set import load_object_set
from icgnet.simulation.surroundings import Surroundings, block

CONFIG = ClutterConfig(planner="random", scene="packed", split="val", protocol="strict", runs=1, rounds=1)
GRIPPER = load_gripper()


class Watched:
    """The random planner, which skips the first picture and keeps what it saw."""

    needs_truth = False

    def __init__(self):
        self.clouds, self._planner = [], RandomPlanner()

    def plan(self, observation):
        self.clouds.append(observation.cloud.points)
        return self._planner.plan(observation) if len(self.clouds) > 1 else Plan.nothing()


DOWN = np.diag([1.0, -1.0, -1.0, 1.0])


def lifted(height: float) -> np.ndarray:
    """What is added to a pose to put it over the middle of the table, at this height [m]."""
    offset = np.zeros((4, 4))
    offset[:3, 3] = [0.15, 0.15, height]
    return offset


def attempt(cause: str, score: float = 0.5, number: int = 0, **changes) -> Attempt:
    """An attempt at a box in the middle of the table, from above."""
    pose = (DOWN + lifted(0.05 + EDGE / 2)).tolist()
    values = {
        "scene": ["box"],
        "scales": [1.0],
        "object_poses": [np.eye(4).tolist()],
        "camera": np.eye(4).tolist(),
        "pose": pose,
        "opening": 0.08,
        "success": cause == "held",
        "target": "box",
        "target_class": "box",
        "held": [],
        "touched": [],
        "lost": [],
        "plan_seconds": 0.5,
    }
    return Attempt(run=0, round=0, attempt=number, cause=cause, score=score, **{**values, **changes})


def skipped(number: int, objects: int = 1) -> Shot:
    return Shot(0, 0, number, ["box"] * objects, [1.0] * objects, [np.eye(4).tolist()] * objects, np.eye(4).tolist())


def played(attempts: list[Attempt], pictures: list[Shot]) -> Round:
    return Round(0, 0, 5, 1, attempts, pictures)


SMALL = (118, 200)


@pytest.fixture(scope="module")
def procedural():
    return load_object_set("procedural")


@pytest.fixture(scope="module")
def watched(procedural) -> tuple[Round, list[np.ndarray]]:
    """A round of grasps by chance as it is read back from a file, and the clouds that the planner got."""
    planner = Watched()
    found = play_round(ClutterJob(CONFIG, procedural, GRIPPER), 0, 0, planner)
    return found, planner.clouds


@pytest.fixture
def folder(tmp_path, watched):
    """A finished benchmark."""
    (tmp_path / ROUNDS_FILE).write_text(json.dumps(asdict(watched[0])) + "\n")
    (tmp_path / "config.json").write_text(json.dumps(settings(CONFIG)))
    return tmp_path


def test_every_cause_has_its_turn_the_most_frequent_first_and_the_most_trusted_of_each():
    attempts = [
        attempt("missed", 0.2, 0),
        attempt("held", 0.99, 1),
        attempt("missed", 0.9, 2),
        attempt("too wide", 0.4, 3),
        attempt("missed", 0.5, 4),
    ]
    chosen = worst([played(attempts, [skipped(5, objects=1), skipped(6, objects=4)])], 5)
    assert [each.attempt for each in chosen] == [2, 5, 3, 4, 6]
    assert len(worst([played(attempts, [])], 100)) == 4
    with pytest.raises(InputError, match="-1"):
        worst([], -1)


def test_of_pictures_without_a_grasp_each_round_shows_its_first_before_any_second():
    rounds = [
        Round(0, 0, 5, 1, [], [skipped(0, objects=1), skipped(1, objects=1)]),
        Round(0, 1, 5, 1, [], [replace(skipped(3, objects=5), round=1)]),
    ]
    assert [(each.round, each.attempt) for each in worst(rounds, 3)] == [(1, 3), (0, 0), (0, 1)]


def test_looking_again_sees_the_same_cloud_and_plans_the_same_grasp(folder, watched, procedural):
    found, clouds = watched
    (again,) = read_rounds(folder / ROUNDS_FILE)
    assert again == found
    assert [each.attempt for each in again.skipped] == [0]
    assert again.attempts
    for shot in [*again.skipped, *again.attempts]:
        seen = look_again(ClutterJob(CONFIG, procedural, GRIPPER), shot, RandomPlanner())
        np.testing.assert_array_equal(seen.observation.cloud.points, clouds[shot.attempt])
        np.testing.assert_array_equal(seen.observation.T_world_camera, shot.camera)
        if isinstance(shot, Attempt):
            np.testing.assert_array_equal(seen.plan.poses[0], shot.pose)
            assert is_same(shot, seen.plan)
            assert not is_same(replace(shot, pose=np.eye(4).tolist()), seen.plan)


def test_the_command_draws_the_failures_of_a_finished_benchmark(folder, watched, capsys):
    arguments = ["--planner", "random", "--split", "val", "--protocol", "strict", "--runs", "1", "--rounds", "1"]
    assert main(["benchmark", "clutter", *arguments, "--out", str(folder), "--gallery", "2"]) == 0
    assert "gallery" in capsys.readouterr().out
    index = json.loads((folder / "gallery" / "index.json").read_text())
    causes = {each.cause for each in watched[0].attempts}
    assert [each["cause"] == "nothing found" for each in index].count(True) == 1
    assert {each["cause"] for each in index} - {"nothing found"} <= causes
    pictures = sorted(path.name for path in (folder / "gallery").glob("*.png"))
    assert pictures == [each["file"] for each in index]
    for name in pictures:
        assert np.asarray(Image.open(folder / "gallery" / name)).std() > 5
    assert len(read_rounds(folder / ROUNDS_FILE)) == 1, "nothing was played again"


def test_drawing_again_does_not_change_the_report_of_a_finished_benchmark(folder):
    (folder / "report.json").write_text('{"origin": "as it was"}')
    arguments = ["--planner", "random", "--split", "val", "--protocol", "strict", "--runs", "1", "--rounds", "1"]
    assert main(["benchmark", "clutter", *arguments, "--out", str(folder)]) == 0
    assert json.loads((folder / "report.json").read_text()) == {"origin": "as it was"}


def test_a_negative_number_of_pictures_is_refused_before_anything_is_played(tmp_path, capsys):
    assert main(["benchmark", "clutter", "--out", str(tmp_path / "out"), "--gallery", "-1"]) == USAGE_ERROR
    assert "gallery must be at least 0" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_smaller_gallery_takes_the_place_of_a_larger_one(folder, monkeypatch):
    blank = Image.new("RGB", (8, 8))
    monkeypatch.setattr(gallery, "attempt_picture", lambda scene: blank)
    for count in (2, 1):
        draw_gallery(CONFIG, folder, count, panel=SMALL)
        assert len(list((folder / "gallery").glob("*.png"))) == count


BOX_AT = (0.15, 0.15, 0.05 + EDGE / 2)


def box_alone(*more: tuple[str, tuple[float, float, float]]) -> TrueShapes:
    return TrueShapes(placed(("box", BOX_AT), *more), BoxAndBall())


def observation_of(truth: TrueShapes):
    objects = BoxAndBall()
    seen = observe(truth.scene, objects, "random", "none", GRIPPER, True, np.random.default_rng(0))
    return replace(seen, truth=TrueShapes(truth.scene, objects))


def test_the_line_between_the_pads_is_measured_on_the_true_shape():
    truth = box_alone()
    straight = grip_line(attempt("missed"), truth, 0, GRIPPER)
    assert straight.width == pytest.approx(EDGE, abs=0.002)
    assert straight.angles_deg == pytest.approx((0.0, 0.0), abs=5.0)
    assert straight.lever == pytest.approx(GRIPPER.finger_reach, abs=1e-6)
    turned = np.array(attempt("missed").pose)
    c, s = np.cos(np.deg2rad(20.0)), np.sin(np.deg2rad(20.0))
    turned[:2, :2] = np.array([[c, -s], [s, c]]) @ turned[:2, :2]
    oblique = grip_line(attempt("missed", pose=turned.tolist()), truth, 0, GRIPPER)
    assert oblique.width == pytest.approx(EDGE / c, abs=0.002)
    assert oblique.angles_deg == pytest.approx((20.0, 20.0), abs=5.0)
    beside = (DOWN + lifted(0.3)).tolist()
    assert grip_line(attempt("missed", pose=beside), truth, 0, GRIPPER).width == 0.0


def test_of_two_objects_of_one_name_the_nearer_one_is_the_target():
    truth = box_alone(("box", (0.25, 0.25, BOX_AT[2])))
    near_second = DOWN.copy()
    near_second[:3, 3] = [0.25, 0.25, 0.09]
    shot = attempt("missed", scene=["box", "box"], pose=near_second.tolist())
    assert target_index(shot, truth, GRIPPER) == 1
    assert target_index(attempt("missed", scene=["box", "box"]), truth, GRIPPER) == 0


def test_a_hand_is_marked_where_it_meets_something_and_only_there():
    truth = box_alone()
    observation = observation_of(truth)
    assert len(meeting_points(attempt("held"), truth, observation)) == 0
    marks = meeting_points(attempt("missed", opening=0.04), truth, observation)
    assert 0 < len(marks) <= attempt_story.MOST_MARKS
    assert (np.abs(marks - BOX_AT).max(axis=1) < EDGE / 2 + attempt_story.MARK_SPACING).all()
    deep = attempt("missed", pose=(DOWN + lifted(0.03)).tolist())
    assert (meeting_points(deep, truth, observation)[:, 2] < 0.12).all()
    assert (meeting_points(deep, truth, observation)[:, 2] < 0.05).any(), "the table"


def test_the_story_measures_the_grasp_and_names_what_was_met():
    truth = box_alone()
    shot = attempt("missed", touched=["folder/ball", "table"], held=["ball"], lost=["ball"])
    seen = observation_of(truth)
    told, changed = story(shot, truth, seen, Plan.nothing())
    assert "60 mm wide between pads 80 mm apart" in told
    assert "0 and 0 degrees off the normals (friction holds 37)" in told
    assert "touched on the way: ball, table; held: ball; pushed out: ball." in told
    assert "decides otherwise" in changed
    same = Plan(np.array(shot.pose)[None], np.array([0.08]), np.ones(1))
    assert story(shot, truth, seen, same) == (told,)
    assert story(skipped(0), truth, seen, same) == (changed,)
    beside = attempt("missed", pose=(DOWN + lifted(0.3)).tolist())
    assert "does not meet it" in story(beside, truth, seen, same)[0]


def test_the_story_names_a_wall_between_the_pads():
    truth = box_alone()
    shot = attempt("missed", pose=(DOWN + lifted(0.3)).tolist())
    middle = np.array(shot.pose)[:3, 3] - GRIPPER.finger_reach * np.array(shot.pose)[:3, 2]
    seen = observation_of(truth)
    for offset, named in ((np.zeros(3), True), (np.array([0.0, 0.0, -0.1]), False)):
        wall = block("bin wall", (0.01, 0.01, 0.05), make_transform(np.eye(3), middle + offset))
        scene = replace(truth.scene, surroundings=Surroundings((-0.15, -0.15, 0.45, 0.45), (wall,)))
        told = story(shot, TrueShapes(scene, BoxAndBall()), seen, Plan.nothing())[0]
        assert ("between the pads, though no object: bin wall" in told) == named


def test_a_picture_in_which_nothing_was_found_says_what_was_seen(watched, procedural):
    class Silent(RandomPlanner):
        def plan(self, observation):
            return Plan.nothing()

    scene = draw_replay(look_again(ClutterJob(CONFIG, procedural, GRIPPER), watched[0].skipped[0], Silent()))
    assert scene.grasp is None
    assert scene.story == (f"{len(scene.cloud)} points seen.",)
