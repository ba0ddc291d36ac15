import pytest
import torch

from icgnet.network.neighbours import NeighbourSearch, farthest_points, spaced_points


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


@pytest.mark.parametrize("spacing", [0.01, 0.03, 0.2])
def test_spaced_points_keep_their_distance_and_are_near_to_all(spacing):
    points = torch.rand(400, 3, generator=torch.Generator().manual_seed(3)) * torch.tensor([0.3, 0.2, 0.1])
    rows = spaced_points(points, spacing)
    apart = torch.cdist(points[rows], points[rows]).fill_diagonal_(torch.inf)
    assert apart.min() > spacing
    assert torch.cdist(points, points[rows]).amin(1).max() <= spacing
    assert len(rows) > 1


def test_spaced_points_of_sets_far_apart_are_those_of_each():
    first, second = torch.rand(2, 150, 3, generator=torch.Generator().manual_seed(4)) * 0.1
    second = second + torch.tensor([0.5, 0.0, 0.0])
    # Mixed rows, since voxels of two scenes side by side lie between each other, too.
    order = torch.randperm(300, generator=torch.Generator().manual_seed(5))
    rows = order[spaced_points(torch.cat([first, second])[order], 0.03)]
    own = order[order < 150], order[order >= 150]
    alone = torch.cat([own[0][spaced_points(first[own[0]], 0.03)], own[1][spaced_points(second[own[1] - 150], 0.03)]])
    assert sorted(rows.tolist()) == sorted(alone.tolist())


def test_one_point_is_enough_for_a_speck():
    assert spaced_points(torch.tensor([[0.1, 0.1, 0.1], [0.11, 0.1, 0.1]]), 0.03).tolist() == [0]
