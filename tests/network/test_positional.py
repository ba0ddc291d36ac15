import pytest
import torch

from icgnet.network.config import NETWORKS
from icgnet.network.positional import FourierEncoding, scene_bounds

ON_TABLE = torch.tensor([1.0, 1.0, 0.0])


def test_encoding_of_the_default_does_not_depend_on_what_else_is_in_the_scene():
    cloud = torch.rand(50, 3) * 0.1 + 0.1
    more = torch.cat([cloud, torch.tensor([[0.02, 0.28, 0.06]])])
    for name, equal in (("default", True), ("paper", False)):
        config = NETWORKS[name]
        encoding = FourierEncoding(config)
        seed = cloud[0]
        before = encoding(cloud, seed, scene_bounds(cloud, config))
        after = encoding(cloud, seed, scene_bounds(more, config))
        assert torch.allclose(before, after) == equal


def test_published_bounds_map_the_cloud_s_largest_extent_to_one():
    cloud = torch.tensor([[0.1, 0.1, 0.1], [0.2, 0.15, 0.12]])
    bounds = scene_bounds(cloud, NETWORKS["paper"])
    encoded = FourierEncoding(NETWORKS["paper"])(cloud, cloud, bounds)
    torch.testing.assert_close(encoded[:, :3], torch.tensor([[0.0, 0, 0], [1.0, 0.5, 0.2]]))
    assert abs(float(bounds.extent) - 0.1) < 1e-6


def test_first_channels_are_the_position_as_if_the_seed_stood_on_the_middle_of_the_workspace():
    config = NETWORKS["default"]
    points, seed = torch.rand(10, 3) * 0.3, torch.tensor([0.4, -0.7, 0.1])
    encoding, bounds = FourierEncoding(config), scene_bounds(points, config)
    encoded = encoding(points, seed, bounds)
    assert encoded.shape == (10, 32)
    torch.testing.assert_close(encoded[:, :3], (points - seed * ON_TABLE) / 0.3 + 0.5 * ON_TABLE)
    torch.testing.assert_close(encoding(seed, seed, bounds)[:3], torch.tensor([0.5, 0.5, 0.1 / 0.3]))


def test_the_rest_are_sines_and_cosines_of_that_place():
    config = NETWORKS["default"]
    encoding = FourierEncoding(config)
    points, seed = torch.rand(10, 3) * 0.3, torch.tensor([0.4, -0.7, 0.1])
    encoded = encoding(points, seed, scene_bounds(points, config))
    phase = 2 * torch.pi * encoded[:, :3] @ encoding.frequencies
    torch.testing.assert_close(encoded[:, 3:], torch.cat([phase.sin(), phase.cos()], 1)[:, 3:], rtol=0, atol=1e-4)


@pytest.mark.parametrize("name", ["default", "paper"])
def test_the_product_of_the_two_factors_is_the_encoding_of_every_point_for_every_query(name):
    config = NETWORKS[name]
    torch.manual_seed(0)
    encoding = FourierEncoding(config)
    points, seeds = torch.rand(40, 3) * torch.tensor([1.2, 0.8, 0.3]) - 0.4, torch.rand(7, 3) - 0.5
    bounds = scene_bounds(points, config)
    places = encoding.places(points, seeds, bounds)
    product = torch.einsum("qce,te->qtc", places.of_queries, places.of_points)
    wanted = encoding(points, seeds[:, None], bounds)
    torch.testing.assert_close(product, wanted.expand_as(product), rtol=0, atol=1e-4)
    rows = torch.tensor([3, 0, 39])
    chosen = places.select(rows)
    assert torch.equal(chosen.of_points, places.of_points[rows])
    weights = torch.randn(7, 2, config.query_width)
    of_weights = torch.einsum("qhe,te->qht", places.dot(weights), places.of_points)
    expected = torch.einsum("qhc,qtc->qht", weights, wanted.expand_as(product))
    torch.testing.assert_close(of_weights, expected, rtol=0, atol=1e-3)


def test_places_do_not_depend_on_where_on_the_table_a_scene_lies_but_on_its_height():
    config = NETWORKS["default"]
    encoding = FourierEncoding(config)
    points, seeds = torch.rand(20, 3) * 0.3, torch.rand(5, 1, 3) * 0.3
    bounds = scene_bounds(points, config)
    here = encoding(points, seeds, bounds)
    for shift, equal in (([0.31, -0.47, 0.0], True), ([0.0, 0.0, 0.05], False)):
        moved = encoding(points + torch.tensor(shift), seeds + torch.tensor(shift), bounds)
        assert torch.allclose(moved, here, rtol=0, atol=1e-4) == equal
