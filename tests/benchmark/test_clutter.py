import json
from dataclasses import asdict, replace

import numpy as np
import pytest

from icgnet.benchmark.clutter import ROUNDS_FILE, run_clutter, summarise
from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.planner import Plan
from icgnet.benchmark.planners.registry import PlannerSource
from icgnet.benchmark.rounds import Attempt, Round, play_round, round_scene
from icgnet.errors import DataError, InputError
from icgnet.grasping.gripper import load_gripper
from icgnet.objects.object_set import load_object_set

CHANCE = ClutterConfig(planner=PlannerSource("random"), scene="packed", split="val", runs=2, rounds=2)


def attempt(success: bool, cause: str = "missed") -> Attempt:
    pose = np.eye(4).tolist()
    names = {
        "scene": [],
        "scales": [],
        "object_poses": [],
        "held": [],
        "touched": [],
        "lost": [],
        "target": "a",
        "target_class": "box",
    }
    return Attempt(0, 0, 0, camera=pose, pose=pose, opening=0.08, score=1.0, success=success,
                   cause="held" if success else cause, plan_seconds=0.5, **names)  # fmt: skip


class NothingFound:
    needs_truth = False

    def plan(self, observation):
        return Plan.nothing()


class AlwaysBeside:
    """Closes the hand high above the table."""

    needs_truth = False

    def plan(self, observation):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = [0.15, 0.15, 0.5]
        return Plan(pose[None], np.array([0.08]), np.ones(1))


@pytest.fixture(scope="module")
def world():
    return load_object_set("procedural"), load_gripper()


def test_rates_are_pooled_in_a_run_and_averaged_over_runs():
    rounds = [
        Round(0, 0, placed=4, skips=1, left=1, lost=0, attempts=[attempt(True)] * 3),
        Round(0, 1, placed=1, skips=0, left=1, lost=0, attempts=[attempt(False)]),
        Round(1, 0, placed=2, skips=0, left=0, lost=1, attempts=[attempt(True), attempt(False, "too wide")]),
    ]
    numbers = summarise(rounds)
    assert numbers.gsr.mean == pytest.approx((75.0 + 50.0) / 2)
    assert numbers.gsr.std == pytest.approx(12.5)
    assert numbers.dr.mean == pytest.approx((60.0 + 50.0) / 2)
    assert numbers.gsr.low < 100 * 4 / 6 < numbers.gsr.high
    assert numbers.failures == {"missed": 1, "too wide": 1, "nothing found": 1}
    assert (numbers.attempts, numbers.rounds, numbers.objects, numbers.lost) == (6, 3, 7, 1)


def test_a_round_ends_after_three_pictures_in_which_nothing_is_found(world):
    played = play_round(CHANCE, 0, 0, NothingFound(), *world)
    assert (played.skips, played.attempts, played.left) == (3, [], played.placed)


def test_a_round_ends_after_two_failures_in_a_row(world):
    played = play_round(CHANCE, 0, 0, AlwaysBeside(), *world)
    assert [each.cause for each in played.attempts] == ["missed", "missed"]
    assert played.left == played.placed


def test_a_round_begins_with_the_same_scene_and_camera_for_every_planner(world):
    first = round_scene(CHANCE, 1, 1, world[0])
    again = round_scene(replace(CHANCE, planner=PlannerSource("oracle"), protocol="strict"), 1, 1, world[0])
    assert [each.name for each in first.objects] == [each.name for each in again.objects]
    for one, other in zip(first.objects, again.objects, strict=True):
        np.testing.assert_array_equal(one.T_world_object, other.T_world_object)
    beside = play_round(CHANCE, 1, 1, AlwaysBeside(), *world)
    other = play_round(replace(CHANCE, protocol="strict"), 1, 1, AlwaysBeside(), *world)
    assert [each.camera for each in beside.attempts] == [each.camera for each in other.attempts]


@pytest.mark.slow
def test_a_killed_benchmark_goes_on_and_ends_as_an_uninterrupted_one(tmp_path):
    whole = run_clutter(CHANCE, tmp_path / "whole")
    lines = (tmp_path / "whole" / ROUNDS_FILE).read_text().splitlines(keepends=True)
    assert len(lines) == 4
    (tmp_path / "killed").mkdir()
    (tmp_path / "killed" / "config.json").write_text((tmp_path / "whole" / "config.json").read_text())
    (tmp_path / "killed" / ROUNDS_FILE).write_text(lines[0] + lines[1][:40])
    resumed = run_clutter(CHANCE, tmp_path / "killed", workers=2)
    assert replace(resumed, plan_seconds=0.0) == replace(whole, plan_seconds=0.0)

    def attempts(folder):
        rows = [json.loads(line) for line in (tmp_path / folder / "attempts.jsonl").read_text().splitlines()]
        return [{**row, "plan_seconds": None} for row in rows]

    assert attempts("killed") == attempts("whole")
    report = json.loads((tmp_path / "whole" / "report.json").read_text())
    assert report["gsr"] == asdict(whole.gsr)
    assert report["protocol"] == "edge"


def test_a_folder_with_another_benchmark_is_refused(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"scene": "pile"}))
    with pytest.raises(DataError, match="scene is 'pile' there, 'packed' now"):
        run_clutter(CHANCE, tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"protocol": "easy"}, "edge, strict, got 'easy'"),
        ({"runs": 0}, "runs"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(CHANCE, **change)
