import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from icgnet.errors import DataError
from icgnet.grasping.gripper import GRIPPERS, load_gripper

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


def test_hand_without_a_palm_has_the_points_of_its_fingers(tmp_path):
    entries = yaml.safe_load((GRIPPERS / "franka.yaml").read_text()) | {"palm": []}
    (tmp_path / "fingers.yaml").write_text(yaml.safe_dump(entries))
    gripper = load_gripper(tmp_path / "fingers.yaml")
    assert 0 < len(gripper.surface_points(0.05)) < len(franka.surface_points(0.05))
    bare = load_gripper(_write(tmp_path / "bare.yaml", entries | {"finger": []}))
    assert bare.surface_points(0.05).shape == (0, 3)


def _write(path, entries):
    path.write_text(yaml.safe_dump(entries))
    return path


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"max_opening": 80.0}, "max_opening is in metres, got 80"),
        ({"max_opening": -0.08}, "max_opening must be a positive number, got -0.08"),
        ({"clearance": float("nan")}, "clearance must be a positive number, got nan"),
        ({"friction": "high"}, "friction must be a positive number, got 'high'"),
        ({"colour": "white"}, "colour"),
        ({"base_offset": [0, 0]}, "base_offset must be three numbers"),
        ({"base_offset": [0, 0, float("nan")]}, "base_offset must be three numbers"),
        ({"palm": [{"lower": [0, 0, 0], "upper": [0.1, 0.1, -0.1]}]}, "lower < upper"),
        ({"palm": [{"lower": [0, 0, 0], "upper": [0.1, 0.1, float("nan")]}]}, "upper must be three numbers"),
        ({"palm": [{"lower": [0, 0, 0]}]}, "the entries lower and upper, got {'lower'"),
        ({"palm": ["large"]}, "the entries lower and upper, got 'large'"),
    ],
)
def test_broken_gripper_file_is_refused_by_name(tmp_path, change, message):
    entries = yaml.safe_load((GRIPPERS / "franka.yaml").read_text()) | change
    path = _write(tmp_path / "mine.yaml", entries)
    with pytest.raises(DataError, match=message) as error:
        load_gripper(path)
    assert "mine.yaml" in str(error.value)


def test_missing_entry_is_named(tmp_path):
    entries = yaml.safe_load((GRIPPERS / "franka.yaml").read_text())
    del entries["friction"]
    with pytest.raises(DataError, match="friction"):
        load_gripper(_write(tmp_path / "mine.yaml", entries))


@pytest.mark.parametrize("content", ["", "- 1\n- 2\n", "a: [1, 2\n"])
def test_file_that_is_no_gripper_is_refused(tmp_path, content):
    path = tmp_path / "mine.yaml"
    path.write_text(content)
    with pytest.raises(DataError, match=r"mine\.yaml"):
        load_gripper(path)


def test_unknown_gripper_lists_the_known_ones():
    with pytest.raises(DataError, match=r"'robotiq' is neither a file nor one of \['franka'\]"):
        load_gripper("robotiq")
