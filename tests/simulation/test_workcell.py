from dataclasses import replace

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
    """Makes a workcell with boxes at these places: x, y, and the height of the lower side, if not the table's."""

    def make(**places):
        objects = []
        for name, (x, y, *bottom) in places.items():
            height = float(name.split("x")[2]) / 1000
            pose = make_transform(np.eye(3), np.array([x, y, (bottom or [0.05])[0] + height / 2]))
            objects.append(PlacedObject(name, 1.0, pose))
        return Workcell(Scene("packed", tuple(objects)), Boxes(box), gripper)

    return make


def grasp(x, y, z):
    return make_transform(FROM_ABOVE, np.array([x, y, z]))


def grasp_along(approach, closing, position):
    approach, closing = (np.array(each) / np.linalg.norm(each) for each in (approach, closing))
    return make_transform(np.stack([np.cross(closing, approach), closing, approach], axis=1), np.array(position))


class Happening:
    """Lets something happen before each step of a workcell's world; its argument is the time since now [s]."""

    def __init__(self, workcell, action):
        self.world, self._action = workcell._world, action
        self._step, self._start = self.world.step, self.world.data.time
        self.world.step = self

    def __call__(self, count=1):
        for _ in range(count):
            self._action(self.world.data.time - self._start)
            self._step()

    def stop(self):
        self.world.step = self._step


def let_go_at(moment, workcell):
    """Opens the hand from this time on [s]: it has closed after 0.81 s, and lifted after 1.42 s."""
    world = workcell._world
    return Happening(workcell, lambda time: world.hand.squeeze(-5.0) if time > moment else None)


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


TWO_SIDE_BY_SIDE = {"40x20x60": (0.15, 0.139), "40x21x60": (0.15, 0.1605)}
ONE_ON_THE_OTHER = {"40x40x100": (0.15, 0.15), "30x30x20": (0.15, 0.15, 0.15)}
# The thin one stands in the middle between the pads, and so narrow that these close on the other.
THIN_BESIDE_WIDE = {"8x10x60": (0.151, 0.15), "20x40x59": (0.167, 0.15)}


def test_two_objects_between_the_fingers_are_a_success_in_edge_alone(cell):
    # Each is touched by one finger only: in edge, mere contact is enough.
    published = cell(**TWO_SIDE_BY_SIDE).execute(grasp(0.15, 0.15, 0.08), 0.062, EDGE)
    assert (published.success, published.held, len(published.removed)) == (True, (0, 1), 1)
    refused = cell(**TWO_SIDE_BY_SIDE).execute(grasp(0.15, 0.15, 0.08), 0.062, STRICT)
    assert (refused.success, refused.cause, sorted(refused.held)) == (False, Cause.TWO_OBJECTS, [0, 1])


def test_an_object_carried_on_the_target_counts_as_lifted_in_strict(cell):
    from_side = grasp_along([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.16, 0.15, 0.1])
    published = cell(**ONE_ON_THE_OTHER).execute(from_side, 0.062, EDGE)
    assert (published.success, published.held) == (True, (0,))  # the hand does not touch what is on top
    workcell = cell(**ONE_ON_THE_OTHER)
    refused = workcell.execute(from_side, 0.062, STRICT)
    assert (refused.success, refused.cause, refused.held) == (False, Cause.TWO_OBJECTS, (0, 1))
    assert workcell.remaining.tolist() == [0, 1]


def test_another_object_than_the_target_is_a_success_in_edge_alone(cell):
    published = cell(**THIN_BESIDE_WIDE).execute(grasp(0.155, 0.15, 0.08), 0.062, EDGE)
    assert (published.success, published.target, published.held, published.removed) == (True, 0, (1,), (1,))
    refused = cell(**THIN_BESIDE_WIDE).execute(grasp(0.155, 0.15, 0.08), 0.062, STRICT)
    assert (refused.cause, refused.target, refused.held, refused.removed) == (Cause.WRONG_OBJECT, 0, (1,), ())


@both
def test_an_object_that_is_squeezed_out_has_slipped_on_closing(cell, protocol):
    # Across a corner: the sides stand at 45 degrees to the pads, and friction holds up to 37.
    corner = grasp_along([0.0, 0.0, -1.0], [1.0, -1.0, 0.0], [0.177, 0.177, 0.08])
    result = cell(**{"50x50x60": (0.15, 0.15)}).execute(corner, 0.078, protocol)
    assert (result.success, result.cause, result.held) == (False, Cause.SLIPPED_CLOSING, ())


@both
def test_an_object_that_falls_on_the_way_up_has_slipped_on_lifting(cell, protocol):
    workcell = cell(**{"50x50x60": (0.15, 0.15)})
    let_go_at(1.1, workcell)
    result = workcell.execute(grasp(0.15, 0.15, 0.08), 0.062, protocol)
    assert (result.success, result.cause, result.removed) == (False, Cause.SLIPPED_LIFTING, ())
    assert workcell.remaining.tolist() == [0]


@pytest.mark.parametrize(
    ("protocol", "cause"),
    [(EDGE, Cause.HELD), (replace(STRICT, keep_time=0.0), Cause.HELD), (STRICT, Cause.SLIPPED_LIFTING)],
    ids=["edge", "strict without waiting", "strict"],
)
def test_strict_alone_asks_that_the_object_is_kept_for_a_second(cell, protocol, cause):
    workcell = cell(**{"50x50x60": (0.15, 0.15)})
    let_go_at(2.1, workcell)
    assert workcell.execute(grasp(0.15, 0.15, 0.08), 0.062, protocol).cause is cause


@pytest.mark.parametrize("angle", [0, 30, 55, 90])
def test_in_strict_the_hand_rises_by_10_cm_however_it_came(cell, angle):
    turn = np.deg2rad(angle)
    oblique = grasp_along([np.sin(turn), 0.0, -np.cos(turn)], [0.0, 1.0, 0.0], [0.15, 0.15, 0.12])

    def rise(protocol):
        workcell, heights = cell(**{"40x40x100": (0.15, 0.15)}), []
        Happening(workcell, lambda time: heights.append(workcell._world.hand.position()[2] if time > 0.81 else 0.12))
        assert workcell.execute(oblique, 0.062, protocol).success
        return max(height for height in heights if height < 1.0) - 0.12  # in the end the hand waits at 2 m

    assert rise(STRICT) == pytest.approx(0.10, abs=0.003)
    assert rise(EDGE) == pytest.approx(0.10 * (1.0 if angle == 90 else np.cos(turn)), abs=0.003)


def test_too_wide_does_not_hide_what_the_hand_touched(cell):
    boxes = {"95x95x80": (0.15, 0.15), "30x30x160": (0.15, 0.25)}
    assert cell(**boxes).execute(grasp(0.15, 0.15, 0.115), 0.08, STRICT).cause is Cause.TOUCHED
    assert cell(**boxes).execute(grasp(0.15, 0.15, 0.115), 0.08, EDGE).cause is Cause.TOO_WIDE


@both
def test_what_is_pushed_out_of_the_workspace_is_lost_and_not_removed(cell, protocol):
    workcell = cell(**{"50x50x60": (0.08, 0.04), "30x30x80": (0.15, 0.283)})
    ram = grasp_along([0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.15, 0.29, 0.1])
    result = workcell.execute(ram, 0.02, protocol)
    assert (result.success, result.removed, result.lost) == (False, (), (1,))
    assert workcell.remaining.tolist() == [0]


@both
@pytest.mark.parametrize("moment", [0.1, 1.0, 1.6], ids=["approaching", "lifting", "at the end"])
def test_an_unstable_simulation_fails_the_attempt_and_is_undone(cell, protocol, moment):
    workcell = cell(**{"50x50x100": (0.08, 0.15), "30x30x60": (0.16, 0.15), "40x40x80": (0.24, 0.15)})
    assert workcell.execute(grasp(0.08, 0.15, 0.12), 0.062, protocol).success
    before = workcell.scene()

    def explode(time):
        if moment < time < moment + 0.005:
            workcell._world.data.qvel[:] = np.nan

    happening = Happening(workcell, explode)
    result = workcell.execute(grasp(0.16, 0.15, 0.08), 0.042, protocol)
    happening.stop()
    assert (result.success, result.cause, result.target) == (False, Cause.UNSTABLE, 1)
    assert (result.held, result.removed, result.lost) == ((), (), ())
    assert workcell.remaining.tolist() == [1, 2]
    for now, then in zip(workcell.scene().objects, before.objects, strict=True):
        np.testing.assert_array_equal(now.T_world_object, then.T_world_object)
    assert workcell.execute(grasp(0.16, 0.15, 0.08), 0.042, protocol).cause is Cause.HELD
