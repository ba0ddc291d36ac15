import numpy as np
import pytest
import trimesh

from icgnet.benchmark.reports import find_reports
from icgnet.cli.main import USAGE_ERROR, main
from icgnet.grasping.gripper import load_gripper
from icgnet.simulation.config import Physics
from icgnet.studies.config import HandsConfig
from icgnet.studies.hands import EXTREMES, close_on, measure, tables

HEAVY = Physics(object_mass=0.7, pad_friction=0.6)


@pytest.fixture(scope="module")
def numbers():
    return measure(HandsConfig(grippers=("robotiq_2f_140",), extremes=False))


@pytest.fixture(scope="module")
def of_extremes():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("icgnet.studies.hands.SHARES", (0.7,))
        return measure(HandsConfig(grippers=()))


def test_hands_and_the_ends_of_the_family_hold_all_that_fits_and_do_not_sink_in(numbers, of_extremes):
    assert list(of_extremes.closings) == list(EXTREMES)
    closings = [each for found in (numbers.closings | of_extremes.closings).values() for each in found]
    assert len(closings) == 9 + 3 * len(EXTREMES)
    assert all(each.held for each in closings)
    assert max(each.sinking for each in closings) < 0.0005
    assert max(each.slip for each in closings) < 0.001
    assert max(each.tilt for each in closings) < np.deg2rad(1.0)
    assert max(each.time for each in closings) < 0.5


def test_the_trace_begins_open_and_ends_at_the_width(numbers):
    for closing in numbers.closings["robotiq_2f_140"]:
        openings = np.array(closing.trace)[:, 0]
        assert openings[0] > 0.12
        assert openings[-1] == pytest.approx(closing.width, abs=0.001)


def test_what_is_too_heavy_slips():
    box = trimesh.creation.box((0.06, 0.03, 0.1))
    # 2 x 0.2 x 20 N hold 8 N.
    closing = close_on(load_gripper(), "box", box, Physics(object_mass=2.0, pad_friction=0.2, object_friction=0.2))
    assert closing.slip > 0.001 or not closing.held


def test_the_worst_of_each_hand_is_told(numbers):
    (row,) = tables(numbers)[0].rows
    assert row[:2] == ("robotiq_2f_140", "9 of 9")
    assert row[2] == f"{max(each.time for each in numbers.closings['robotiq_2f_140']):.2f}"


def test_the_report_keeps_the_traces(tmp_path, monkeypatch):
    monkeypatch.setattr("icgnet.studies.hands.SHARES", (0.7,))
    monkeypatch.setattr("icgnet.studies.hands.HOLD_TIME", 0.1)
    arguments = ["--grippers", "xarm", "--no-extremes", "--out", str(tmp_path / "report")]
    assert main(["study", "hands", *arguments]) == 0
    (report,) = find_reports([tmp_path])
    assert report.kind == "hands"
    closings = report.values["closings"]["xarm"]
    assert [each["shape"] for each in closings] == ["box", "cylinder", "sphere"]
    assert len(closings[0]["trace"][0]) == 4


def test_impossible_objects_are_refused(capsys):
    assert main(["study", "hands", "--mass", "0"]) == USAGE_ERROR
    assert "mass must be above 0, got 0.0" in capsys.readouterr().err
    assert main(["study", "hands", "--grippers", "nonsense"]) == USAGE_ERROR
    assert "gripper 'nonsense' is neither a file nor one of" in capsys.readouterr().err
