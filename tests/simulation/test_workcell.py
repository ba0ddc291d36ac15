import numpy as np
import pytest

from icgnet.errors import InputError
from icgnet.geometry.transforms import make_transform
from icgnet.objects.object_set import ObjectSet
from icgnet.simulation.scene import PlacedObject, Scene
from icgnet.simulation.workcell import PROTOCOLS, TABLE, Cause, Workcell

FROM_ABOVE = np.diag([1.0, -1.0, -1.0])
EDGE, STRICT = PROTOCOLS["edge"], PROTOCOLS["strict"]
both = pytest.mark.parametrize("protocol", [EDGE, STRICT], ids=["edge", "strict"])


class Boxes(ObjectSet):
    """Objects whose names are their edge lengths [mm]."""

    def __init__(self, box):
        super().__init__("boxes")
        self._box = box

    def names(self, kind, split):
        return ()

    def keys(self):
        return ()

    def class_name(self, key):
        return "box"

    def fingerprint(self, key):
        return key

    def _load(self, key):
        return self._box(*(float(edge) / 1000 for edge in key.split("x")))


@pytest.fixture
def cell(box, gripper):
    """Makes a workcell with boxes at these places on the table."""

    def make(**places):
        objects = []
        for name, (x, y) in places.items():
            height = float(name.split("x")[2]) / 1000
            pose = make_transform(np.eye(3), np.array([x, y, 0.05 + height / 2]))
            objects.append(PlacedObject(name, 1.0, pose))
        return Workcell(Scene("packed", tuple(objects)), Boxes(box), gripper)

    return make


def grasp(x, y, z):
    return make_transform(FROM_ABOVE, np.array([x, y, z]))


@both
def test_a_good_grasp_holds_its_object_which_is_taken_away(cell, protocol):
    workcell = cell(**{"50x50x100": (0.12, 0.15), "30x30x60": (0.22, 0.15)})
    result = workcell.execute(grasp(0.12, 0.15, 0.12), 0.062, protocol)
    assert result.success
    assert (result.cause, result.target, result.held, result.removed, result.lost) == (Cause.HELD, 0, (0,), (0,), ())
    assert workcell.remaining.tolist() == [1]
    assert workcell.scene().objects[0].name == "30x30x60"


@both
def test_a_hand_that_closes_on_nothing_has_missed(cell, protocol):
    result = cell(**{"50x50x100": (0.08, 0.15)}).execute(grasp(0.22, 0.15, 0.2), 0.08, protocol)
    assert (result.success, result.cause) == (False, Cause.MISSED)
    assert result.opening < 0.004


def test_a_neighbour_in_the_way_fails_in_strict_alone(cell):
    # The palm's long side is y, as wide as 0.2 m: the tall neighbour stands under it.
    boxes = {"50x50x60": (0.15, 0.12), "30x30x160": (0.15, 0.21)}
    pushed = cell(**boxes).execute(grasp(0.15, 0.12, 0.085), 0.062, EDGE)
    assert 1 in pushed.touched
    refused = cell(**boxes).execute(grasp(0.15, 0.12, 0.085), 0.062, STRICT)
    assert (refused.success, refused.cause) == (False, Cause.TOUCHED)


def test_a_hand_that_reaches_into_the_table_touches_it(cell):
    result = cell(**{"50x50x30": (0.15, 0.15)}).execute(grasp(0.15, 0.15, 0.045), 0.062, STRICT)
    assert TABLE in result.touched
    assert result.cause is Cause.TOUCHED


def test_an_object_wider_than_the_hand_is_named_as_such(cell):
    result = cell(**{"95x95x80": (0.15, 0.15)}).execute(grasp(0.15, 0.15, 0.115), 0.08, STRICT)
    assert (result.success, result.cause) == (False, Cause.TOO_WIDE)


def test_unusable_openings_and_empty_tables_are_refused(cell):
    workcell = cell(**{"50x50x100": (0.15, 0.15)})
    with pytest.raises(InputError, match="opening must be in"):
        workcell.execute(grasp(0.15, 0.15, 0.12), 0.09, EDGE)
    assert workcell.execute(grasp(0.15, 0.15, 0.12), 0.062, EDGE).success
    with pytest.raises(InputError, match="nothing left"):
        workcell.execute(grasp(0.15, 0.15, 0.12), 0.062, EDGE)
