import torch

from icgnet.network.config import NETWORKS
from icgnet.network.interpolation import NeighbourPooling
from icgnet.network.tokens import Tokens, lines_of_sight


def test_a_point_before_a_surface_differs_from_one_behind_it_once_the_viewpoint_is_known():
    torch.manual_seed(0)
    config = NETWORKS["tiny"]
    axis = torch.arange(-4.0, 5.0) * 0.003
    plane = torch.nn.functional.pad(torch.cartesian_prod(axis, axis), (0, 1), value=0.1)
    features = torch.zeros(len(plane), config.query_width)
    pooling = NeighbourPooling(config)
    # Without a viewpoint, features that do not depend on the offset's sign cannot tell the two sides apart.
    torch.nn.init.zeros_(pooling.layers[0].shortcut.weight[:, -4:-1])
    torch.nn.init.zeros_(pooling.layers[0].first.weight[:, -4:-1])
    points = torch.tensor([[0.0, 0.0, 0.104], [0.0, 0.0, 0.096]])

    def sides(viewpoint: torch.Tensor | None) -> torch.Tensor:
        tokens = Tokens(plane, features, 0.003, torch.arange(len(plane)), lines_of_sight(plane, viewpoint))
        return pooling(points, tokens, pooling.of_tokens(features))

    before, behind = sides(torch.tensor([0.1, 0.0, 0.7]))
    assert (before - behind).abs().max() > 1e-3
    unknown = sides(None)
    torch.testing.assert_close(unknown[0], unknown[1])


def test_features_of_tokens_that_are_projected_first_come_to_the_same():
    torch.manual_seed(0)
    config = NETWORKS["tiny"]
    pooling = NeighbourPooling(config)
    for parameter in pooling.parameters():
        torch.nn.init.normal_(parameter, std=0.3)
    positions, features = torch.rand(50, 3) * 0.05, torch.randn(50, config.query_width)
    tokens = Tokens(positions, features, 0.003, torch.arange(50), lines_of_sight(positions, torch.rand(3)))
    points = torch.rand(20, 3) * 0.05
    rows = torch.cdist(points, positions).topk(config.neighbours, largest=False).indices
    offsets = (positions[rows] - points[:, None]) / tokens.pitch
    depth = -(offsets * tokens.sight[rows]).sum(2, keepdim=True)
    wanted = pooling.layers(torch.cat([features[rows], offsets, depth], 2)).amax(1)
    torch.testing.assert_close(pooling(points, tokens, pooling.of_tokens(features)), wanted)
