"""Features at any point of the scene, read from the tokens and the dense maps."""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from icgnet.network.config import NetworkConfig
from icgnet.network.embedding import SceneEmbedding
from icgnet.network.layers import ResidualBlock
from icgnet.network.tokens import Tokens, decoder_map_widths, token_widths


class NeighbourPooling(nn.Module):
    """PointNet over the nearest tokens: which features are where, seen from the point.

    Paper: interpolation, KNN with a small PointNet, so that the two sides of a surface differ.
    Differs with `view_depth`: how far the point lies behind each token along the line of sight to it is given, too.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.query_width
        self.count = config.neighbours
        self.view_depth = config.view_depth
        self.layers = nn.Sequential(ResidualBlock(width + 3 + self.view_depth, width), ResidualBlock(width, width))

    def forward(
        self, points: Float[Tensor, "n 3"], tokens: Tokens, features: Float[Tensor, "t c"]
    ) -> Float[Tensor, "n c"]:
        """`features` are the tokens' features, projected to the width of the queries."""
        rows = tokens.search.nearest(points, self.count)
        offsets = (tokens.positions[rows] - points.detach()[:, None]) / tokens.pitch
        nearby = features.index_select(0, rows.reshape(-1)).view(*rows.shape, -1)
        parts = [nearby, offsets.to(nearby.dtype)]
        if self.view_depth:
            parts.append(-(offsets * tokens.sight[rows]).sum(2, keepdim=True).to(nearby.dtype))
        return self.layers(torch.cat(parts, 2)).amax(1)


class Interpolation(nn.Module):
    """Point features of one task: what the maps say there.

    Paper: interpolation; `placed` adds the positional encoding.
    Differs: neighbours are found among the mean points of the voxels, not among their indices.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.query_width
        self.first_level = min(feature_level(stage) for stage in config.decoded_stages)
        levels = slice(self.first_level, None)
        self.dense = nn.ModuleList(ResidualBlock(channels, width) for channels in decoder_map_widths(config)[levels])
        self.sparse = nn.ModuleList(ResidualBlock(channels, width) for channels in token_widths(config)[levels])
        self.merge = ResidualBlock(2 * width, width - 3)

    def forward(
        self,
        points: Float[Tensor, "n 3"],
        embedding: SceneEmbedding,
        level: int,
        pooling: NeighbourPooling,
    ) -> Float[Tensor, "n c"]:
        """Features at points [m, table frame], read at one level (0 coarse to 3 fine); width - 3 channels."""
        tokens, own = embedding.tokens[level], level - self.first_level
        volume = self.dense[own](embedding.dense_maps[level].trilinear(points))
        surface = pooling(points, tokens, self.sparse[own](tokens.features))
        return self.merge(torch.cat([volume, surface], 1))


def placed(
    features: Float[Tensor, "*p f"], encoded: Float[Tensor, "*r c"], origin: Float[Tensor, "*o 3"] | None = None
) -> Float[Tensor, "*r d"]:
    """Features of points where they are; width + 3 channels.

    As in the published network the features are added to the positional encoding (all but its first three channels)
    and the normalised position is appended.

    Args:
        features: of the points.
        encoded: positional encoding of the points; all three broadcast.
        origin: what the first three channels, which are the normalised position, are given relative to.
    """
    position = encoded[..., :3]
    first = position if origin is None else position - origin
    return torch.cat([first, encoded[..., 3:] + features, position], -1)


def feature_level(stage: int) -> int:
    """Level of the maps that the decoders read for the queries of a stage: its own, and the finest after the last."""
    return min(stage, 3)
