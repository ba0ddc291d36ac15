import torch

from icgnet.network.neighbours import NeighbourSearch, farthest_points


def test_nearest_equals_sorting_all_distances():
    generator = torch.Generator().manual_seed(0)
    points, queries = torch.rand(80, 3, generator=generator), torch.rand(20, 3, generator=generator)
    expected = torch.cdist(queries, points).argsort(1)[:, :6]
    assert torch.equal(NeighbourSearch(points).nearest(queries, 6), expected)


def test_nearest_in_a_smaller_set_repeats_the_last():
    points = torch.tensor([[0.0, 0, 0], [1, 0, 0]])
    nearest = NeighbourSearch(points).nearest(torch.tensor([[0.9, 0, 0]]), 4)
    assert nearest.tolist() == [[1, 0, 0, 0]]
    assert NeighbourSearch(points).nearest(torch.zeros(0, 3), 4).shape == (0, 4)


def test_every_farthest_point_is_the_farthest_from_those_before():
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(1))
    rows = farthest_points(points, 10)
    assert rows[0] == (points - points.mean(0)).norm(dim=1).argmin()
    for count in range(1, 10):
        distance = torch.cdist(points, points[rows[:count]]).amin(1)
        assert distance[rows[count]] == distance.max()


def test_farthest_points_do_not_depend_on_the_order():
    points = torch.rand(200, 3, generator=torch.Generator().manual_seed(2))
    order = torch.randperm(200)
    assert torch.equal(points[farthest_points(points, 12)], points[order][farthest_points(points[order], 12)])


def test_farthest_points_of_a_small_set_repeat():
    rows = farthest_points(torch.tensor([[0.0, 0, 0], [1, 0, 0]]), 4)
    assert set(rows.tolist()) == {0, 1}
    assert len(rows) == 4
