"""The built-in planners: their contract, and how good they are."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import KDTree

from box_objects import EDGE, RADIUS, BoxAndBall, placed
from icgnet.benchmark.config import ClutterConfig
from icgnet.benchmark.observation import Observation, observe
from icgnet.benchmark.planner import Plan, Planner
from icgnet.benchmark.planners import icgnet as icgnet_planner
from icgnet.benchmark.planners.antipodal import AntipodalPlanner
from icgnet.benchmark.planners.chance import RandomPlanner
from icgnet.benchmark.planners.icgnet import IcgNetPlanner, cloud_on_table
from icgnet.benchmark.planners.oracle import OraclePlanner, can_hold
from icgnet.benchmark.true_shapes import TrueShapes
from icgnet.errors import InputError
from icgnet.geometry.clouds import PointCloud
from icgnet.geometry.transforms import make_transform
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.collision import hits_table
from icgnet.grasping.gripper import load_gripper
from icgnet.network.weights import save_weights
from icgnet.objects.object_set import ObjectSet, load_object_set
from icgnet.simulation.config import Physics
from icgnet.simulation.physics import Body
from icgnet.simulation.scene import PlacedObject, Scene
from icgnet.simulation.scenes import spawn_scene
from icgnet.simulation.surroundings import Surroundings, block
from icgnet.simulation.trials import Outcome, Trials
from icgnet.simulation.workcell import PROTOCOLS, Workcell
from tabletop_scenes import tiny_network

NAMES = ("icgnet", "antipodal", "random", "oracle")
FRANKA = load_gripper()
NEIGHBOURS = [(EDGE, 0.0), (-EDGE, 0.0), (0.0, EDGE), (0.0, -EDGE)]


@pytest.fixture(scope="module")
def objects() -> ObjectSet:
    return load_object_set("procedural")


@pytest.fixture(scope="module")
def planners(tmp_path_factory) -> dict[str, Planner]:
    weights = tmp_path_factory.mktemp("weights") / "tiny.safetensors"
    save_weights(weights, tiny_network(), {})
    return {
        "icgnet": IcgNetPlanner(ClutterConfig(weights=weights)),
        "antipodal": AntipodalPlanner(),
        "random": RandomPlanner(),
        "oracle": OraclePlanner(),
    }


@pytest.fixture(scope="module")
def scene(objects) -> Scene:
    return spawn_scene("pile", objects, "val", np.random.default_rng(0), 4)


def look(scene: Scene, objects: ObjectSet, seed: int = 0, full_opening: bool = False) -> Observation:
    rng = np.random.default_rng(seed)
    observation = observe(scene, objects, "random", "gaussian", FRANKA, full_opening, rng)
    return replace(observation, rng=np.random.default_rng(seed), truth=TrueShapes(scene, objects))


def empty_table(objects: ObjectSet) -> Observation:
    nothing = Scene("pile", ())
    return replace(look(nothing, objects), cloud=PointCloud(np.zeros((0, 3)), np.array([0.5, 0.5, 0.5])))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("full_opening", [False, True])
def test_plans_are_ranked_proper_grasps_of_this_hand(planners, scene, objects, name, full_opening):
    plan = planners[name].plan(look(scene, objects, full_opening=full_opening))
    assert len(plan) > 0
    rotations = plan.poses[:, :3, :3]
    np.testing.assert_allclose(
        rotations @ rotations.transpose(0, 2, 1), np.broadcast_to(np.eye(3), rotations.shape), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    np.testing.assert_array_equal(plan.poses[:, 3], np.broadcast_to([0, 0, 0, 1], (len(plan), 4)))
    assert (np.diff(plan.scores) <= 0).all()
    assert ((plan.openings > 0) & (plan.openings <= FRANKA.max_opening)).all()
    assert not full_opening or (plan.openings == FRANKA.max_opening).all()


@pytest.mark.parametrize("name", NAMES)
def test_the_same_random_stream_gives_the_same_plan(planners, scene, objects, name):
    first, again, other = (planners[name].plan(look(scene, objects, seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.poses, again.poses)
    np.testing.assert_array_equal(first.scores, again.scores)
    assert first.poses.shape != other.poses.shape or not np.allclose(first.poses, other.poses)


@pytest.mark.parametrize("name", NAMES)
def test_where_nothing_is_seen_nothing_is_planned(planners, objects, name):
    assert len(planners[name].plan(empty_table(objects))) == 0


@pytest.mark.parametrize("name", ["icgnet", "antipodal", "oracle"])
def test_planned_hands_stay_above_the_table(planners, scene, objects, name):
    observation = look(scene, objects)
    plan = planners[name].plan(observation)
    assert len(plan) > 0
    assert not hits_table(plan.poses, plan.openings, FRANKA, observation.table_height).any()


def test_the_details_of_the_network_are_its_prediction(planners, scene, objects):
    observation = look(scene, objects)
    plan = planners["icgnet"].plan(observation)
    np.testing.assert_array_equal(plan.details.grasps.poses, plan.poses)
    assert len(plan.details.cloud) == len(observation.cloud)


@pytest.mark.parametrize("has_target", [False, True])
def test_with_a_target_the_search_does_not_end_with_the_best_of_other_objects(
    planners, scene, objects, has_target, monkeypatch
):
    searches = []

    class Spy(icgnet_planner.Predictor):
        def predict_cloud(self, *given):
            searches.append(self.search)
            return super().predict_cloud(*given)

    monkeypatch.setattr(icgnet_planner, "Predictor", Spy)
    observation = look(scene, objects)
    target = np.ones_like(observation.depth, bool) if has_target else None
    planners["icgnet"].plan(replace(observation, target=target))
    assert [search.most for search in searches] == [None if has_target else 5]


def test_the_oracle_alone_needs_the_truth(planners, scene, objects):
    assert {name for name, planner in planners.items() if planner.needs_truth} == {"oracle"}
    with pytest.raises(InputError, match="needs the true scene"):
        planners["oracle"].plan(replace(look(scene, objects), truth=None))


def test_the_oracle_grasps_what_lies_flat(objects):
    # Lower than the finger tips reach past a contact: only a hand that is drawn back can hold it.
    boxes = [name for name in objects.names("pile", "val") if objects.class_name(name) == "box"]
    name = min(boxes, key=lambda key: objects.model(key).visual.extents.min())
    extents = objects.model(name).visual.extents
    scale = 0.016 / extents.min()
    turn = np.roll(np.eye(3), 2 - int(extents.argmin()), axis=0)
    vertices = objects.model(name).visual.vertices @ turn.T * scale
    pose = make_transform(turn, np.array([0.15, 0.15, TABLE_HEIGHT - vertices[:, 2].min()]))
    scene = Scene("pile", (PlacedObject(name, scale, pose),))
    plan = OraclePlanner().plan(look(scene, objects))
    assert np.ptp(vertices[:, 2]) == pytest.approx(0.016)
    assert Workcell(scene, objects, FRANKA).execute(plan.poses[0], plan.openings[0], PROTOCOLS["strict"]).success


def test_the_oracle_ranks_the_grasp_that_succeeded_first(scene, objects, monkeypatch):
    tried = []

    def third_succeeds(self, pose, opening, target):
        tried.append(pose)
        return Outcome(len(tried) == 3, False)

    monkeypatch.setattr(Trials, "run", third_succeeds)
    plan = OraclePlanner().plan(look(scene, objects))
    np.testing.assert_array_equal(plan.poses[:3], [tried[2], tried[0], tried[1]])
    assert (np.diff(plan.scores) <= 0).all()


def holdable(scene: Scene, index: int = 0) -> bool:
    return can_hold(scene, index, BoxAndBall(), FRANKA, np.random.default_rng(0))


def test_a_hand_holds_what_fits_whatever_stands_beside_it():
    """Boxes touch a box at all four sides, so that no finger has room there."""
    box = ("box", (0.15, 0.15, TABLE_HEIGHT + EDGE / 2))
    assert holdable(placed(box))
    sides = ((0.15 + along, 0.15 + across, TABLE_HEIGHT + EDGE / 2) for along, across in NEIGHBOURS)
    assert holdable(placed(box, *(("box", side) for side in sides)))


def test_a_hand_holds_nothing_that_is_wider_than_it_opens():
    wide = placed(("box", (0.15, 0.15, TABLE_HEIGHT + EDGE / 2)))
    assert not holdable(replace(wide, objects=(replace(wide.objects[0], scale=2.0),)))


def upright_at(*place: float) -> np.ndarray:
    return make_transform(np.eye(3), np.array(place))


def test_a_hand_holds_nothing_that_it_has_no_way_to():
    """A ball in a box without a lid, too narrow and deep for the hand."""
    walls = [
        block("wall", (0.16, 0.02, 0.3), upright_at(0.15, 0.15 + 0.06, TABLE_HEIGHT + 0.15)),
        block("wall", (0.16, 0.02, 0.3), upright_at(0.15, 0.15 - 0.06, TABLE_HEIGHT + 0.15)),
        block("wall", (0.02, 0.10, 0.3), upright_at(0.15 + 0.06, 0.15, TABLE_HEIGHT + 0.15)),
        block("wall", (0.02, 0.10, 0.3), upright_at(0.15 - 0.06, 0.15, TABLE_HEIGHT + 0.15)),
    ]
    around = Surroundings((-0.15, -0.15, 0.45, 0.45), tuple(walls))
    ball = placed(("ball", (0.15, 0.15, TABLE_HEIGHT + RADIUS)))
    assert holdable(ball)
    assert not holdable(replace(ball, kind="table", surroundings=around))


def test_a_hand_holds_nothing_that_slips_in_every_trial(monkeypatch):
    monkeypatch.setattr(Trials, "run", lambda *given: Outcome(False, False))
    assert not holdable(placed(("box", (0.15, 0.15, TABLE_HEIGHT + EDGE / 2))))


@pytest.mark.parametrize(("wide", "disturbed"), [(True, True), (True, False), (False, True)])
def test_on_tables_and_in_bins_the_oracle_finds_nothing_that_would_move_others(
    planners, scene, objects, wide, disturbed, monkeypatch
):
    monkeypatch.setattr(Trials, "run", lambda *given: Outcome(True, disturbed))
    plan = planners["oracle"].plan(replace(look(scene, objects), is_wide=wide))
    assert (len(plan) == 0) == (wide and disturbed)


def play(planner: Planner, objects: ObjectSet, kind, seed: int, protocol: str) -> tuple[int, int]:
    """Attempts and successes in one scene, until it is empty, two in a row fail, or nothing is found."""
    scene = spawn_scene(kind, objects, "val", np.random.default_rng([7, seed]), 5)
    cell = Workcell(scene, objects, FRANKA)
    attempts = successes = failures = 0
    while len(cell.remaining) and failures < 2:
        plan: Plan = planner.plan(look(cell.scene(), objects, 100 * seed + attempts, protocol == "edge"))
        if len(plan) == 0:
            break
        execution = cell.execute(plan.poses[0], float(plan.openings[0]), PROTOCOLS[protocol])
        attempts, successes = attempts + 1, successes + execution.success
        failures = 0 if execution.success else failures + 1
    return attempts, successes


@pytest.mark.slow
def test_the_oracle_hardly_ever_fails(objects):
    games = (("packed", "strict", 0), ("pile", "strict", 1), ("pile", "edge", 2), ("pile", "strict", 3))
    counts = {(kind, *rest): play(OraclePlanner(), objects, kind, rest[1], rest[0]) for kind, *rest in games}
    attempts, successes = np.sum(list(counts.values()), axis=0)
    assert attempts >= 14
    assert successes >= 0.99 * attempts, counts


def share_of_successes(planner: Planner, scene: Scene) -> float:
    """Of the first grasps of plans from eight places, all for objects that stand apart, in trials with an approach."""
    own = BoxAndBall()
    bodies = [Body(own.model(each.name), each.scale, each.T_world_object) for each in scene.objects]
    centres = np.array([each.T_world_object[:3, 3] for each in scene.objects])
    trials = Trials(bodies, FRANKA, Physics())
    successes: list[bool] = []
    for seed in range(8):
        plan = planner.plan(look(scene, own, seed, full_opening=True))
        for pose, opening in zip(plan.poses[:2], plan.openings[:2], strict=True):
            target = int(np.linalg.norm(centres - pose[:3, 3], axis=1).argmin())
            successes.append(trials.run_with_approach(pose, float(opening), target).success)
    assert len(successes) >= 12
    return float(np.mean(successes))


def test_seeing_opposed_points_beats_chance():
    """Balls that nothing settled, so that every processor has the same scene."""
    height = TABLE_HEIGHT + RADIUS
    scene = placed(("ball", (0.09, 0.1, height)), ("ball", (0.21, 0.2, height)))
    antipodal, chance = (share_of_successes(planner, scene) for planner in (AntipodalPlanner(), RandomPlanner()))
    assert antipodal >= 0.75
    assert chance <= 0.5


@pytest.mark.parametrize("gain", [0.95, 1.0, 1.05])
def test_a_wrong_depth_scale_is_taken_out_where_the_table_tells_it(scene, objects, gain):
    right = observe(scene, objects, "side", "none", FRANKA, True, np.random.default_rng(0))
    nothing = PointCloud(np.zeros((0, 3)), right.cloud.viewpoint)
    cloud = cloud_on_table(replace(right, depth=gain * right.depth, cloud=nothing))
    if gain == 1.0:
        assert cloud is nothing
        return
    assert KDTree(right.cloud.points).query(cloud.points)[0].max() < 0.004
    assert len(cloud) == pytest.approx(len(right.cloud), rel=0.05)
