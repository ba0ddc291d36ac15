"""The hand in the physics: how fast any hand closes, and that the Franka hand's labels stay what they were."""

import numpy as np
import pytest

from icgnet.geometry.transforms import make_transform
from icgnet.grasping.gripper import load_gripper
from icgnet.grasping.hand_family import HandFamily, draw_member
from icgnet.simulation.config import Physics
from icgnet.simulation.hand import CLOSING_SPEED, closing_time
from icgnet.simulation.motion import steps_in
from icgnet.simulation.trials import CLOSE_MARGIN, LIFT_TIME, SETTLE_TIME, Trials
from icgnet.simulation.world import World

HANDS = [load_gripper(name) for name in ("franka", "robotiq_2f_85", "robotiq_2f_140", "wsg_50", "xarm")]
WIDEST, NARROWEST = (
    draw_member(HandFamily(opening=(opening, opening)), np.random.default_rng(0)) for opening in (0.15, 0.04)
)
ABOVE = make_transform(np.diag([-1.0, 1.0, -1.0]), np.array([0.15, 0.15, 0.5]))


def test_the_franka_hand_closes_as_all_labels_so_far_were_made(standing_box, gripper):
    world = World([standing_box(0.05, 0.05, 0.1)], Physics(), gripper)
    slides = [world.model.joint(f"slide_{side}").dofadr[0] for side in ("left", "right")]
    assert world.model.dof_damping[slides].tolist() == [100.0, 100.0]
    assert world.model.dof_armature[slides].tolist() == [0.5, 0.5]
    assert steps_in(closing_time(gripper) + CLOSE_MARGIN, Physics()) == 150


@pytest.mark.parametrize("hand", [*HANDS, WIDEST, NARROWEST], ids=lambda hand: hand.name)
def test_any_hand_closes_at_the_same_speed_in_the_time_of_a_trial(hand):
    world = World([], Physics(), hand)
    world.hand.place(ABOVE, hand.max_opening)
    world.hand.squeeze(hand.finger_force)
    world.step(steps_in(closing_time(hand) / 2, Physics()))
    assert world.hand.finger_speed() == pytest.approx(CLOSING_SPEED, rel=0.02)
    world.step(steps_in(closing_time(hand) / 2 + CLOSE_MARGIN / 2, Physics()))
    assert world.hand.opening() < 0.001
    assert world.hand.finger_speed() < 0.002


@pytest.mark.parametrize(("hand", "closing"), [(HANDS[0], 0.6), (WIDEST, 0.76), (NARROWEST, 0.5)])
def test_a_trial_waits_the_longer_the_wider_the_hand_opens(standing_box, monkeypatch, hand, closing):
    trials = Trials([standing_box(0.06, 0.02, 0.1)], hand, Physics())
    monkeypatch.setattr(trials.world.hand, "finger_speed", lambda: 1.0)
    assert trials.run(make_transform(ABOVE[:3, :3], np.array([0.15, 0.15, 0.13])), 0.03, target=0).success
    # What comes after closing: lifting, settling, and one look at the contacts.
    assert trials.world.data.time - LIFT_TIME - SETTLE_TIME == pytest.approx(closing + Physics().timestep)
