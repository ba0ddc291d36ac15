"""Tokens: sparse surface features joined with the volumetric feature of the cell around them, at four levels."""

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float, Int
from torch import Tensor

from icgnet.network.config import NetworkConfig
from icgnet.network.dense_map import DenseMap
from icgnet.network.neighbours import NeighbourSearch
from icgnet.network.sparse_unet import VoxelPyramid


@dataclass(frozen=True, eq=False)
class Tokens:
    """The tokens of one scene at one level."""

    positions: Float[Tensor, "t 3"]
    """Mean of the voxels' points [m, workspace frame]."""
    features: Float[Tensor, "t c"]
    pitch: float
    """Size of the voxel of a token [m]."""
    of_voxel: Int[Tensor, " v"]
    """For each finest voxel of the scene the row of its token."""
    sight: Float[Tensor, "t 3"]
    """Unit vector from the camera to the token; 0 if the viewpoint is not known."""

    @cached_property
    def search(self) -> NeighbourSearch:
        """Neighbour search among the token positions; built at first use."""
        return NeighbourSearch(self.positions)

    def pool(self, values: Float[Tensor, "v q"]) -> Float[Tensor, "t q"]:
        """Mean over the voxels of each token."""
        is_finest = len(values) == len(self.positions)
        return values if is_finest else mean_by_row(values, self.of_voxel, len(self.positions))


def mean_by_row(values: Float[Tensor, "v c"], rows: Int[Tensor, " v"], count: int) -> Float[Tensor, "t c"]:
    """Mean of the values that share a row; every row from 0 to `count` - 1 must occur."""
    total = values.new_zeros(count, values.shape[1]).index_add(0, rows, values)
    return total / torch.bincount(rows, minlength=count).to(values.dtype)[:, None]


def lines_of_sight(positions: Float[Tensor, "t 3"], viewpoint: Float[Tensor, "3"] | None) -> Float[Tensor, "t 3"]:
    """Unit vectors from the viewpoint to the positions [m]; 0 without a viewpoint."""
    if viewpoint is None:
        return torch.zeros_like(positions)
    return torch.nn.functional.normalize(positions - viewpoint, dim=1)


def token_widths(config: NetworkConfig) -> tuple[int, ...]:
    """Channels of the tokens per level, coarse to fine."""
    return tuple(s + d for s, d in zip(config.decoder_widths, dense_map_widths(config), strict=True))


def dense_map_widths(config: NetworkConfig) -> tuple[int, ...]:
    """Channels of the dense maps per level, coarse to fine."""
    first, second, third, _ = config.dense_widths
    return (third, third, second, first)


def decoder_map_widths(config: NetworkConfig) -> tuple[int, ...]:
    """Channels of the dense maps that the decoders read, coarse to fine: the finest has the coarser ones beside it."""
    *coarser, finest = dense_map_widths(config)
    return (*coarser, finest + config.coarse_volume)


def aggregate(
    pyramid: VoxelPyramid,
    positions: Float[Tensor, "v 3"],
    sparse_features: tuple[Float[Tensor, "_ _"], ...],
    dense_maps: tuple[tuple[DenseMap, ...], ...],
    voxel_size: float,
    viewpoints: list[Float[Tensor, "3"] | None],
) -> list[tuple[Tokens, ...]]:
    """For each scene of a batch its tokens at strides 8, 4, 2 and 1, coarse to fine.

    Paper: token aggregation.
    Differs: the dense cell is looked up at the mean point of the token, in exact alignment.

    Args:
        pyramid: the batch's voxels; scene b has batch index b.
        positions: mean point of each finest voxel [m, workspace frame].
        sparse_features: coarse to fine, over the voxels of the batch.
        dense_maps: for each scene, coarse to fine.
        voxel_size: pitch of the finest voxels [m].
        viewpoints: for each scene where the camera stood [m, workspace frame], None where that is not known.
    """
    scenes = len(dense_maps)
    level_positions = [positions]
    of_voxel = [torch.arange(len(positions), device=positions.device)]
    for step in pyramid.steps[: len(sparse_features) - 1]:
        level_positions.append(mean_by_row(level_positions[-1], step.parents, len(step.coarse)))
        of_voxel.append(step.parents[of_voxel[-1]])
    counts = [torch.bincount(level.coordinates[:, 0], minlength=scenes).tolist() for level in pyramid.levels]
    by_scene: list[list[Tokens]] = [[] for _ in range(scenes)]
    for index, features in enumerate(sparse_features):
        level = len(sparse_features) - 1 - index
        first_row = 0
        parts = zip(
            level_positions[level].split(counts[level]),
            features.split(counts[level]),
            of_voxel[level].split(counts[0]),
            strict=True,
        )
        for scene, (position, feature, rows) in enumerate(parts):
            context = dense_maps[scene][index].nearest(position)
            tokens = torch.cat([feature.float(), context], 1)
            sight = lines_of_sight(position, viewpoints[scene])
            by_scene[scene].append(Tokens(position, tokens, voxel_size * 2**level, rows - first_row, sight))
            first_row += len(position)
    return [tuple(tokens) for tokens in by_scene]
