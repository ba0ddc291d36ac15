"""Plans that break their promises are found out, and plans are written as they are."""

import json
from dataclasses import replace

import numpy as np
import pytest

import needs_arm  # noqa: F401
from arm_scenes import DROP, T_BASE_FRAME, box
from icgnet.arm.bodies import CollisionBody
from icgnet.arm.pick import plan_pick
from icgnet.arm.replay import replay
from icgnet.arm.timing import slowed
from icgnet.errors import InputError


@pytest.fixture(scope="module")
def plan(fr3, seen):
    return plan_pick(seen([box((0.05, 0.04, 0.10))]), fr3, T_BASE_FRAME, DROP)


def test_a_hurried_plan_is_too_fast_and_too_sharp(fr3, plan):
    phases = tuple(replace(phase, trajectory=slowed(phase.trajectory, 0.8)) for phase in plan.phases)
    result = replay(replace(plan, phases=phases), fr3)
    assert result.speed == pytest.approx(1.25, abs=0.02)
    assert result.acceleration == pytest.approx(1.5625, abs=0.05)
    assert not result.is_kept


def test_something_in_the_way_is_found_with_its_depth(fr3, plan):
    carry = plan.phases[4].trajectory.positions
    tip = fr3.grasp_pose(carry[len(carry) // 2], plan.gripper)[:3, 3]
    result = replay(
        replace(
            plan, bodies=(CollisionBody("post", box((0.02, 0.02, 0.5)).apply_translation(tip - [0.15, 0.15, 0.3])),)
        ),
        fr3,
    )
    assert result.depth > 0.001
    assert result.where is not None
    assert "post" in result.where
    assert not result.is_kept


def test_a_jump_within_a_phase_is_found_whatever_its_velocities_say(fr3, plan):
    carry = plan.phases[4].trajectory
    positions = carry.positions.copy()
    positions[len(positions) // 2 :, 6] += 0.1
    phases = list(plan.phases)
    phases[4] = replace(phases[4], trajectory=replace(carry, positions=positions))
    result = replay(replace(plan, phases=tuple(phases[4:5])), fr3)
    assert result.speed > 1.5
    assert not result.is_kept


def test_a_jump_between_phases_is_found(fr3, plan):
    result = replay(replace(plan, phases=plan.phases[:3] + plan.phases[4:]), fr3)
    assert result.gap > 0.01
    assert not result.is_kept


def test_a_plan_without_phases_cannot_be_played(fr3, plan):
    with pytest.raises(InputError, match="needs a plan with phases"):
        replay(replace(plan, phases=()), fr3)


def test_a_saved_plan_holds_the_whole_trajectory(tmp_path, plan):
    plan.save(tmp_path / "pick")
    saved = json.loads((tmp_path / "pick" / "plan.json").read_text())
    assert [phase["name"] for phase in saved["phases"]] == [phase.name for phase in plan.phases]
    message = saved["phases"][0]["joint_trajectory"]
    assert message["joint_names"] == list(plan.joint_names)
    assert message["points"][0]["time_from_start"] == {"sec": 0, "nanosec": 0}
    last = message["points"][-1]["time_from_start"]
    assert last["sec"] + 1e-9 * last["nanosec"] == pytest.approx(plan.phases[0].trajectory.duration)
    np.testing.assert_allclose(message["points"][-1]["positions"], plan.phases[0].trajectory.positions[-1])
    with np.load(tmp_path / "pick" / "plan.npz") as arrays:
        assert arrays["times"][-1] == pytest.approx(plan.duration)
        assert arrays["positions"].shape == arrays["velocities"].shape == arrays["accelerations"].shape
        assert list(arrays["phase_names"]) == [phase.name for phase in plan.phases]
        assert arrays["phase_ends"][-1] == pytest.approx(plan.duration)
