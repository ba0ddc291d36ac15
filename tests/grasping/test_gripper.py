import json
from dataclasses import replace

import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from icgnet.errors import DataError, InputError
from icgnet.grasping.gripper import GRIPPERS, Box, Gripper, load_gripper

franka = load_gripper("franka")
openings = st.floats(0.0, 0.08)


def lower_upper(opening: float) -> tuple[np.ndarray, np.ndarray]:
    boxes = franka.boxes(opening)
    centres, sizes = np.array([box.centre for box in boxes]), np.array([box.size for box in boxes])
    return centres - sizes / 2, centres + sizes / 2


def test_franka_has_its_published_measures():
    assert franka.max_opening == 0.08
    assert np.allclose(franka.T_grasp_base[:3, 3], [0, 0, -0.1123])
    lower, upper = lower_upper(0.08)
    assert np.allclose(upper[:, 2].max(), 0)  # the tips end at the origin
    assert np.allclose((upper - lower)[0, :2], [0.0632, 0.204])  # the palm
    assert np.allclose(upper[: len(franka.palm), 2].max(), -0.1123 + 0.066)


@pytest.mark.parametrize(
    ("name", "opening", "length"),
    [
        ("robotiq_2f_85", 0.085, 0.163),
        ("robotiq_2f_140", 0.140, 0.2332),
        ("wsg_50", 0.110, 0.1545),
        ("xarm", 0.084, 0.1745),
    ],
)
def test_shipped_hands_have_their_published_measures(name, opening, length):
    hand = load_gripper(name)
    assert hand.name == name
    assert hand.max_opening == opening
    # From the base link, which looks along the approach, to the tips.
    np.testing.assert_allclose(hand.T_grasp_base[:3, 3], [0.0, 0.0, -length])
    np.testing.assert_allclose(hand.T_grasp_base[:3, 2], [0.0, 0.0, 1.0])
    assert Gripper.from_dict(json.loads(json.dumps(hand.to_dict()))) == hand


@given(st.floats(0, 0.2))
def test_hand_opens_by_the_width_and_the_clearance_but_not_beyond_its_range(width):
    opening = franka.opening(np.array([width]))[0]
    assert opening == min(width + 2 * 0.006, 0.08)


@given(openings)
def test_space_between_the_pads_is_free(opening):
    lower, upper = lower_upper(opening)
    fingers = slice(len(franka.palm), None)
    gap = np.where(lower[fingers, 1] >= 0, lower[fingers, 1], -upper[fingers, 1])
    assert gap.min() == pytest.approx(opening / 2)


@given(openings)
def test_hand_is_symmetric_under_half_a_turn(opening):
    lower, upper = lower_upper(opening)
    turned = {tuple(np.round([-u[0], -u[1], lo[2]], 9)) for lo, u in zip(lower, upper, strict=True)}
    assert turned == {tuple(np.round(lo, 9)) for lo in lower}


@given(openings, st.sampled_from([0.004, 0.008, 0.02]))
def test_surface_points_lie_on_the_boxes(opening, spacing):
    points = franka.surface_points(opening, spacing)
    lower, upper = lower_upper(opening)
    depth = np.minimum(points[:, None] - lower, upper - points[:, None]).min(axis=2)
    on_a_face = np.abs(depth).min(axis=1) < 1e-9
    assert on_a_face.all()


def test_surface_points_leave_no_gap_above_their_spacing():
    points = franka.surface_points(0.05, 0.008)
    lower, upper = lower_upper(0.05)
    rng = np.random.default_rng(0)
    for box_lower, box_upper in zip(lower, upper, strict=True):
        samples = rng.uniform(box_lower, box_upper, (60, 3))
        samples[:, 2] = box_upper[2]
        nearest = np.linalg.norm(samples[:, None] - points, axis=2).min(axis=1)
        assert nearest.max() <= 0.008 * np.sqrt(0.5) + 1e-9


ENTRIES = yaml.safe_load((GRIPPERS / "franka.yaml").read_text())


def box(lower: list, upper: list) -> dict:
    return {"lower": lower, "upper": upper}


def scaled(boxes: list[dict], factor: float) -> list[dict]:
    return [box(*([factor * value for value in each[end]] for end in ("lower", "upper"))) for each in boxes]


def _write(path, entries):
    path.write_text(yaml.safe_dump(entries))
    return path


def test_hand_without_a_palm_has_the_points_of_its_fingers(tmp_path):
    gripper = load_gripper(_write(tmp_path / "fingers.yaml", ENTRIES | {"palm": []}))
    assert 0 < len(gripper.surface_points(0.05)) < len(franka.surface_points(0.05))
    assert replace(gripper, finger=()).surface_points(0.05).shape == (0, 3)


def test_the_entries_lead_back_to_the_same_hand():
    plain = json.loads(json.dumps(franka.to_dict()))
    assert Gripper.from_dict(plain) == franka
    assert plain == ENTRIES | {"base_quaternion": [1.0, 0.0, 0.0, 0.0]}
    assert hash(Gripper.from_dict(plain)) == hash(franka)


@given(st.lists(st.floats(0.001, 0.03), min_size=4, max_size=4), st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3))
def test_any_numbers_lead_back_to_the_same_hand(lengths, offset):
    half, thickness, length, palm = lengths
    finger = [box([-half, 0.0, -0.02 - length], [half, thickness, 0.0])]
    entries = ENTRIES | {"finger": finger, "palm": [box([-half, -0.1, -0.1], [half, 0.1, -0.02 - length + palm / 4])]}
    hand = Gripper.from_dict(entries | {"base_offset": offset})
    assert Gripper.from_dict(json.loads(json.dumps(hand.to_dict()))) == hand


def test_a_hand_is_the_same_under_another_name_and_mounting():
    mounted = replace(franka, name="mine", base_offset=(0.0, 0.0, -0.2), base_quaternion=(0.0, 0.0, 0.0, 1.0))
    assert mounted != franka
    assert mounted.same_hand(franka)
    for key in ("max_opening", "finger_reach", "clearance", "finger_force", "friction"):
        assert replace(franka, **{key: 0.04}).differences(franka) == [f"{key} 0.04 instead of {getattr(franka, key):g}"]
    assert replace(franka, palm=()).differences(franka) == ["other boxes of the palm"]


def test_a_base_link_can_be_turned(tmp_path):
    half = float(np.sqrt(0.5))
    turned = load_gripper(_write(tmp_path / "mine.yaml", ENTRIES | {"base_quaternion": [half, 0, 0, half]}))
    np.testing.assert_allclose(turned.T_grasp_base[:3, :3] @ [1, 0, 0], [0, 1, 0], atol=1e-12)
    np.testing.assert_array_equal(turned.T_grasp_base[:3, 3], franka.T_grasp_base[:3, 3])


def test_a_file_that_was_edited_is_read_again(tmp_path):
    path = _write(tmp_path / "mine.yaml", ENTRIES)
    assert load_gripper(path).max_opening == 0.08
    _write(path, ENTRIES | {"max_opening": 0.07})
    assert load_gripper(path).max_opening == 0.07


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"max_opening": 80.0}, "max_opening must be a number from 0.005 to 0.5 m, got 80"),
        ({"max_opening": -0.08}, "max_opening must be a number from 0.005 to 0.5 m, got -0.08"),
        ({"max_opening": 1e-320}, "max_opening must be a number from 0.005"),
        ({"max_opening": 10**400}, "max_opening must be a number from 0.005 to 0.5 m, got 1000"),
        ({"max_opening": True}, "max_opening must be a number from 0.005 to 0.5 m, got True"),
        ({"clearance": float("nan")}, "clearance must be a number from 0.0005 to 0.05 m, got nan"),
        ({"clearance": 1.0}, "clearance must be a number from 0.0005 to 0.05 m, got 1.0"),
        (
            {"max_opening": 0.02, "clearance": 0.02},
            r"clearance must be at most half of max_opening \(0.02 m\), got 0.02",
        ),
        ({"finger_reach": 1.0}, "finger_reach must be a number from 0.0005 to 0.05 m, got 1.0"),
        ({"finger_force": float("inf")}, "finger_force must be a number from 0.1 to 1000 N, got inf"),
        ({"friction": "high"}, "friction must be a number from 0.01 to 10, got 'high'"),
        ({"name": ""}, "name must be a printable text"),
        ({"name": 3}, "name must be a printable text of 1 to 60 letters, got 3"),
        ({"name": "a\nb"}, "name must be a printable text"),
        ({"colour": "white"}, "'colour' unknown"),
        ({3: "x", None: 1}, "3, None unknown"),
        ({"base_offset": [0, 0]}, "base_offset must be three numbers from -1 to 1 m"),
        ({"base_offset": [0, 0, float("nan")]}, "base_offset must be three numbers"),
        ({"base_offset": [0, 0, -112.3]}, "base_offset must be three numbers from -1 to 1 m"),
        ({"base_quaternion": [1, 0, 0]}, "base_quaternion must be four numbers"),
        ({"base_quaternion": [1, 0, 0, 1]}, r"base_quaternion must be \[w, x, y, z\] of length 1"),
        ({"base_quaternion": None}, "base_quaternion must be four numbers"),
        ({"palm": [box([0, 0, -0.1], [0.1, 0.1, -0.2])]}, "palm box 1: a box needs lower < upper"),
        ({"palm": [box([0, 0, 0], [0.1, 0.1, float("nan")])]}, "palm box 1: upper must be three numbers"),
        ({"palm": [{"lower": [0, 0, 0]}]}, "palm box 1: a box needs the entries lower and upper, got {'lower'"),
        ({"palm": ["large"]}, "a box needs the entries lower and upper, got 'large'"),
        ({"palm": 3}, "palm must be a list of 0 to 64 boxes, got 3"),
        ({"palm": ENTRIES["palm"] * 30}, "palm must be a list of 0 to 64 boxes"),
        ({"palm": scaled(ENTRIES["palm"], 1000.0)}, "palm box 1: lower must be three numbers from -0.5 to 0.5 m"),
        ({"palm": scaled(ENTRIES["palm"], 10.0)}, "palm box 1: lower must be three numbers from -0.5 to 0.5 m"),
        ({"palm": [box([-0.03, -0.1, -0.14], [0.03, 0.1, -0.005])]}, "palm box 1 reaches to z = -0.005 m: the fingers"),
        ({"palm": [box([-0.03, -0.1, -0.14], [0.03, 0.1, -0.02])]}, "goes 0.0179 m deep into palm box 1"),
        ({"palm": [box([-0.03, 0.05, -0.14], [0.03, 0.1, -0.02])]}, r"box 1 of the \+y finger goes .* palm box 1"),
        ({"palm": [box([-0.03, 0.03, -0.14], [0.03, 0.035, -0.02])]}, r"the \+y finger .* between open and closed"),
        ({"palm": [box([-0.03, -0.1, -0.14], [0.03, -0.05, -0.02])]}, "box 1 of the -y finger goes .* palm box 1"),
        ({"finger": []}, "finger must be a list of 1 to 64 boxes"),
        ({"finger": scaled(ENTRIES["finger"], 1000.0)}, "finger box 1: lower must be three numbers from -0.5 to 0.5"),
        ({"finger": [box([-0.01, -0.03, -0.05], [0.01, 0.0, 0.0])]}, "finger box 1 reaches to y = -0.03 m"),
        ({"finger": [box([-0.01, 0.02, -0.05], [0.01, 0.03, 0.0])]}, "plane y = 0 .* the finger begins at 0.02 m"),
        ({"finger": [box([-0.01, 0.0, -0.05], [0.01, 0.01, 0.01])]}, "the finger must end in the tip at z = 0"),
        ({"finger": [box([-0.01, 0.0, -0.008], [0.01, 0.01, 0.0])]}, "finger_reach must be less than the length"),
    ],
)
def test_broken_gripper_file_is_refused_by_name(tmp_path, change, message):
    path = _write(tmp_path / "mine.yaml", ENTRIES | change)
    with pytest.raises(DataError, match=message) as error:
        load_gripper(path)
    assert str(error.value).startswith(f"gripper file {path}: ")
    assert len(str(error.value)) < len(str(path)) + 500
    assert str(error.value).isprintable()


def test_missing_entry_is_named(tmp_path):
    entries = {key: value for key, value in ENTRIES.items() if key != "friction"}
    with pytest.raises(DataError, match="base_quaternion: friction missing"):
        load_gripper(_write(tmp_path / "mine.yaml", entries))


BOMB = "a: &a [1, 1, 1, 1, 1, 1, 1, 1, 1]\n" + "".join(
    f"{chr(98 + i)}: &{chr(98 + i)} [{', '.join(['*' + chr(97 + i)] * 9)}]\n" for i in range(9)
)


@pytest.mark.parametrize(
    "content",
    ["", "- 1\n- 2\n", "a: [1, 2\n", "[" * 3000, "? [a]\n: 1\n", "!!python/object:os.system x", "\x00", BOMB]
    + [BOMB + "palm: *j\n", "# " + "x" * 200_000, "date: 2026-99-99"],
    ids=range(11),
)
def test_file_that_is_no_gripper_is_refused(tmp_path, content):
    path = tmp_path / "mine.yaml"
    path.write_text(content)
    with pytest.raises(DataError, match=r"mine\.yaml") as error:
        load_gripper(path)
    assert len(str(error.value)) < len(str(path)) + 600


def test_aliases_in_the_place_of_numbers_are_refused_at_once(tmp_path):
    nested: list = [1.0] * 9
    for _ in range(9):
        nested = [nested] * 9
    for key in ("max_opening", "base_offset", "base_quaternion", "palm", "finger", "name"):
        with pytest.raises(InputError, match=key) as error:
            Gripper.from_dict(ENTRIES | {key: nested})
        assert len(str(error.value)) < 500


@pytest.mark.parametrize("source", ["robotiq", "x" * 5000, "a\0b"])
def test_unknown_gripper_lists_the_known_ones(source):
    known = r"\['franka', 'robotiq_2f_140', 'robotiq_2f_85', 'wsg_50', 'xarm'\]"
    with pytest.raises(DataError, match=f" is neither a file nor one of {known}") as error:
        load_gripper(source)
    assert len(str(error.value)) < 500


def test_a_swept_box_holds_the_box_all_along_its_approach():
    box = Box((0.01, -0.02, 0.03), (0.02, 0.04, 0.06))
    lower, upper = box.swept(0.05).corners().values()
    assert upper == box.corners()["upper"]
    np.testing.assert_allclose(lower, np.array(box.corners()["lower"]) - [0.0, 0.0, 0.05], atol=1e-12)
