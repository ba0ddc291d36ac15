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
        return pooling(points, tokens, features)

    before, behind = sides(torch.tensor([0.1, 0.0, 0.7]))
    assert (before - behind).abs().max() > 1e-3
    unknown = sides(None)
    torch.testing.assert_close(unknown[0], unknown[1])
