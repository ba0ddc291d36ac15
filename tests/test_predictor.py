"""The whole way from depth to grasps, with a small network that has random weights."""

import copy
import json
import pickle
import shutil
from dataclasses import replace

import numpy as np
import pytest
import torch
import trimesh
import yaml

from icgnet.errors import DataError, InputError, TableNotFoundError
from icgnet.geometry.camera import unproject
from icgnet.geometry.transforms import invert_transform, matrix_to_quaternion, transform_points
from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.grasping.collision import Reason, check_collisions, hits_table
from icgnet.grasping.frame import APPROACH_ANGLES
from icgnet.grasping.gripper import load_gripper
from icgnet.inference.candidates import score_contacts
from icgnet.inference.grasp_search import GraspSearch
from icgnet.inference.instances import find_instances
from icgnet.inference.prediction import FORMAT, NO_INSTANCE, Prediction
from icgnet.inference.rejections import KEPT
from icgnet.network.icgnet import IcgNet
from icgnet.network.weights import save_weights
from icgnet.predictor import Predictor
from tabletop_scenes import INTRINSICS, SHAPE, THREE_BOXES, WIDE_ROW, camera_pose, depth_image, tiny_network

QUICK = GraspSearch(contacts=96, max_checked=240, resample=False)


@pytest.fixture(scope="module")
def predictor() -> Predictor:
    return Predictor(tiny_network(), load_gripper(), QUICK)


@pytest.fixture(scope="module")
def depth() -> np.ndarray:
    return depth_image(THREE_BOXES, camera_pose())


@pytest.fixture(scope="module")
def in_camera(predictor, depth) -> Prediction:
    return predictor.predict_depth(depth, INTRINSICS)


@pytest.fixture(scope="module")
def in_world(predictor, depth) -> Prediction:
    return predictor.predict_depth(depth, INTRINSICS, camera_pose(), table_height=TABLE_HEIGHT)


@pytest.fixture(scope="module")
def wide(predictor) -> Prediction:
    pose = camera_pose(0.75)
    return predictor.predict_depth(depth_image(WIDE_ROW, pose), INTRINSICS, pose)


def test_results_are_in_the_world_with_a_pose_and_in_the_camera_without(in_world, in_camera):
    assert in_world.frame_id == "world"
    assert in_camera.frame_id == "camera"


def test_objects_are_the_measured_points_in_the_frame_of_the_result(in_camera, depth):
    grid = unproject(depth, INTRINSICS)
    assert len(in_camera.objects) > 0
    assert in_camera.instance_mask.shape == SHAPE
    for item in in_camera.objects:
        np.testing.assert_array_equal(item.points, grid[in_camera.instance_mask == item.instance_id])


def test_table_points_belong_to_no_object(in_world):
    table = np.abs(in_world.cloud.points[:, 2] - TABLE_HEIGHT) < 1e-6
    assert table.sum() > 1000
    assert (in_world.cloud_instances[table] == NO_INSTANCE).all()


def test_grasps_in_the_camera_frame_are_those_of_the_table_frame_turned(predictor, in_camera):
    T_table_camera = invert_transform(in_camera.T_frame_table)
    cloud = in_camera.cloud.transformed(T_table_camera, "table")
    in_table = predictor.predict_cloud(cloud.points, cloud.viewpoint, TABLE_HEIGHT)
    assert len(in_camera.grasps) > 0
    np.testing.assert_allclose(in_camera.grasps.poses, in_camera.T_frame_table @ in_table.grasps.poses, atol=1e-9)
    np.testing.assert_array_equal(in_camera.grasps.scores, in_table.grasps.scores)


def test_a_cloud_in_the_camera_frame_gives_what_its_depth_image_gives(predictor, in_camera, depth):
    grid = unproject(depth, INTRINSICS).reshape(-1, 3)
    from_cloud = predictor.predict_cloud(grid)
    assert from_cloud.frame_id == "camera"
    np.testing.assert_array_equal(from_cloud.grasps.poses, in_camera.grasps.poses)
    np.testing.assert_array_equal(from_cloud.instance_mask, in_camera.instance_mask.ravel())


def test_a_higher_table_lifts_the_grasps(predictor, in_world):
    lift = np.array([0.0, 0.0, 0.75])
    cloud = in_world.cloud
    lifted = predictor.predict_cloud(cloud.points + lift, cloud.viewpoint + lift, TABLE_HEIGHT + 0.75)
    np.testing.assert_allclose(lifted.grasps.poses[:, :3, 3], in_world.grasps.poses[:, :3, 3] + lift, atol=1e-6)


def test_a_wrong_depth_scale_is_set_right_by_a_table_of_known_height(predictor, in_world, depth):
    given = (INTRINSICS, camera_pose(), TABLE_HEIGHT)
    levelled = predictor.predict_depth(1.05 * depth, *given, level_table=True)
    np.testing.assert_allclose(levelled.cloud.points, in_world.cloud.points, atol=1e-3)
    as_measured = predictor.predict_depth(1.05 * depth, *given)
    assert np.abs(as_measured.cloud.points - in_world.cloud.points).max() > 0.02
    with pytest.raises(TableNotFoundError, match=r"at height 0\.05 m"):
        predictor.predict_depth(1.4 * depth, *given, level_table=True)
    right = predictor.predict_depth(depth, *given, level_table=True)
    np.testing.assert_array_equal(right.cloud.points, in_world.cloud.points)


def test_the_same_input_gives_the_same_result(predictor, in_world, depth):
    again = predictor.predict_depth(depth, INTRINSICS, camera_pose(), table_height=TABLE_HEIGHT)
    np.testing.assert_array_equal(again.grasps.poses, in_world.grasps.poses)
    np.testing.assert_array_equal(again.grasps.scores, in_world.grasps.scores)


def test_grasps_come_best_first_fit_the_hand_and_stay_above_the_table(in_world):
    grasps, gripper = in_world.grasps, load_gripper()
    assert (np.diff(grasps.scores) <= 0).all()
    assert ((grasps.widths >= 0) & (grasps.widths <= gripper.max_opening)).all()
    needed = gripper.opening(grasps.widths)
    wider = np.minimum(needed + QUICK.spare_opening, gripper.max_opening)
    assert ((grasps.openings == needed) | (grasps.openings == wider)).all()
    assert not hits_table(grasps.poses, grasps.openings, gripper, TABLE_HEIGHT).any()
    np.testing.assert_allclose(np.linalg.det(grasps.poses[:, :3, :3]), 1.0)


def test_every_candidate_is_kept_or_counted_as_rejected(predictor, in_world, depth, monkeypatch):
    scored = []

    def counting(network, shapes, contacts, *settings):
        scored.append(len(contacts.points))
        return score_contacts(network, shapes, contacts, *settings)

    monkeypatch.setattr("icgnet.predictor.score_contacts", counting)
    result = predictor.predict_depth(depth, INTRINSICS, camera_pose(), table_height=TABLE_HEIGHT)
    assert sum(scored) > 50
    assert sum(result.rejected.values()) + len(result.grasps) == len(APPROACH_ANGLES) * sum(scored)
    counted = {"low_score", "too_wide", "table", "object", "points", "unchecked"}
    assert set(in_world.rejected) == counted
    assert result.rejected == in_world.rejected


def test_every_object_knows_why_its_grasps_were_dropped(in_world):
    dropped, gripper = in_world.rejections, load_gripper()
    assert dropped.total() == in_world.rejected
    entries = in_world.to_dict()["objects"]
    assert [entry["rejected"] for entry in entries] == [dropped.of_object(k) for k in range(len(entries))]
    # The same checks say the same again, with the table and the measured points alone.
    T_table_frame = invert_transform(in_world.T_frame_table)
    for name in ("free", "table", "points"):
        grasps = in_world.grasps if name == "free" else dropped.for_reason(name)
        poses, points = grasps.transformed(T_table_frame).poses, transform_points(T_table_frame, in_world.cloud.points)
        met = check_collisions(poses, grasps.openings, gripper, lambda at: np.zeros(len(at)), TABLE_HEIGHT, points)
        assert len(poses) > 0, name
        assert (met.reason == Reason[name.upper()]).all(), name


def test_where_nothing_is_believed_in_the_best_is_kept_to_be_looked_at(predictor, depth):
    doubting = predictor.with_search(min_score=1.0).predict_depth(depth, INTRINSICS, camera_pose(), TABLE_HEIGHT)
    assert len(doubting.grasps) == 0
    for item in doubting.objects:
        assert doubting.rejections.of_object(item.instance_id)["low_score"] > 0
        own = doubting.rejections.grasps.scores[doubting.rejections.grasps.instances == item.instance_id]
        assert 0 < len(own) <= KEPT
        assert (np.diff(own) <= 0).all()


def test_rejected_grasps_are_saved_and_folders_without_them_are_read(in_camera, tmp_path):
    in_camera.save(tmp_path / "out")
    loaded = Prediction.load(tmp_path / "out").rejections
    np.testing.assert_array_equal(loaded.counts, in_camera.rejections.counts)
    np.testing.assert_array_equal(loaded.reasons, in_camera.rejections.reasons)
    np.testing.assert_array_equal(loaded.grasps.poses, in_camera.rejections.grasps.poses)
    assert len(loaded.grasps) > 0
    (tmp_path / "out" / "rejected.npz").unlink()
    edit_result(tmp_path / "out", lambda result: [entry.pop("rejected") for entry in result["objects"]])
    old = Prediction.load(tmp_path / "out")
    assert old.rejected == in_camera.rejected
    assert old.rejections.of_object(0) == {}
    assert "rejected" not in old.to_dict()["objects"][0]


def test_timings_name_the_stages(in_world):
    assert set(in_world.timings_ms) == {"input", "encode", "grasps", "collision", "select"}


def test_a_scene_wider_than_the_workspace_is_handled_whole(wide):
    lower = np.array([box.lower for box in WIDE_ROW])
    upper = np.array([box.upper for box in WIDE_ROW])
    points = wide.cloud.points
    for box in range(len(WIDE_ROW)):
        on_top = ((points >= lower[box] - 0.001) & (points <= upper[box] + 0.001)).all(axis=1)
        on_top &= points[:, 2] > TABLE_HEIGHT + 0.02
        assert on_top.sum() > 10
        assert (wide.cloud_instances[on_top] != NO_INSTANCE).mean() > 0.5
    assert sum(len(item.points) for item in wide.objects) == (wide.cloud_instances != NO_INSTANCE).sum()


def test_an_empty_table_has_no_objects_and_no_grasps(predictor):
    result = predictor.predict_depth(depth_image((), camera_pose()), INTRINSICS)
    assert result.objects == ()
    assert len(result.grasps) == 0
    assert len(result.best()) == len(result.highest()) == 0


def test_a_cloud_without_viewpoint_is_accepted(predictor, in_world):
    result = predictor.predict_cloud(in_world.cloud.points, table_height=TABLE_HEIGHT)
    assert result.frame_id == "world"
    assert result.cloud.viewpoint is None


def test_points_that_are_not_finite_are_left_out_but_keep_their_place(predictor, in_world):
    points = np.insert(in_world.cloud.points, [0, 500], np.nan, axis=0)
    result = predictor.predict_cloud(points, in_world.cloud.viewpoint, TABLE_HEIGHT)
    np.testing.assert_array_equal(np.delete(result.instance_mask, [0, 501]), in_world.cloud_instances)


def test_filters_keep_the_grasps_that_were_asked_for(in_world):
    best = in_world.best()
    instance = int(best.instances[0])
    name = in_world.class_of(instance)
    assert (in_world.of_instance(instance).grasps.instances == instance).all()
    assert {in_world.class_of(int(i)) for i in in_world.of_class(name).grasps.instances} == {name}
    middle = best.poses[0, :3, 3]
    assert 1 <= len(in_world.in_region(middle - 0.001, middle + 0.001).grasps) <= len(in_world.grasps)
    assert 1 <= len(in_world.distinct(limit=3).grasps) <= 3


def test_unknown_classes_and_objects_are_named(in_world):
    with pytest.raises(InputError, match=r"teapot.*mug, box"):
        in_world.of_class("teapot")
    with pytest.raises(InputError, match="no object 99"):
        in_world.of_instance(99)


def test_a_saved_prediction_reads_back(in_camera, tmp_path):
    in_camera.save(tmp_path / "out")
    loaded = Prediction.load(tmp_path / "out")
    np.testing.assert_array_equal(loaded.grasps.poses, in_camera.grasps.poses)
    np.testing.assert_array_equal(loaded.grasps.openings, in_camera.grasps.openings)
    np.testing.assert_array_equal(loaded.instance_mask, in_camera.instance_mask)
    np.testing.assert_allclose(loaded.cloud.points, in_camera.cloud.points, atol=1e-6)
    for mine, theirs in zip(in_camera.gripper.boxes(0.04), loaded.gripper.boxes(0.04), strict=True):
        np.testing.assert_allclose((*mine.centre, *mine.size), (*theirs.centre, *theirs.size), atol=1e-9)
    for mine, theirs in zip(in_camera.objects, loaded.objects, strict=True):
        assert (mine.class_name, len(mine.points)) == (theirs.class_name, len(theirs.points))
        assert (mine.score, mine.class_score) == (theirs.score, theirs.class_score)
        assert len(mine.mesh().faces) == len(theirs.mesh().faces)


def test_the_saved_files_hold_what_is_promised(in_camera, tmp_path):
    in_camera.save(tmp_path / "out")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert {"frame_id", "objects", "grasps", "rejected", "timings_ms"} <= set(result)
    assert result["frame_id"] == "camera"
    with np.load(tmp_path / "out" / "grasps.npz") as grasps:
        count = len(in_camera.grasps)
        assert grasps["grasps"].shape == (count, 4, 4)
        np.testing.assert_allclose(grasps["opening"], [entry["opening"] for entry in result["grasps"]])
        assert len(grasps["width"]) == len(grasps["score"]) == len(grasps["instance_id"]) == count
        assert str(grasps["frame_id"]) == "camera"
        assert grasps["class_name"].tolist() == [entry["class_name"] for entry in result["grasps"]]
    for entry in result["objects"]:
        assert (tmp_path / "out" / entry["mesh"]).is_file()


def test_a_search_that_ends_early_finds_the_same_best_grasps(predictor, in_world, depth):
    early = predictor.with_search(most=3).predict_depth(depth, INTRINSICS, camera_pose(), table_height=TABLE_HEIGHT)
    assert 3 <= len(early.grasps) < len(in_world.grasps)
    np.testing.assert_allclose(early.grasps.scores[:3], in_world.grasps.scores[:3])
    np.testing.assert_allclose(early.grasps.poses[:3], in_world.grasps.poses[:3])


def knowing(predictor: Predictor, **changes) -> IcgNet:
    """The network of a predictor as if it had been trained for another hand."""
    network = copy.copy(predictor.network)
    network.config = replace(network.config, gripper=replace(network.config.gripper, **changes))
    return network


def test_whoever_asks_what_is_in_the_way_gets_the_best_of_each_object_unchecked(predictor, in_world, depth):
    search = replace(QUICK, per_object=3)
    asking = Predictor(predictor.network, load_gripper(), search, only_free=False)
    result = asking.predict_depth(depth, INTRINSICS, camera_pose(), table_height=TABLE_HEIGHT)
    assert np.bincount(result.grasps.instances).max() == 3
    assert set(in_world.grasps.instances) <= set(result.grasps.instances)
    assert result.rejected["object"] == result.rejected["table"] == result.rejected["points"] == 0
    assert asking.with_search(per_object=1).only_free is False


def test_a_hand_that_published_weights_do_not_know_is_refused_in_one_line(predictor, tmp_path):
    wide = predictor.gripper.to_dict() | {"name": "wide", "max_opening": 0.1}
    (tmp_path / "wide.yaml").write_text(yaml.safe_dump(wide))
    network = IcgNet(replace(predictor.network.config, affordance="contact"))
    save_weights(tmp_path / "one_hand.safetensors", network, {})
    message = r"hand 'wide', but the weights know only 'franka' \('wide' has max_opening 0.1 instead of 0.08\)"
    with pytest.raises(InputError, match=message):
        Predictor.load(tmp_path / "one_hand.safetensors", gripper=tmp_path / "wide.yaml")
    with pytest.raises(InputError, match=message):
        Predictor(network, load_gripper(tmp_path / "wide.yaml"))


def test_any_hand_is_taken_and_one_unlike_all_others_is_warned_of(predictor, depth):
    usual = Predictor(predictor.network, load_gripper("robotiq_2f_140")).predict_depth(depth, INTRINSICS)
    assert usual.gripper.name == "robotiq_2f_140"
    assert not any("hand" in warning for warning in usual.warnings)
    huge = replace(predictor.gripper, name="huge", max_opening=0.2)
    (warning,) = Predictor(predictor.network, huge).predict_depth(depth, INTRINSICS).warnings
    assert warning == (
        "the hand 'huge' is outside of what the network has learned from: opening 200 mm, not 40 to 150 mm"
    )


def test_the_hand_of_the_weights_is_the_default_and_may_be_mounted_otherwise(predictor, tmp_path):
    save_weights(tmp_path / "wide.safetensors", knowing(predictor, name="wide", max_opening=0.1), {})
    loaded = Predictor.load(tmp_path / "wide.safetensors")
    assert (loaded.gripper.name, loaded.gripper.max_opening) == ("wide", 0.1)
    turned = predictor.gripper.to_dict() | {"base_quaternion": [0.0, 0.0, 0.0, 1.0]}
    (tmp_path / "turned.yaml").write_text(yaml.safe_dump(turned))
    save_weights(tmp_path / "tiny.safetensors", predictor.network, {})
    hand = Predictor.load(tmp_path / "tiny.safetensors", gripper=tmp_path / "turned.yaml").gripper
    np.testing.assert_allclose(hand.T_grasp_base[:3, :3], np.diag([-1.0, -1.0, 1.0]), atol=1e-12)


def test_classes_are_those_of_the_weights(predictor, in_world, depth, tmp_path):
    names = ("one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
    network = copy.copy(predictor.network)
    network.config = replace(network.config, classes=names)
    save_weights(tmp_path / "tiny.safetensors", network, {})
    loaded = Predictor.load(tmp_path / "tiny.safetensors", search=QUICK)
    result = loaded.predict_depth(depth, INTRINSICS, camera_pose(), TABLE_HEIGHT)
    assert result.classes == loaded.classes == names
    old = [predictor.classes.index(item.class_name) for item in in_world.objects]
    assert [names.index(item.class_name) for item in result.objects] == old
    result.save(tmp_path / "out")
    saved = Prediction.load(tmp_path / "out")
    assert (saved.classes, saved.gripper) == (names, predictor.gripper)
    assert len(saved.of_class("three").grasps) <= len(saved.grasps)
    with pytest.raises(InputError, match="unknown object class 'mug'; the classes are one, two, three"):
        saved.of_class("mug")


@pytest.mark.parametrize("opening", ["full", "predicted"])
def test_a_hand_that_comes_fully_open_is_checked_fully_open(predictor, depth, opening, monkeypatch):
    checked = []

    def spy(poses, openings, *args, **kwargs):
        checked.append(openings)
        return check_collisions(poses, openings, *args, **kwargs)

    monkeypatch.setattr("icgnet.inference.candidates.check_collisions", spy)
    searcher = predictor.with_search(opening=opening)
    searcher.predict_depth(depth, INTRINSICS, camera_pose(), TABLE_HEIGHT)
    assert (np.concatenate(checked) == predictor.gripper.max_opening).all() == (opening == "full")


def test_a_hand_that_comes_fully_open_is_reported_and_saved_fully_open(predictor, depth, tmp_path):
    result = predictor.with_search(opening="full").predict_depth(depth, INTRINSICS, camera_pose(), TABLE_HEIGHT)
    widest = predictor.gripper.max_opening
    assert len(result.grasps) > 0
    assert (result.grasps.openings == widest).all()
    assert {entry["opening"] for entry in result.to_dict()["grasps"]} == {widest}
    result.save(tmp_path / "out")
    assert (Prediction.load(tmp_path / "out").grasps.openings == widest).all()


def test_objects_say_how_sure_the_network_is_of_them(in_world):
    scores = [item.score for item in in_world.objects]
    assert all(0.0 < score <= 1.0 for score in scores)
    assert [entry["score"] for entry in in_world.to_dict()["objects"]] == scores


def test_a_prediction_of_an_earlier_version_is_refused(in_camera, tmp_path):
    in_camera.save(tmp_path)
    text = (tmp_path / "result.json").read_text()
    (tmp_path / "result.json").write_text(text.replace(FORMAT, "icgnet prediction 1"))
    with pytest.raises(DataError, match=f"{FORMAT}' but 'icgnet prediction 1': predict again"):
        Prediction.load(tmp_path)


def test_a_search_for_no_grasps_is_refused():
    with pytest.raises(InputError, match="most must be at least 1, got 0"):
        GraspSearch(most=0)


def test_a_folder_that_is_no_prediction_is_named(tmp_path):
    with pytest.raises(DataError, match=r"not a saved prediction"):
        Prediction.load(tmp_path)
    (tmp_path / "result.json").write_text('{"format": "other"}')
    with pytest.raises(DataError, match="not of the format"):
        Prediction.load(tmp_path)


def test_weights_load_and_predict_as_the_network_they_came_from(predictor, in_world, depth, tmp_path):
    save_weights(tmp_path / "tiny.safetensors", predictor.network, {})
    loaded = Predictor.load(tmp_path / "tiny.safetensors", threads=1, search=QUICK)
    result = loaded.predict_depth(depth, INTRINSICS, camera_pose(), table_height=TABLE_HEIGHT)
    np.testing.assert_allclose(result.grasps.poses, in_world.grasps.poses)


def test_missing_weights_and_wrong_threads_are_named(tmp_path):
    with pytest.raises(DataError, match=r"nowhere\.safetensors"):
        Predictor.load(tmp_path / "nowhere.safetensors")
    with pytest.raises(InputError, match="threads must be at least 1 and at most 256, got 0"):
        Predictor.load(threads=0)


LEFT_HANDED = np.diag([1.0, 1.0, -1.0, 1.0])
SHEARED = np.array([[1.0, 0.2, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"depth": np.zeros((120, 160))}, "no measured pixel"),
        ({"depth": np.full((120, 160), np.nan)}, "no measured pixel"),
        ({"depth": np.full((120, 160), 500.0)}, "looks like millimetres"),
        ({"depth": np.full((120, 160, 3), 0.5)}, r"shape \(h, w\), got \(120, 160, 3\)"),
        ({"intrinsics": np.zeros((3, 3))}, "singular"),
        ({"intrinsics": np.eye(4)}, r"shape \(3, 3\), got \(4, 4\)"),
        ({"camera_pose": LEFT_HANDED @ camera_pose()}, "right-handed"),
        ({"camera_pose": SHEARED @ camera_pose()}, "shear"),
        ({"camera_pose": np.eye(3)}, r"shape \(4, 4\), got \(3, 3\)"),
        ({"table_height": 0.05}, "needs a camera_pose"),
        ({"level_table": True, "camera_pose": camera_pose()}, "give camera_pose and table_height"),
        ({"mask": np.ones((3, 4))}, r"\(120, 160\), got \(3, 4\)"),
    ],
)
def test_wrong_depth_input_is_named(predictor, depth, changes, message):
    with pytest.raises(InputError, match=message):
        predictor.predict_depth(**{"depth": depth, "intrinsics": INTRINSICS, **changes})


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        (np.zeros((0, 3)), {}, "0 finite points"),
        (np.full((500, 3), np.nan), {}, r"0 finite points \(of 500 given\)"),
        (np.random.default_rng(0).normal(size=(99, 3)), {}, "99 finite points.*at least 100"),
        (np.zeros((500, 2)), {}, r"\(n, 3\)"),
        (1000 * np.random.default_rng(0).normal(size=(500, 3)), {}, "millimetres"),
        (np.random.default_rng(0).normal(size=(500, 3)), {}, "no table found"),
        (np.random.default_rng(0).normal(size=(500, 3)), {"viewpoint": (0, 0)}, "viewpoint must"),
        (np.random.default_rng(0).normal(size=(500, 3)), {"table_height": np.nan}, "table_height"),
    ],
)
def test_wrong_clouds_are_named(predictor, points, options, message):
    with pytest.raises(InputError, match=message):
        predictor.predict_cloud(points, **options)


def test_the_camera_pose_places_the_points(in_world, in_camera):
    np.testing.assert_allclose(in_world.cloud.points, transform_points(camera_pose(), in_camera.cloud.points))


def test_meshes_are_in_the_frame_of_the_result(in_world):
    item = in_world.objects[0]
    mesh = item.mesh()
    assert isinstance(mesh, trimesh.Trimesh)
    assert item.mesh() is mesh, "extracted once"
    if not mesh.is_empty:
        assert (mesh.bounds[0] > item.points.min(axis=0) - 0.05).all()
        assert (mesh.bounds[1] < item.points.max(axis=0) + 0.05).all()


def test_the_rule_of_the_papers_robot_puts_the_highest_of_the_sure_ones_first(predictor, depth, monkeypatch):
    # Random weights: shifted up, and sure of what is an object, so that some scores reach the ladder.
    def sure_of(*given):
        return [replace(item, score=1.0) for item in find_instances(*given)]

    monkeypatch.setattr("icgnet.predictor.find_instances", sure_of)
    sure = copy.deepcopy(predictor.network)
    with torch.no_grad():
        sure.affordance.success.bias += 2.0
    searching = Predictor(sure, search=replace(QUICK, select="highest"))
    result = searching.predict_depth(depth, INTRINSICS, camera_pose(), table_height=TABLE_HEIGHT)
    assert len(result.grasps) > 1
    assert (result.grasps.scores > 0.7).all()
    np.testing.assert_array_equal(result.best().poses, result.highest().poses)
    top = result.grasps.scores > (0.9 if (result.grasps.scores > 0.9).any() else 0.8)
    assert result.best().poses[0, 2, 3] == result.grasps.poses[top, 2, 3].max()


@pytest.mark.parametrize("height", [np.nan, np.inf, -np.inf, "0.05", [0.05], 1e6])
def test_a_table_height_is_a_finite_number(predictor, depth, height):
    with pytest.raises(InputError, match="table_height"):
        predictor.predict_depth(depth, INTRINSICS, camera_pose(), table_height=height)


@pytest.mark.parametrize("mask", [np.full(SHAPE, "everywhere"), np.full(SHAPE, np.nan), np.ma.masked_all(SHAPE, bool)])
def test_a_mask_that_says_nothing_is_refused(predictor, depth, mask):
    with pytest.raises(InputError, match="mask must be"):
        predictor.predict_depth(depth, INTRINSICS, mask=mask)


def test_masked_depth_is_not_measured(predictor, depth):
    hidden = np.zeros(SHAPE, dtype=bool)
    hidden[:, :80] = True
    masked = predictor.predict_depth(np.ma.array(depth, mask=hidden), INTRINSICS, camera_pose())
    assert not hidden.ravel()[masked.input_rows].any()


def test_a_pose_in_millimetres_is_named(predictor, depth):
    pose = camera_pose()
    pose[:3, 3] *= 1000.0
    with pytest.raises(InputError, match="millimetres"):
        predictor.predict_depth(depth, INTRINSICS, pose)


def test_a_pose_may_be_position_and_quaternion_and_the_world_has_any_name(predictor, in_world, depth):
    pose = camera_pose()
    numbers = [*pose[:3, 3], *matrix_to_quaternion(pose[:3, :3])]
    result = predictor.predict_depth(depth, INTRINSICS, numbers, table_height=TABLE_HEIGHT, frame_id="base_link")
    assert result.frame_id == result.cloud.frame_id == "base_link"
    np.testing.assert_allclose(result.cloud.points, in_world.cloud.points, atol=1e-9)
    with pytest.raises(InputError, match="frame_id"):
        predictor.predict_depth(depth, INTRINSICS, numbers, frame_id="")


def test_a_pixel_at_the_end_of_the_world_is_not_measured(predictor, depth):
    far = depth.copy()
    far[0, :5] = 1e155
    assert (predictor.predict_depth(far, INTRINSICS).input_rows >= 5).all()


@pytest.mark.parametrize("seed", [-1, 1.5, "0", True, None])
def test_a_seed_is_a_whole_number(predictor, seed):
    with pytest.raises(InputError, match="seed must be a whole number"):
        Predictor(predictor.network, predictor.gripper, seed=seed)


def edit_result(folder, change):
    path = folder / "result.json"
    result = json.loads(path.read_text())
    change(result)
    path.write_text(json.dumps(result))


def edit_arrays(folder, name, **changes):
    with np.load(folder / name) as saved:
        arrays = dict(saved)
    np.savez(folder / name, **{**arrays, **changes})


EDITS = {
    "no list of objects": lambda folder: edit_result(folder, lambda result: result.update(objects=3)),
    "a score of 2": lambda folder: edit_result(folder, lambda result: result["objects"][0].update(score=2.0)),
    "a score of NaN": lambda folder: edit_result(folder, lambda result: result["objects"][0].update(score=np.nan)),
    "a class that is a path": lambda folder: edit_result(
        folder, lambda result: result["objects"][0].update(class_name="../../x")
    ),
    "another number": lambda folder: edit_result(folder, lambda result: result["objects"][0].update(instance_id="0")),
    "a mesh elsewhere": lambda folder: edit_result(folder, lambda result: result["objects"][0].update(mesh="/a.ply")),
    "a mesh above": lambda folder: edit_result(folder, lambda result: result["objects"][0].update(mesh="../a.ply")),
    "a frame without name": lambda folder: edit_result(folder, lambda result: result.update(frame_id=None)),
    "a table that is scaled": lambda folder: edit_result(
        folder, lambda result: result.update(T_frame_table=np.diag([2.0, 2.0, 2.0, 1.0]).tolist())
    ),
    "counts of text": lambda folder: edit_result(folder, lambda result: result.update(rejected={"table": "many"})),
    "points of text": lambda folder: edit_arrays(folder, "cloud.npz", points=np.full((5, 3), "x")),
    "an input of an exabyte": lambda folder: edit_arrays(folder, "cloud.npz", input_shape=np.array([10**8, 10**8])),
    "a viewpoint nowhere": lambda folder: edit_arrays(folder, "cloud.npz", viewpoint=np.array([np.inf, 0.0, 0.0])),
    "rows beyond the input": lambda folder: edit_arrays(folder, "cloud.npz", input_shape=np.array([2, 2])),
    "fewer scores than grasps": lambda folder: edit_arrays(folder, "grasps.npz", score=np.ones(1)),
    "instances that are not": lambda folder: edit_arrays(folder, "grasps.npz", instance_id=np.full(1, 99)),
    "a reason of its own": lambda folder: edit_arrays(folder, "rejected.npz", reason=np.full(1, "bad luck")),
    "half a drop": lambda folder: edit_result(
        folder, lambda result: result["objects"][0]["rejected"].update(table=-0.5)
    ),
    "left-handed grasps": lambda folder: edit_arrays(folder, "grasps.npz", grasps=np.diag([1.0, 1, -1, 1])[None]),
}


@pytest.fixture(scope="module")
def saved_prediction(in_camera, tmp_path_factory):
    folder = tmp_path_factory.mktemp("saved") / "out"
    in_camera.save(folder)
    return folder


@pytest.mark.parametrize("edit", EDITS)
def test_a_saved_prediction_that_was_edited_to_nonsense_is_refused(saved_prediction, tmp_path, edit):
    folder = tmp_path / "out"
    shutil.copytree(saved_prediction, folder)
    EDITS[edit](folder)
    with pytest.raises(DataError, match="not a saved prediction") as error:
        Prediction.load(folder)
    assert "\n" not in str(error.value)


def test_a_prediction_can_be_pickled_with_its_meshes(in_camera):
    again = pickle.loads(pickle.dumps(in_camera))
    np.testing.assert_array_equal(again.grasps.poses, in_camera.grasps.poses)
    for item, same in zip(in_camera.objects, again.objects, strict=True):
        np.testing.assert_array_equal(item.mesh().vertices, same.mesh().vertices)


def test_class_names_are_no_part_of_a_path(in_camera, tmp_path):
    item = replace(in_camera.objects[0], class_name="../../a/b")
    replace(in_camera, objects=(item, *in_camera.objects[1:])).save(tmp_path / "out")
    assert (tmp_path / "out" / "meshes" / "00_______a_b.ply").is_file()


def test_a_region_is_made_of_numbers(in_camera):
    for corner in ("here", [0.0, np.nan, 0.0], [0.0, 0.0]):
        with pytest.raises(InputError, match="region"):
            in_camera.in_region(corner, np.ones(3))


def test_of_too_many_objects_and_points_some_are_looked_at_and_the_rest_is_counted(predictor, wide, monkeypatch):
    assert wide.left_out["points"] == wide.left_out["objects"] == 0
    monkeypatch.setattr("icgnet.predictor.MOST_OBJECTS", 1)
    monkeypatch.setattr("icgnet.inference.instances.MOST_POINTS", 400)
    pose = camera_pose(0.75)
    bounded = predictor.predict_depth(depth_image(WIDE_ROW, pose), INTRINSICS, pose)
    assert len(bounded.objects) == 1
    assert bounded.left_out["points"] > 0
    assert bounded.to_dict()["left_out"] == bounded.left_out


def test_a_budget_leaves_checks_out_and_says_so(predictor, wide):
    pose = camera_pose(0.75)
    hasty = predictor.with_search(budget_ms=1.0).predict_depth(depth_image(WIDE_ROW, pose), INTRINSICS, pose)
    assert hasty.rejected["unchecked"] > wide.rejected["unchecked"]
    assert len(hasty.objects) == len(wide.objects)
    generous = predictor.with_search(budget_ms=1e6).predict_depth(depth_image(WIDE_ROW, pose), INTRINSICS, pose)
    assert generous.rejected == wide.rejected


def test_the_result_names_the_plane_that_was_taken_for_the_table(in_camera, in_world, tmp_path):
    assert in_world.supports == ()
    (plane, *_) = in_camera.supports
    np.testing.assert_allclose(plane.normal, in_camera.T_frame_table[:3, 2])
    assert 0.3 < plane.share < 1.0
    assert plane.height == pytest.approx(-0.435, abs=0.005)
    told = replace(in_camera, warnings=("the table was a close choice",))
    told.save(tmp_path / "told")
    loaded = Prediction.load(tmp_path / "told")
    assert loaded.supports == in_camera.supports
    assert loaded.warnings == told.warnings


def test_a_height_that_contradicts_the_picture_is_a_warning(predictor, depth):
    result = predictor.predict_depth(depth, INTRINSICS, camera_pose(), table_height=TABLE_HEIGHT - 0.05)
    assert "given as 0.000 m" in result.warnings[0]


def test_a_world_that_is_not_known_cannot_be_named(predictor, depth):
    with pytest.raises(InputError, match="frame_id 'map' names a world that is not known"):
        predictor.predict_depth(depth, INTRINSICS, frame_id="map")
