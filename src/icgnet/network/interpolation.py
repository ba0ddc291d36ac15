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

    def of_tokens(self, features: Float[Tensor, "t c"]) -> Float[Tensor, "t d"]:
        """What the first block makes of the tokens' features alone, which is the same for every point: 2 c channels."""
        width = features.shape[1]
        first, _, shortcut = self._first_block()
        hidden = nn.functional.linear(torch.relu(features), first.weight[:, :width], first.bias)
        return torch.cat([hidden, nn.functional.linear(features, shortcut.weight[:, :width])], 1)

    def forward(
        self, points: Float[Tensor, "n 3"], tokens: Tokens, of_tokens: Float[Tensor, "t d"]
    ) -> Float[Tensor, "n c"]:
        """Features at points; `of_tokens` is what the method of that name gave, of any features of the tokens."""
        rows = tokens.search.nearest(points, self.count)
        offsets = (tokens.positions[rows] - points.detach()[:, None]) / tokens.pitch
        if self.view_depth:
            offsets = torch.cat([offsets, -(offsets * tokens.sight[rows]).sum(2, keepdim=True)], 2)
        offsets = offsets.to(of_tokens.dtype)
        first, second, shortcut = self._first_block()
        hidden, through = of_tokens.index_select(0, rows.reshape(-1)).view(*rows.shape, -1).chunk(2, 2)
        width = hidden.shape[2]
        hidden = hidden + nn.functional.linear(torch.relu(offsets), first.weight[:, width:])
        through = through + nn.functional.linear(offsets, shortcut.weight[:, width:])
        return self.layers[1](torch.relu(through + second(torch.relu(hidden)))).amax(1)

    def _first_block(self) -> tuple[nn.Linear, nn.Linear, nn.Linear]:
        """First layer, second layer and shortcut."""
        block = self.layers[0]
        assert isinstance(block, ResidualBlock)
        assert isinstance(block.shortcut, nn.Linear)
        return block.first, block.second, block.shortcut


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

    def of_tokens(self, tokens: tuple[Tokens, ...], pooling: NeighbourPooling) -> tuple[Float[Tensor, "_ d"], ...]:
        """What `forward` wants to know of the tokens at each level that is read, whatever the points."""
        levels = tokens[self.first_level :]
        return tuple(
            pooling.of_tokens(project(level.features)) for project, level in zip(self.sparse, levels, strict=True)
        )

    def forward(
        self,
        points: Float[Tensor, "n 3"],
        embedding: SceneEmbedding,
        of_tokens: tuple[Float[Tensor, "_ d"], ...],
        level: int,
        pooling: NeighbourPooling,
    ) -> Float[Tensor, "n c"]:
        """Features at points [m, table frame], read at one level (0 coarse to 3 fine); width - 3 channels."""
        own = level - self.first_level
        volume = self.dense[own](embedding.dense_maps[level].trilinear(points))
        surface = pooling(points, embedding.tokens[level], of_tokens[own])
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
