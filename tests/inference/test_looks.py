"""What two looks at a scene make of it, with instances made up."""

import numpy as np
import pytest

from icgnet.inference.instances import EncodedWindow, Instance
from icgnet.inference.looks import MARGIN, SceneObject, agree, needs_wide_look

POINTS = np.column_stack([np.linspace(0.0, 0.4, 400), np.tile([0.0, 0.03], 200), np.full(400, 0.08)])
"""A row of 40 cm: a millimetre between one point and the next."""
VIEW = object.__new__(EncodedWindow)  # nothing but its rows is asked for
object.__setattr__(VIEW, "rows", np.arange(400))


def item(first: int, last: int, score: float) -> Instance:
    """What a look sees in the points of these numbers."""
    return Instance(VIEW, first, score, "box", 1.0, np.arange(first, last))


def rows(objects: list[SceneObject]) -> list[tuple[int, int]]:
    return [(int(each.rows[0]), int(each.rows[-1]) + 1) for each in objects]


def test_without_a_wider_look_the_objects_are_those_of_the_closer_one():
    close = [item(100, 300, 0.9), item(0, 100, 0.9)]
    found = agree(close, np.arange(2), [], POINTS)
    assert rows(found) == [(100, 300), (0, 100)]
    assert [each.bodies for each in found] == [(close[0],), (close[1],)]


def test_parts_of_one_group_are_one_object():
    (found,) = agree([item(0, 100, 0.9), item(100, 250, 0.9)], np.array([0, 0]), [], POINTS)
    assert len(found.rows) == 250
    assert len(found.parts) == len(found.bodies) == 2


def test_pieces_of_something_large_are_one_object_when_the_wider_look_is_sure():
    close, whole = [item(0, 110, 0.8), item(110, 200, 0.85)], item(0, 205, 0.97)
    (found,) = agree(close, np.arange(2), [whole], POINTS)
    assert found.bodies == (whole,)
    assert [len(part.rows) for part in found.parts] == [110, 90]
    assert len(found.rows) == 205


@pytest.mark.parametrize(
    ("score", "margin", "joined"), [(0.97, 0.0, False), (0.89, 0.0, False), (0.999, 0.0, True), (0.999, MARGIN, False)]
)
def test_small_things_stay_apart_unless_the_wider_look_is_surer_than_the_closer_one(score, margin, joined):
    close = [item(0, 50, 0.97), item(50, 100, 0.97)]
    found = agree(close, np.arange(2), [item(0, 100, score)], POINTS, margin)
    assert len(found) == (1 if joined else 2)


def test_what_the_closer_look_does_not_see_is_taken():
    found = agree([item(0, 50, 0.99)], np.arange(1), [item(200, 260, 0.6)], POINTS)
    assert rows(found) == [(200, 260), (0, 50)]
    assert found[0].parts == ()


def test_a_merged_object_is_taken_apart_and_keeps_its_part_of_each():
    found = agree([item(0, 400, 0.7)], np.arange(1), [item(0, 200, 0.95), item(200, 400, 0.96)], POINTS)
    assert sorted(rows(found)) == [(0, 200), (200, 400)]
    assert [len(each.parts) for each in found] == [1, 1]


def test_no_point_belongs_to_two():
    close = [item(0, 120, 0.8), item(120, 240, 0.8), item(240, 400, 0.9)]
    found = agree(close, np.arange(3), [item(0, 300, 0.98)], POINTS)
    together = np.concatenate([each.rows for each in found])
    assert len(np.unique(together)) == len(together)
    assert rows(found) == [(0, 300), (300, 400)]


def test_a_single_window_is_looked_at_again_only_where_the_network_doubts():
    assert not needs_wide_look([item(0, 10, 0.95)], windows=1)
    assert needs_wide_look([item(0, 10, 0.95), item(10, 20, 0.6)], windows=1)
    assert needs_wide_look([item(0, 10, 0.95)], windows=2)
