import torch

from icgnet.network.config import NETWORKS
from icgnet.network.positional import FourierEncoding, scene_bounds


def test_encoding_of_the_default_does_not_depend_on_what_else_is_in_the_scene():
    cloud = torch.rand(50, 3) * 0.1 + 0.1
    more = torch.cat([cloud, torch.tensor([[0.02, 0.28, 0.06]])])
    for name, equal in (("default", True), ("paper", False)):
        config = NETWORKS[name]
        encoding = FourierEncoding(config)
        before = encoding(cloud, scene_bounds(cloud, config))
        after = encoding(cloud, scene_bounds(more, config))
        assert torch.allclose(before, after) == equal


def test_published_bounds_map_the_cloud_s_largest_extent_to_one():
    cloud = torch.tensor([[0.1, 0.1, 0.1], [0.2, 0.15, 0.12]])
    bounds = scene_bounds(cloud, NETWORKS["paper"])
    torch.testing.assert_close(bounds.normalise(cloud), torch.tensor([[0.0, 0, 0], [1.0, 0.5, 0.2]]))
    assert abs(float(bounds.extent) - 0.1) < 1e-6


def test_first_channels_are_the_normalised_position():
    config = NETWORKS["default"]
    points = torch.rand(10, 3) * 0.3
    encoded = FourierEncoding(config)(points, scene_bounds(points, config))
    assert encoded.shape == (10, 32)
    torch.testing.assert_close(encoded[:, :3], points / 0.3)
