"""What the encoder hands to the decoders: everything about one scene, and nothing kept on the network."""

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor

from icgnet.network.dense_map import DenseMap
from icgnet.network.positional import Bounds
from icgnet.network.refinement import StageOutput
from icgnet.network.tokens import Tokens


@dataclass(frozen=True, eq=False)
class TokenReads:
    """Features of the tokens, projected for each task; per level that is decoded, coarse to fine."""

    occupancy: tuple[Float[Tensor, "_ d"], ...]
    affordance: tuple[Float[Tensor, "_ d"], ...]


@dataclass(frozen=True, eq=False)
class SceneEmbedding:
    """One encoded scene. Decode it as often as wanted, also after other scenes were encoded."""

    voxels: Int[Tensor, "v 3"]
    """Indices of the finest voxels."""
    positions: Float[Tensor, "v 3"]
    """Mean point of each voxel [m, workspace frame]."""
    bounds: Bounds
    """What positions are normalised by."""
    tokens: tuple[Tokens, ...]
    """Surface tokens at 24, 12, 6 and 3 mm, coarse to fine."""
    dense_maps: tuple[DenseMap, ...]
    """Volumetric maps that belong to the token levels."""
    dense_input: DenseMap
    """Input of the dense part: occupancy, and visibility if the configuration has it."""
    of_tokens: TokenReads
    """What the decoders read of the tokens wherever they are asked."""
    hand_map: DenseMap | None
    """What a decoder of grasps reads at the hand; None if it reads nothing there."""
    query_positions: Float[Tensor, "q 3"]
    """Where each query started [m, workspace frame]."""
    votes: Float[Tensor, "v 3"] | None
    """Where each voxel says that the middle of what is seen of its object is [m, workspace frame], with votes."""
    stages: tuple[StageOutput, ...]
    """Predictions before each refinement stage and, last, after all of them."""

    def detach(self) -> "SceneEmbedding":
        """The same without history for gradients."""
        return _map_tensors(self, Tensor.detach)

    def to(self, device: torch.device | str) -> "SceneEmbedding":
        """The same on another device."""
        return _map_tensors(self, lambda tensor: tensor.to(device))


def _map_tensors(value: Any, function: Callable[[Tensor], Tensor]) -> Any:
    if isinstance(value, Tensor):
        return function(value)
    if isinstance(value, tuple):
        return tuple(_map_tensors(item, function) for item in value)
    if is_dataclass(value) and not isinstance(value, type):
        return type(value)(**{f.name: _map_tensors(getattr(value, f.name), function) for f in fields(value)})
    return value
