import json
from contextlib import closing
from dataclasses import asdict, fields, replace

import numpy as np
import pytest
import yaml

from icgnet.benchmark import clutter, rounds
from icgnet.benchmark.clutter import ROUNDS_FILE, read_rounds, run_clutter, summarise
from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.planner import Plan
from icgnet.benchmark.planners.registry import BUILT_IN, load_planner
from icgnet.benchmark.record import REPORT_FILE
from icgnet.benchmark.rounds import Attempt, ClutterJob, Round, Shot, play_round, round_scene, until_over
from icgnet.errors import DataError, InputError
from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import save_weights
from icgnet.objects.object_set import load_object_set
from icgnet.parallel.pool import local_pool

CHANCE = ClutterConfig(planner="random", scene="packed", split="val", runs=2, rounds=2)


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
    lost = replace(attempt(False, "too wide"), lost=["a"])
    played = [
        Round(0, 0, placed=4, left=1, attempts=[attempt(True)] * 3, skipped=[skipped()]),
        Round(0, 1, placed=1, left=1, attempts=[attempt(False)], skipped=[]),
        Round(1, 0, placed=2, left=0, attempts=[attempt(True), lost], skipped=[]),
    ]
    numbers = summarise(played)
    assert numbers.gsr.mean == pytest.approx((75.0 + 50.0) / 2)
    assert numbers.gsr.std == pytest.approx(12.5)
    assert numbers.dr.mean == pytest.approx((60.0 + 50.0) / 2)
    assert numbers.gsr.low < 100 * 4 / 6 < numbers.gsr.high
    assert numbers.failures == {"missed": 1, "too wide": 1, "nothing found": 1}
    assert (numbers.attempts, numbers.rounds, numbers.objects, numbers.lost) == (6, 3, 7, 1)


def test_the_interval_is_the_one_of_wilson():
    """Nine of ten, as in any table of Wilson's intervals."""
    one = Round(0, 0, 10, 1, attempts=[attempt(True)] * 9 + [attempt(False)], skipped=[])
    numbers = summarise([one])
    assert (numbers.gsr.low, numbers.gsr.high) == pytest.approx((59.58, 98.21), abs=0.01)
    assert (numbers.dr.low, numbers.dr.high) == pytest.approx((59.58, 98.21), abs=0.01)


@pytest.mark.parametrize(
    ("text", "pictures", "skips"),
    [
        ("FSFSFF", 6, 0),  # a success resets the failures
        ("FFSSSS", 2, 0),
        ("F0F0SS", 3, 1),  # a picture without a grasp does not reset them
        ("F00S0S", 5, 3),
        ("0S0S0S", 5, 3),  # neither a success nor a failure resets the skips
        ("0F0S0S", 5, 3),
    ],
)
def test_two_failures_in_a_row_or_three_skips_in_all_end_a_round(text, pictures, skips):
    """The letters: S a success, F a failure, and 0 a picture in which nothing is found."""

    def take(number: int) -> Shot:
        letter = text[number]
        return skipped(number) if letter == "0" else replace(attempt(letter == "S"), attempt=number)

    attempts, without = until_over(take, lambda: 100)
    assert (len(attempts) + len(without), len(without)) == (pictures, skips)
    numbers = [each.attempt for each in (*attempts, *without)]
    assert sorted(numbers) == list(range(pictures)), "every picture has a camera of its own"
    assert [each.success for each in attempts] == [letter == "S" for letter in text[:pictures] if letter != "0"]


def test_an_empty_table_ends_a_round():
    left = iter([2, 1, 0])
    attempts, without = until_over(lambda number: attempt(True), lambda: next(left))
    assert (len(attempts), len(without)) == (2, 0)


def test_a_round_ends_after_three_pictures_in_which_nothing_is_found(world):
    played = play_round(ClutterJob(CHANCE, *world), 0, 0, NothingFound())
    assert (len(played.skipped), played.attempts, played.left) == (3, [], played.placed)


def test_a_round_ends_after_two_failures_in_a_row(world):
    played = play_round(ClutterJob(CHANCE, *world), 0, 0, AlwaysBeside())
    assert [each.cause for each in played.attempts] == ["missed", "missed"]
    assert played.left == played.placed


def test_a_round_begins_with_the_same_scene_and_camera_for_every_planner(world):
    first = round_scene(CHANCE, 1, 1, world[0])
    again = round_scene(replace(CHANCE, planner="oracle", protocol="strict"), 1, 1, world[0])
    assert [each.name for each in first.objects] == [each.name for each in again.objects]
    for one, other in zip(first.objects, again.objects, strict=True):
        np.testing.assert_array_equal(one.T_world_object, other.T_world_object)
    beside = play_round(ClutterJob(CHANCE, *world), 1, 1, AlwaysBeside())
    other = play_round(ClutterJob(replace(CHANCE, protocol="strict"), *world), 1, 1, AlwaysBeside())
    assert [each.camera for each in beside.attempts] == [each.camera for each in other.attempts]


def job_of(planner: str, world, **changes) -> ClutterJob:
    """A benchmark that has a round 17 of run 2."""
    return ClutterJob(replace(CHANCE, planner=planner, runs=3, rounds=18, **changes), *world)


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


def made_up_round(run: int, number: int) -> Round:
    """One success, one failure, one skip."""
    return Round(run, number, 2, 1, [attempt(True), attempt(False)], [skipped()])


def skipped(number: int = 2) -> Shot:
    return Shot(0, 0, number, [], [], [], np.eye(4).tolist())


def write_rounds(folder, count: int) -> None:
    """The first rounds of a benchmark."""
    numbers = [divmod(number, CHANCE.rounds) for number in range(count)]
    lines = [json.dumps(asdict(made_up_round(*each))) + "\n" for each in numbers]
    (folder / ROUNDS_FILE).write_text("".join(lines))


def test_the_report_has_what_others_read(tmp_path):
    """Its rounds are there already, so that nothing is played."""
    write_rounds(tmp_path, CHANCE.runs * CHANCE.rounds)
    run_clutter(CHANCE, tmp_path)
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["gsr"]["mean"] == report["dr"]["mean"] == 50.0
    assert {"mean", "std", "low", "high"} == report["gsr"].keys() == report["dr"].keys()
    assert (report["attempts"], report["rounds"], report["settings"]["protocol"]) == (8, 4, "edge")
    assert report["failures"] == {"missed": 4, "nothing found": 4}
    assert {"settings", "origin"} <= report.keys()


@pytest.fixture
def playing(monkeypatch):
    """Rounds that take no time, played with the source of a commit that the test chooses."""

    def play(folder, commit: str | None) -> dict[str, object]:
        """The report that comes of it."""

        def made_up(job, run, number, planner):
            return replace(made_up_round(run, number), commit=job.commit)

        monkeypatch.setattr(rounds, "play_round", made_up)
        monkeypatch.setattr(clutter, "source_commit", lambda: commit)
        run_clutter(CHANCE, folder)
        return json.loads((folder / REPORT_FILE).read_text())

    return play


def kill(folder, left: int) -> None:
    """Leaves some of the rounds, and no report."""
    lines = (folder / ROUNDS_FILE).read_text().splitlines(keepends=True)
    (folder / ROUNDS_FILE).write_text("".join(lines[:left]))
    (folder / REPORT_FILE).unlink()


def test_the_report_names_every_commit_that_rounds_were_played_with(tmp_path, playing):
    assert playing(tmp_path, "aaa")["commits"] == ["aaa"]
    kill(tmp_path, left=2)
    assert playing(tmp_path, "bbb-dirty")["commits"] == ["aaa", "bbb-dirty"]
    kill(tmp_path, left=3)
    assert playing(tmp_path, "aaa")["commits"] == ["aaa", "bbb-dirty"]


def test_a_finished_benchmark_goes_on_naming_the_code_that_made_it(tmp_path, playing):
    first = playing(tmp_path, "aaa")
    assert playing(tmp_path, "bbb") == first
    (tmp_path / REPORT_FILE).unlink()
    assert playing(tmp_path, "bbb")["commits"] == ["aaa"], "it only counted"


def test_with_one_worker_the_planner_is_made_once(tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(rounds, "load_planner", lambda source: made.append(source) or NothingFound())
    run_clutter(replace(CHANCE, runs=1), tmp_path)
    assert len(made) == 1
    assert len(read_rounds(tmp_path / ROUNDS_FILE)) == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda row: {key: row[key] for key in row if key != "skipped"}, "line 2: this round has no 'skipped'"),
        (lambda row: {**row, "weather": "fine"}, "line 2: not a round: .*weather"),
        (lambda row: {**row, "attempts": [{"run": 0}]}, "line 2: not a round: .*missing"),
        (lambda row: [row], "line 2: not a round"),
        (None, "line 2: not a round: Expecting"),
    ],
    ids=["lacks something", "says more", "half an attempt", "a list", "no JSON"],
)
def test_a_line_that_is_no_round_is_named(tmp_path, change, message):
    write_rounds(tmp_path, 3)
    lines = (tmp_path / ROUNDS_FILE).read_text().splitlines()
    lines[1] = "{" if change is None else json.dumps(change(json.loads(lines[1])))
    (tmp_path / ROUNDS_FILE).write_text("\n".join(lines) + "\n")
    with pytest.raises(DataError, match=f"{ROUNDS_FILE}, {message}"):
        read_rounds(tmp_path / ROUNDS_FILE)


def test_reading_rounds_leaves_a_cut_off_line_where_it_is(tmp_path):
    write_rounds(tmp_path, 2)
    with (tmp_path / ROUNDS_FILE).open("a") as file:
        file.write('{"run": 1')
    before = (tmp_path / ROUNDS_FILE).read_bytes()
    assert len(read_rounds(tmp_path / ROUNDS_FILE)) == 2
    assert (tmp_path / ROUNDS_FILE).read_bytes() == before


def test_the_hand_decides_and_is_in_the_report(tmp_path):
    write_rounds(tmp_path, CHANCE.runs * CHANCE.rounds)
    wide = replace(load_gripper(), name="wide", friction=0.5)
    (tmp_path / "wide.yaml").write_text(yaml.safe_dump(wide.to_dict()))
    config = replace(CHANCE, gripper=str(tmp_path / "wide.yaml"))
    run_clutter(config, tmp_path)
    assert Gripper.from_dict(json.loads((tmp_path / REPORT_FILE).read_text())["settings"]["gripper"]) == wide
    with pytest.raises(DataError, match="holds another benchmark: gripper is"):
        run_clutter(CHANCE, tmp_path)


def test_a_hand_that_published_weights_do_not_know_is_refused(tmp_path):
    wide = replace(load_gripper(), name="wide", friction=0.5)
    (tmp_path / "wide.yaml").write_text(yaml.safe_dump(wide.to_dict()))
    network = IcgNet(replace(NETWORKS["tiny"], affordance="contact"))
    save_weights(tmp_path / "one_hand.safetensors", network, {})
    with pytest.raises(InputError, match="wide"):
        load_planner(ClutterConfig(gripper=str(tmp_path / "wide.yaml"), weights=tmp_path / "one_hand.safetensors"))


@pytest.mark.slow
def test_a_killed_benchmark_goes_on_and_ends_as_an_uninterrupted_one(tmp_path):
    config = replace(CHANCE, runs=1, rounds=2)
    whole = run_clutter(config, tmp_path / "whole")
    lines = (tmp_path / "whole" / ROUNDS_FILE).read_text().splitlines(keepends=True)
    assert len(lines) == 2
    (tmp_path / "killed").mkdir()
    (tmp_path / "killed" / "config.json").write_text((tmp_path / "whole" / "config.json").read_text())
    (tmp_path / "killed" / ROUNDS_FILE).write_text(lines[0] + lines[1][:40])
    resumed = run_clutter(config, tmp_path / "killed", workers=2)
    assert replace(resumed, plan_seconds=0.0) == replace(whole, plan_seconds=0.0)

    def attempts(folder):
        found = sorted(read_rounds(tmp_path / folder / ROUNDS_FILE), key=lambda each: each.round)
        return [replace(attempt, plan_seconds=0.0) for each in found for attempt in each.attempts]

    assert attempts("killed") == attempts("whole")
    report = json.loads((tmp_path / "whole" / "report.json").read_text())
    assert report["gsr"] == asdict(whole.gsr)
    assert report["settings"]["protocol"] == "edge"


def test_a_folder_with_another_benchmark_is_refused(tmp_path):
    (tmp_path / "config.json").write_text(json.dumps({"scene": "pile"}))
    with pytest.raises(DataError, match="scene is 'pile' there, 'packed' now"):
        run_clutter(CHANCE, tmp_path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"seed": -1}, "seed must be at least 0, got -1"),
        ({"runs": 0}, "runs"),
    ],
)
def test_settings_out_of_range_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(CHANCE, **change)
