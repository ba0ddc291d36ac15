"""What the network is told of a hand: its control points, and the numbers that describe it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
import yaml

from icgnet.grasping.gripper import Gripper, load_gripper
from icgnet.network.config import FRANKA, NETWORKS, HandConfig
from icgnet.network.decoders import Affordance
from icgnet.network.hand_input import HAND_NUMBERS, OUTSIDE_RAYS, WIDTH_MARGIN, HandInput
from icgnet.network.icgnet import IcgNet
from icgnet.network.inputs import make_scene_input

GRIPPERS = ("franka", "robotiq_2f_85", "robotiq_2f_140", "wsg_50", "xarm")


def test_control_points_of_the_franka_hand_are_where_the_configuration_says():
    hand = HandInput.of(FRANKA, HandConfig())
    assert len(hand.points) == HandConfig().points == 70
    sideways, normal, approach = hand.points.unbind(1)
    # From 20 mm outside of the contact to 100 mm behind it, and from 15 mm past it to 71 mm before it.
    assert float(normal.max()) == pytest.approx(0.020, abs=1e-3)
    assert float(normal.min()) == pytest.approx(-0.100, abs=1e-3)
    assert float(approach.max()) == pytest.approx(0.015, abs=1e-3)
    assert float(approach.min()) == pytest.approx(-0.071, abs=1e-3)
    assert float(sideways.max()) == -float(sideways.min()) == pytest.approx(0.012, abs=1e-3)


def test_control_points_are_all_combinations_sideways_fastest_and_normal_slowest():
    lengths = HandConfig(outward=(0.5,), across=(1.0,), finger=(1.0,), sideways=(-1.0, 1.0))
    points = HandInput.of(FRANKA, lengths).points
    assert points.shape == (lengths.points, 3) == (12, 3)
    grid = points.view(2, 3, 2, 3)
    assert (grid[..., 0] == grid[:1, :1, :, 0]).all()
    assert (grid[..., 1] == grid[:, :1, :1, 1]).all()
    assert (grid[..., 2] == grid[:1, :, :1, 2]).all()
    assert float(grid[1, 0, 0, 1]) == pytest.approx(-FRANKA.max_opening)


def scaled(gripper: Gripper, factor: float) -> Gripper:
    """The hand with all its lengths multiplied."""

    def boxes(parts):
        return tuple(
            replace(box, centre=tuple(factor * c for c in box.centre), size=tuple(factor * s for s in box.size))
            for box in parts
        )

    lengths = {name: factor * getattr(gripper, name) for name in ("max_opening", "finger_reach", "clearance")}
    return replace(gripper, palm=boxes(gripper.palm), finger=boxes(gripper.finger), **lengths)


def test_control_points_scale_with_the_hand():
    config = HandConfig(palm=0.0, past_tip=0.0)
    own, larger = HandInput.of(FRANKA, config), HandInput.of(scaled(FRANKA, 1.5), config)
    torch.testing.assert_close(larger.points, 1.5 * own.points)
    count = HAND_NUMBERS - 2
    torch.testing.assert_close(larger.numbers[:count], 1.5 * own.numbers[:count])
    assert torch.equal(larger.numbers[count:], own.numbers[count:])


def test_numbers_are_lengths_force_and_friction_in_units_that_make_them_about_one():
    numbers = HandInput.of(FRANKA, HandConfig()).numbers
    assert numbers.shape == (HAND_NUMBERS,)
    assert float(numbers[0]) == pytest.approx(FRANKA.max_opening / 0.1)
    assert float(numbers[-2]) == pytest.approx(FRANKA.finger_force / 40.0)
    assert float(numbers[-1]) == pytest.approx(FRANKA.friction)
    for name in GRIPPERS:
        described = HandInput.of(load_gripper(name), HandConfig()).numbers
        assert (described >= 0.0).all()
        assert (described < 3.0).all()


@pytest.mark.parametrize("name", GRIPPERS)
def test_the_width_head_reads_from_outside_of_the_contact_to_past_the_largest_opening(name):
    gripper, config = load_gripper(name), HandConfig()
    hand = HandInput.of(gripper, config)
    assert hand.width_limit == pytest.approx(gripper.max_opening + WIDTH_MARGIN)
    assert hand.rays.shape == (len(OUTSIDE_RAYS) + config.rays,)
    assert (hand.rays.diff() < 0).all()
    assert float(hand.rays[0]) == pytest.approx(OUTSIDE_RAYS[0])
    assert float(hand.rays[-1]) == pytest.approx(-hand.width_limit)


def test_two_files_of_the_same_hand_are_the_same_input(tmp_path):
    mounted = replace(FRANKA, name="mine", base_offset=(0.0, 0.0, -0.3))
    first, second = tmp_path / "franka.yaml", tmp_path / "mine.yaml"
    first.write_text(yaml.safe_dump(FRANKA.to_dict()))
    second.write_text(yaml.safe_dump(mounted.to_dict()))
    inputs = [HandInput.of(load_gripper(path), HandConfig()) for path in (first, second)]
    for one, other in ((inputs[0], inputs[1]), (inputs[0], HandInput.of(FRANKA, HandConfig()))):
        assert torch.equal(one.points, other.points)
        assert torch.equal(one.rays, other.rays)
        assert torch.equal(one.numbers, other.numbers)
        assert one.width_limit == other.width_limit


def test_a_hand_goes_to_a_device_with_all_it_has():
    hand = HandInput.of(FRANKA, HandConfig()).to("meta")
    assert {each.device.type for each in vars(hand).values() if isinstance(each, torch.Tensor)} == {"meta"}
    assert hand.width_limit == HandInput.of(FRANKA, HandConfig()).width_limit


@torch.no_grad()
def test_scores_and_widths_follow_the_file_of_the_hand(tmp_path):
    torch.manual_seed(0)
    net = IcgNet(NETWORKS["tiny"]).eval()
    points = np.random.default_rng(0).uniform([0.1, 0.1, 0.05], [0.2, 0.15, 0.1], (300, 3))
    (embedding,) = net.encode([make_scene_input(points, net.config)[0]])
    contacts = torch.from_numpy(points[:20].astype(np.float32))
    normals = torch.nn.functional.normalize(torch.randn(20, 3), dim=1)

    def grasps(gripper: Gripper) -> Affordance:
        path = tmp_path / "hand.yaml"
        path.write_text(yaml.safe_dump(gripper.to_dict()))
        hand = net.hand_input(load_gripper(path))
        return net.decode_affordance(embedding, torch.zeros(20).long(), contacts, normals, hand)

    own = grasps(FRANKA)
    assert torch.equal(grasps(replace(FRANKA, name="mine", base_offset=(0.0, 0.0, -0.3))).logits, own.logits)
    changes = ({"friction": 0.5}, {"finger_force": 15.0}, {"max_opening": 0.06}, {"clearance": 0.004})
    for change in changes:
        other = grasps(replace(FRANKA, **change))
        assert (other.logits - own.logits).abs().max() > 1e-4, change
    # The file of another hand that is turned into this one's.
    parts = {"palm": FRANKA.palm, "finger": FRANKA.finger, "max_opening": FRANKA.max_opening}
    turned = replace(load_gripper("wsg_50"), **parts, finger_reach=FRANKA.finger_reach, clearance=FRANKA.clearance)
    nearly = (grasps(turned).logits - own.logits).abs().max()
    assert 0.0 < nearly < (grasps(load_gripper("wsg_50")).logits - own.logits).abs().max()
    turned = replace(turned, finger_force=FRANKA.finger_force, friction=FRANKA.friction)
    assert torch.equal(grasps(turned).logits, own.logits)
    wider = grasps(load_gripper("robotiq_2f_140"))
    assert (wider.widths > own.widths).all()
