import json
from contextlib import closing
from dataclasses import asdict, fields, replace

import numpy as np
import pytest

from icgnet.benchmark.clutter import ROUNDS_FILE, ClutterJob, run_clutter, summarise
from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.planner import Plan
from icgnet.benchmark.planners.registry import BUILT_IN, PlannerSource
from icgnet.benchmark.rounds import Attempt, Round, Shot, play_round, round_scene
from icgnet.datagen.pool import local_pool
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


def job_of(planner: str, world, **changes) -> ClutterJob:
    """A benchmark that has a round 17 of run 2."""
    return ClutterJob(replace(CHANCE, planner=PlannerSource(planner), runs=3, rounds=18, **changes), *world)


def play(job: ClutterJob, numbers: list[int], workers: int) -> dict[tuple[int, int], Round]:
    """Rounds by run and number, without the times."""
    with closing(local_pool(job, workers)) as pool:
        played = {(each.run, each.round): each for each in pool.make(numbers)}
    timeless = {key: [replace(each, plan_seconds=0.0) for each in found.attempts] for key, found in played.items()}
    return {key: replace(found, attempts=timeless[key]) for key, found in played.items()}


def first_picture(played: Round) -> Shot:
    """What stood there at the start, and where the camera was, whatever came of it."""
    first = min((*played.attempts, *played.skipped), key=lambda each: each.attempt)
    return Shot(**{field.name: getattr(first, field.name) for field in fields(Shot)})


RUN, ROUND = 2, 17
NUMBER = RUN * 18 + ROUND


@pytest.fixture(scope="module")
def by_chance(world) -> Round:
    return play(job_of("random", world), [NUMBER], workers=1)[RUN, ROUND]


@pytest.mark.slow
@pytest.mark.parametrize("planner", sorted(set(BUILT_IN) - {"random"}))
def test_round_17_of_run_2_begins_alike_for_every_built_in_planner(planner, world, by_chance):
    played = play(job_of(planner, world), [NUMBER], workers=1)[RUN, ROUND]
    assert played.placed == by_chance.placed > 1
    assert first_picture(played) == first_picture(by_chance)
    assert played.attempts != by_chance.attempts, "the planners do differ"


@pytest.mark.slow
def test_round_17_of_run_2_is_the_same_for_any_number_of_workers(world, by_chance):
    played = play(job_of("random", world), [ROUND, NUMBER], workers=2)
    assert played[RUN, ROUND] == by_chance
    assert first_picture(played[0, ROUND]).camera != first_picture(by_chance).camera, "other runs have other rounds"


def test_another_seed_gives_another_round_17_of_run_2(world, by_chance):
    other = round_scene(job_of("random", world, seed=CHANCE.seed + 1).config, RUN, ROUND, world[0])
    assert [placed.T_world_object.tolist() for placed in other.objects] != first_picture(by_chance).object_poses


def test_the_report_has_what_others_read(tmp_path):
    """Its rounds are there already, so that nothing is played."""
    won, missed = asdict(attempt(True)), asdict(attempt(False))
    rounds = [
        {"run": run, "round": number, "placed": 2, "skips": 1, "left": 1, "lost": 0, "attempts": [won, missed]}
        for run in range(CHANCE.runs)
        for number in range(CHANCE.rounds)
    ]
    (tmp_path / ROUNDS_FILE).write_text("".join(json.dumps(each) + "\n" for each in rounds))
    run_clutter(CHANCE, tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["gsr"]["mean"] == report["dr"]["mean"] == 50.0
    assert {"mean", "std", "low", "high"} == report["gsr"].keys() == report["dr"].keys()
    assert (report["attempts"], report["rounds"], report["protocol"]) == (8, 4, "edge")
    assert report["failures"] == {"missed": 4, "nothing found": 4}
    assert {"settings", "origin"} <= report.keys()
    assert len((tmp_path / "attempts.jsonl").read_text().splitlines()) == 8


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
