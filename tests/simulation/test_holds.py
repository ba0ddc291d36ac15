import pytest

from icgnet.objects.object_set import load_object_set
from icgnet.simulation.config import Physics
from icgnet.simulation.holds import hold_from_above
from icgnet.studies.simulation import PUBLISHED


@pytest.mark.parametrize("edges", [(0.03, 0.05, 0.1), (0.06, 0.07, 0.15), (0.008, 0.05, 0.06)])
def test_a_held_box_does_not_creep(box, gripper, edges):
    hold = hold_from_above(box(*edges), 1.0, gripper, Physics(), duration=5.0)
    assert hold.is_held
    assert hold.creep < 0.002
    assert hold.closed == pytest.approx(edges[0], abs=0.001), "the hand closes across the narrower side"
    assert hold.rise == pytest.approx(0.1, abs=0.005)


def test_a_box_wider_than_the_hand_is_not_held(box, gripper):
    hold = hold_from_above(box(0.1, 0.1, 0.1), 1.0, gripper, Physics(), duration=0.1)
    assert not hold.is_held
    assert abs(hold.rise) < 0.01


def test_a_slippery_box_slips(box, gripper):
    slippery = Physics(pad_friction=0.05, object_friction=0.05)
    hold = hold_from_above(box(0.05, 0.05, 0.1), 1.0, gripper, slippery, duration=0.1)
    assert hold.rise < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("published", PUBLISHED["traces"], ids=lambda trace: trace["name"])
def test_reference_grasps_end_as_in_the_published_simulation(vgn_objects, gripper, published):
    model = load_object_set(vgn_objects).model(published["name"])
    hold = hold_from_above(model, published["scale"], gripper, Physics(), duration=5.0)
    assert hold.is_held
    assert hold.lifted == pytest.approx(published["width"] - PUBLISHED["trace_standoff"], abs=0.003)
    assert hold.rise == pytest.approx(PUBLISHED["trace_rise"], abs=0.01)
    assert hold.creep < 0.002
