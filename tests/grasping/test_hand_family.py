import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from icgnet.errors import InputError
from icgnet.grasping.gripper import GRIPPERS, Gripper, load_gripper
from icgnet.grasping.hand_family import NUMBERS, HandFamily, draw_hand, draw_member, hand_numbers, outside
from icgnet.settings import read_settings

FAMILY = HandFamily()
FRANKA = load_gripper()
SHIPPED = sorted(path.stem for path in GRIPPERS.glob("*.yaml"))


@pytest.fixture(scope="module")
def members() -> list[Gripper]:
    rng = np.random.default_rng(0)
    return [draw_member(FAMILY, rng) for _ in range(2000)]


def test_thousands_of_members_are_hands_that_survive_json(members):
    for member in members:
        # Made by `from_dict`, they have passed all checks of a gripper file; the way there and back is exact.
        assert Gripper.from_dict(json.loads(json.dumps(member.to_dict()))) == member
        assert outside(FAMILY, member) == []


def test_members_reach_all_ends_of_the_ranges(members):
    numbers = np.array([hand_numbers(member) for member in members])
    for name, values in zip(NUMBERS, numbers.T, strict=True):
        least, most = getattr(FAMILY, name)
        near = 0.05 * (most - least)
        assert least - 1e-9 <= values.min() < least + near
        assert most - near < values.max() <= most + 1e-9
    assert {len(member.palm) for member in members} == {1, 2}


@settings(max_examples=100)
@given(
    st.integers(0, 2**32 - 1),
    st.fixed_dictionaries({name: st.tuples(st.floats(0, 1), st.floats(0, 1)) for name in NUMBERS}),
)
def test_members_of_any_narrower_family_are_hands_of_it(seed, shares):
    ranges = {}
    for name, ends in shares.items():
        least, most = getattr(FAMILY, name)
        ranges[name] = tuple(float(least + share * (most - least)) for share in sorted(ends))
    for whole, tip in (("finger_width", "tip_width"), ("finger_thickness", "tip_thickness")):
        ranges[whole] = (ranges[whole][0], max(ranges[whole][1], ranges[tip][1]))
    family = HandFamily(**ranges)
    member = draw_member(family, np.random.default_rng(seed))
    assert outside(family, member) == []
    assert Gripper.from_dict(json.loads(json.dumps(member.to_dict()))) == member


def test_members_have_short_names_and_round_lengths(members):
    assert members[0].name == f"family {1e3 * members[0].max_opening:.0f} x {1e3 * hand_numbers(members[0])[1]:.0f} mm"
    assert max(len(member.name) for member in members) < 25
    lengths = [value for box in members[0].palm + members[0].finger for end in box.corners().values() for value in end]
    assert all(value == round(value, 4) for value in lengths)


def test_two_of_five_scenes_get_the_base_hand_itself():
    rng = np.random.default_rng(1)
    drawn = [draw_hand(FAMILY, FRANKA, rng) for _ in range(500)]
    assert 0.34 < np.mean([hand is FRANKA for hand in drawn]) < 0.46
    assert draw_hand(replace(FAMILY, base_share=1.0), FRANKA, rng) is FRANKA
    assert draw_hand(replace(FAMILY, base_share=0.0), FRANKA, rng) != FRANKA


def test_the_same_stream_draws_the_same_hand():
    first, second = (draw_hand(FAMILY, FRANKA, np.random.default_rng(3)) for _ in range(2))
    assert first == second


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_hands_lie_inside(name):
    assert outside(FAMILY, load_gripper(name)) == []


def test_the_numbers_of_the_franka_hand():
    numbers = dict(zip(NUMBERS, np.round(1e3 * hand_numbers(FRANKA), 6), strict=True))
    assert numbers == {
        "opening": 80.0,
        "finger_length": 46.3,
        "tip_width": 17.0,
        "tip_thickness": 16.5,
        "finger_width": 21.0,
        "finger_thickness": 26.0,
        "palm_width": 63.2,
        "palm_length": 204.0,
        "palm_depth": 91.9,
        "finger_reach": 10.0,
        "clearance": 6.0,
    }


def test_a_hand_without_a_palm_has_numbers_too():
    numbers = dict(zip(NUMBERS, hand_numbers(replace(FRANKA, palm=())), strict=True))
    assert numbers["finger_length"] == pytest.approx(0.0538)
    assert numbers["palm_width"] == numbers["palm_length"] == numbers["palm_depth"] == 0.0


def test_what_is_outside_is_said_with_value_and_range():
    assert outside(FAMILY, replace(FRANKA, max_opening=0.2, finger_force=140.0, friction=0.3)) == [
        "opening 200 mm, not 40 to 150 mm",
        "finger force 140 N, not 15 to 40 N",
        "friction 0.3, not 0.6 to 0.9",
    ]
    assert outside(FAMILY, replace(FRANKA, clearance=0.0036)) == ["clearance 3.6 mm, not 4 to 10 mm"]
    assert len(outside(FAMILY, replace(FRANKA, palm=()))) == 3


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"base_share": 1.5}, "base_share must be at least 0 and at most 1, got 1.5"),
        ({"opening": (0.1, 0.05)}, r"opening must be a range of positive numbers, got \(0.1, 0.05\)"),
        ({"tip_width": (0.0, 0.02)}, r"tip_width must be a range of positive numbers, got \(0.0, 0.02\)"),
        ({"opening": (0.04, float("nan"))}, "opening must be a range of positive numbers"),
        ({"finger_length": (0.03, 140.0)}, r"finger_length must be at most 0.25 m, got \(0.03, 140.0\)"),
        ({"finger_force": (15.0, 5000.0)}, r"finger_force must lie from 0.1 to 1000 N, got \(15.0, 5000.0\)"),
        ({"opening": (0.015, 0.1)}, "clearance must be at most half of any opening"),
        ({"finger_width": (0.008, 0.02)}, "finger_width must reach as far as tip_width"),
        ({"finger_length": (0.02, 0.1)}, "finger_length must be 0.01 m longer than any finger_reach"),
    ],
)
def test_ranges_that_make_no_hands_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        HandFamily(**change)


def test_a_family_is_read_from_plain_values():
    family = replace(FAMILY, opening=(0.05, 0.1))
    assert read_settings(HandFamily, json.loads(json.dumps(asdict(family)))) == family
