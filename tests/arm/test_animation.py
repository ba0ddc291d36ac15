"""The motion of a plan, for films and pages."""

import numpy as np
import pytest
import trimesh

import needs_arm  # noqa: F401
from arm_scenes import DROP, T_BASE_FRAME, box, link_meshes
from icgnet.arm.animation import motion_of
from icgnet.arm.motion import Motion
from icgnet.arm.pick import plan_pick
from icgnet.arm.settings import PickSettings
from icgnet.errors import DataError, InputError
from icgnet.geometry.transforms import invert_transform

CUBOID = (0.05, 0.04, 0.10)


@pytest.fixture(scope="module")
def dropped(fr3, seen):
    meshes = [box(CUBOID), box(CUBOID, y=0.26)]
    return plan_pick(seen(meshes), fr3, T_BASE_FRAME, DROP)


@pytest.fixture(scope="module")
def placed(fr3, seen):
    return plan_pick(seen([box(CUBOID)]), fr3, T_BASE_FRAME, np.array([0.35, 0.35, 0.0]), PickSettings(release="place"))


def part(motion, name):
    return next(each for each in motion.parts if each.name == name)


def ends(plan):
    names = [phase.name for phase in plan.phases]
    return dict(zip(names, np.cumsum([phase.trajectory.duration for phase in plan.phases]), strict=True))


def bounds(motion, name, moment):
    each = part(motion, name)
    return trimesh.transform_points(each.mesh.vertices, each.at(moment))


def test_the_object_rides_with_the_hand_from_grasp_to_release(fr3, dropped):
    motion = motion_of(dropped, fr3)
    palm, target, at = part(motion, "palm"), part(motion, "object 0"), ends(dropped)
    held = [m for m, time in enumerate(motion.times) if at["close"] < time <= at["release"]]
    before = [m for m, time in enumerate(motion.times) if time <= at["close"]]
    assert len(held) > 40
    in_hand = np.stack([invert_transform(palm.at(m)) @ target.at(m) for m in held])
    np.testing.assert_allclose(in_hand, np.broadcast_to(in_hand[0], in_hand.shape), atol=1e-9)
    for moment in before:
        np.testing.assert_allclose(target.at(moment), np.eye(4), atol=1e-12)
    # No jump when it is gripped: it moves by less than the hand can in one frame.
    assert np.abs(target.at(held[0])[:3, 3]).max() < 0.02
    lower = bounds(motion, "object 0", held[-1]).min(axis=0)
    assert lower[2] == pytest.approx(DROP[2], abs=2e-3)
    assert target.at(len(motion.times) - 1) is None


def test_everything_else_stands(fr3, dropped):
    motion = motion_of(dropped, fr3)
    assert not part(motion, "object 1").moves
    assert not part(motion, "support").moves
    links = [each for each in motion.parts if each.kind == "arm"]
    assert len(links) == len(fr3.link_shapes)
    start = link_meshes(fr3, fr3.home)
    for each, mesh in zip(links, start, strict=True):
        np.testing.assert_allclose(trimesh.transform_points(each.mesh.vertices, each.at(0)), mesh.vertices, atol=1e-9)


def test_the_fingers_are_as_far_apart_as_commanded(fr3, dropped):
    motion = motion_of(dropped, fr3)
    apart = np.linalg.norm(
        part(motion, "left finger").poses[:, :3, 3] - part(motion, "right finger").poses[:, :3, 3], axis=1
    )
    at = ends(dropped)
    np.testing.assert_allclose(apart[motion.times <= at["approach"]], 0.052, atol=1e-9)
    np.testing.assert_allclose(apart[(motion.times > at["close"]) & (motion.times <= at["carry"])], 0.04, atol=1e-9)
    np.testing.assert_allclose(apart[motion.times > at["release"]], 0.08, atol=1e-9)
    closing = apart[(motion.times > at["approach"]) & (motion.times < at["close"])]
    assert (np.diff(closing) < 0).all()
    assert len(closing) >= 2


def test_a_placed_object_stays_where_it_was_placed(fr3, placed):
    motion = motion_of(placed, fr3)
    last = bounds(motion, "object 0", len(motion.times) - 1)
    np.testing.assert_allclose((last.min(axis=0) + last.max(axis=0))[:2] / 2, (0.35, 0.35), atol=1e-3)
    assert last[:, 2].min() == pytest.approx(0.002, abs=5e-4)
    after = motion.times > ends(placed)["release"]
    assert after.sum() > 10
    assert np.ptp(part(motion, "object 0").poses[after], axis=0).max() == 0.0


def test_an_object_that_was_left_out_of_account_is_shown(fr3, seen):
    plan = plan_pick(seen([box(CUBOID)]), fr3, T_BASE_FRAME, DROP, PickSettings(check_carried=False))
    target = part(motion_of(plan, fr3), "object 0")
    assert target.moves
    assert np.ptp(target.poses[:, 2, 3]) > 0.1


def test_a_motion_is_saved_and_read_back(fr3, dropped, tmp_path):
    motion = motion_of(dropped, fr3)
    motion.write(tmp_path / "motion.npz")
    again = Motion.load(tmp_path / "motion.npz")
    assert (tmp_path / "motion.npz").stat().st_size < 2_000_000
    assert (again.title, again.captions) == (motion.title, motion.captions)
    np.testing.assert_allclose(again.times, motion.times)
    for first, second in zip(motion.parts, again.parts, strict=True):
        assert (first.name, first.kind, first.instance) == (second.name, second.kind, second.instance)
        np.testing.assert_allclose(first.poses, second.poses, atol=1e-6)
        np.testing.assert_array_equal(first.shown, second.shown)
        np.testing.assert_allclose(first.mesh.vertices, second.mesh.vertices, atol=1e-6)
        np.testing.assert_array_equal(first.mesh.faces, second.mesh.faces)


def test_captions_are_those_of_the_phase(fr3, dropped):
    motion, at = motion_of(dropped, fr3), ends(dropped)
    assert motion.caption(0.0).startswith("reach")
    assert motion.caption(at["lift"]).startswith("lift")
    assert motion.caption(motion.duration + 1.0).startswith("return")
    assert motion.duration == pytest.approx(dropped.duration)


def test_a_file_that_is_no_motion_is_refused(tmp_path, fr3, dropped):
    np.savez(tmp_path / "motion.npz", format="another")
    with pytest.raises(DataError, match="is not a saved motion"):
        Motion.load(tmp_path / "motion.npz")
    motion_of(dropped, fr3, np.array([0.0, 1.0])).write(tmp_path / "motion.npz")
    with np.load(tmp_path / "motion.npz") as saved:
        entries = dict(saved)
    np.savez(tmp_path / "motion.npz", **entries | {"poses": entries["poses"][:-1]})
    with pytest.raises(DataError, match="poses are not those of"):
        Motion.load(tmp_path / "motion.npz")


def test_a_plan_without_phases_has_no_motion(fr3, seen):
    plan = plan_pick(seen([box(CUBOID, x=1.2)]), fr3, T_BASE_FRAME, DROP)
    with pytest.raises(InputError, match="a motion needs a plan with phases"):
        motion_of(plan, fr3)
