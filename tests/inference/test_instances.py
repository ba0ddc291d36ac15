"""Scenes of any extent in one pass."""

import numpy as np
import pytest

from icgnet.geometry.clouds import PointCloud
from icgnet.inference import instances
from icgnet.inference.instances import EncodedScene, encode, find_instances
from icgnet.inference.tabletop import Tabletop
from icgnet.network.instances import select_instances
from tabletop_scenes import tiny_network


def band(standing: slice = slice(None)) -> Tabletop:
    """A band of points along x, 0.45 m long, of which some may be objects."""
    points = np.random.default_rng(0).uniform((0.0, 0.1, 0.06), (0.45, 0.2, 0.12), (3000, 3))
    points = points[points[:, 0].argsort()]
    rows = np.arange(len(points))
    return Tabletop(PointCloud(points, np.array([0.2, -0.3, 0.6]), "table"), rows, rows[standing], np.eye(4))


@pytest.fixture(scope="module")
def scene() -> EncodedScene:
    found, left_out = encode(tiny_network(), band())
    assert found is not None
    assert left_out == 0
    return found


def test_the_whole_scene_is_shown_at_once(scene):
    np.testing.assert_array_equal(scene.rows, np.arange(3000))
    assert scene.point_to_voxel.max() + 1 == len(scene.embedding.voxels)


def test_no_point_is_claimed_twice_and_the_largest_comes_first(scene):
    found = find_instances(scene, band())
    rows = np.concatenate([item.rows for item in found])
    assert len(rows) > 0
    assert len(np.unique(rows)) == len(rows)
    sizes = [len(item.rows) for item in found]
    assert sizes == sorted(sizes, reverse=True)


def test_instances_carry_the_scores_that_the_network_ranks_them_by(scene):
    scores = {item.query: item.score for item in find_instances(scene, band())}
    best = select_instances(scene.embedding.stages[-1])
    for query, score in zip(best.queries.tolist(), best.scores.tolist(), strict=True):
        assert scores.get(query, score) == score
    assert all(0.0 < score <= 1.0 for score in scores.values())


def test_nothing_on_the_table_is_no_scene():
    assert encode(tiny_network(), band(slice(0, 0))) == (None, 0)


def test_what_may_be_no_object_is_shown_near_those_that_may_but_never_found():
    tabletop = band(slice(0, 1000))
    seen, _ = encode(tiny_network(), tabletop)
    edge = tabletop.cloud.points[999, 0]
    assert seen is not None
    assert tabletop.cloud.points[seen.rows, 0].max() == pytest.approx(edge + instances.SURROUNDINGS, abs=0.01)
    for item in find_instances(seen, tabletop):
        assert item.rows.max() < 1000


@pytest.mark.parametrize(("limit", "value"), [("MOST_POINTS", 1000), ("MOST_CELLS", 32 * 32 * 24)])
def test_of_too_large_a_scene_the_middle_is_looked_at_and_the_rest_is_counted(monkeypatch, limit, value):
    monkeypatch.setattr(instances, limit, value)
    tabletop = band()
    seen, left_out = encode(tiny_network(), tabletop)
    assert seen is not None
    assert left_out == 3000 - len(seen.rows) > 0
    places = tabletop.cloud.points[:, :2]
    middle = places[np.abs(places - np.median(places, axis=0)).max(axis=1).argmin()]
    offsets = np.abs(places - middle).max(axis=1)
    assert offsets[seen.rows].max() <= np.delete(offsets, seen.rows).min() + 1e-9


def test_of_two_groups_far_apart_one_is_looked_at(monkeypatch):
    monkeypatch.setattr(instances, "MOST_CELLS", 40 * 40 * 40)
    tabletop = band()
    tabletop.cloud.points[:1500, 0] -= 1.0
    tabletop.cloud.points[1500:, 0] += 1.0
    seen, left_out = encode(tiny_network(), tabletop)
    assert seen is not None
    assert left_out > 0
