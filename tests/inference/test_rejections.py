import numpy as np

from icgnet.grasping.grasps import Grasps
from icgnet.inference.rejections import COLLISIONS, KEPT, REASONS, UNCHECKED, Rejections

TABLE, POINTS, LEFT = (REASONS.index(name) for name in ("table", "points", UNCHECKED))


def grasps(instances, scores, contacts=None) -> Grasps:
    count = len(instances)
    places = np.arange(count) if contacts is None else np.array(contacts)
    return Grasps(
        poses=np.tile(np.eye(4), (count, 1, 1)),
        widths=np.full(count, 0.05),
        openings=np.full(count, 0.06),
        scores=np.array(scores, dtype=float),
        instances=np.array(instances),
        contacts=np.column_stack([places, places, places]).astype(float),
        angles=np.zeros(count, dtype=np.int64),
    )


def test_every_collision_is_a_reason():
    assert COLLISIONS == ("table", "object", "points")
    assert set(COLLISIONS) < set(REASONS)


def test_dropped_grasps_are_counted_by_object_and_reason():
    dropped = Rejections.of_grasps(grasps([0, 2, 2, 2], [0.9, 0.8, 0.7, 0.6]), np.array([TABLE, TABLE, LEFT, LEFT]), 3)
    assert dropped.of_object(0)["table"] == 1
    assert sum(dropped.of_object(1).values()) == 0
    assert (dropped.of_object(2)["table"], dropped.of_object(2)[UNCHECKED]) == (1, 2)
    assert dropped.total() == {**dict.fromkeys(REASONS, 0), "table": 2, UNCHECKED: 2}
    assert dropped.for_reason("table").scores.tolist() == [0.9, 0.8]
    assert len(dropped.for_reason(UNCHECKED)) == 0, "they hit nothing, so there is nothing to be seen"


def test_the_best_of_each_object_and_reason_are_kept():
    many = grasps([1] * 30, np.linspace(0.1, 0.9, 30))
    dropped = Rejections.of_grasps(many, np.array([TABLE, POINTS] * 15), 2)
    assert dropped.counts.sum() == 30
    np.testing.assert_allclose(dropped.for_reason("table").scores, many.scores[28::-2][:KEPT])
    np.testing.assert_allclose(dropped.for_reason("points").scores, many.scores[29::-2][:KEPT])


def test_of_several_at_one_contact_the_best_is_kept():
    dropped = Rejections.of_grasps(grasps([0] * 4, [0.3, 0.5, 0.4, 0.2], [7, 7, 7, 8]), np.full(4, TABLE), 1)
    assert dropped.for_reason("table").scores.tolist() == [0.5, 0.2]
    assert dropped.of_object(0)["table"] == 4


def test_pieces_of_one_object_and_several_searches_are_added_up():
    pieces = Rejections.of_grasps(grasps([0, 1, 2], [0.3, 0.6, 0.9]), np.full(3, TABLE), 3)
    whole = pieces.of_pieces(np.array([0, 0, 1]), 2)
    assert [whole.of_object(k)["table"] for k in range(2)] == [2, 1]
    assert whole.grasps.instances.tolist() == [0, 0, 1]
    more = Rejections.of_grasps(grasps([0], [0.95], [9]), np.array([TABLE]), 2)
    joined = Rejections.joined([whole, more])
    assert joined.of_object(0)["table"] == 3
    assert joined.for_reason("table").scores.tolist() == [0.95, 0.6, 0.3, 0.9], "by object, the best first"


def test_nothing_is_known_of_nothing():
    nothing = Rejections.empty()
    assert nothing.of_object(0) == {}
    assert sum(nothing.total().values()) == len(nothing.grasps) == 0
    assert len(Rejections.joined([nothing, nothing]).grasps) == 0
