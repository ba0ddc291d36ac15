"""The network: one cloud in; instances, classes, shapes and grasps out.

Reads like the method section of the paper: features of surface and volume, token aggregation, query refinement, and
decoders that are asked at points. Nothing is kept on the network between `encode` and the decoders.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from icgnet.errors import InputError
from icgnet.geometry.cells import PITCH
from icgnet.grasping.gripper import Gripper
from icgnet.network.config import NetworkConfig
from icgnet.network.decoders import Affordance, ConditionedDecoder, ContactDecoder, ContactInputs
from icgnet.network.dense_map import DenseMap
from icgnet.network.dense_unet import CoarseVolume, DenseUNet
from icgnet.network.embedding import SceneEmbedding, TokenReads
from icgnet.network.hand_decoder import HandDecoder
from icgnet.network.hand_input import HandInput
from icgnet.network.inputs import SceneInput, surface_features
from icgnet.network.interpolation import Interpolation, NeighbourPooling, feature_level, placed
from icgnet.network.positional import FourierEncoding, scene_bounds
from icgnet.network.refinement import QueryRefinement, StageOutput
from icgnet.network.sparse_unet import SparseUNet, VoxelPyramid
from icgnet.network.tokens import Tokens, aggregate, dense_map_widths


class IcgNet(nn.Module):
    """Instance-centric grasp network.

    Paper: the whole model. Preset `paper` is as published, `default` reads grasps where the hand is.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.sparse = SparseUNet(config)
        self.dense = DenseUNet(config)
        self.encoding = FourierEncoding(config)
        self.refinement = QueryRefinement(config)
        channels = config.coarse_volume
        self.coarse_volume = CoarseVolume(dense_map_widths(config), channels) if channels else nn.Identity()
        self.pooling = NeighbourPooling(config)
        self.occupancy_features = Interpolation(config)
        self.affordance_features = Interpolation(config)
        self.occupancy = ConditionedDecoder(config, 1)
        self.affordance = HandDecoder(config) if config.affordance == "hand" else ContactDecoder(config)

    def encode(self, inputs: list[SceneInput]) -> list[SceneEmbedding]:
        """Embeddings of a batch of scenes; the U-Nets run on all at once, the queries scene by scene.

        Under `torch.autocast` only the U-Nets run in reduced precision: they are nearly all of the work, and what
        comes after them is small and wants exact positions.

        Raises:
            InputError: for a scene without voxels, or a dense grid that is not of this configuration.
        """
        self._check(inputs)
        coordinates = torch.cat([nn.functional.pad(s.voxels, (1, 0), value=b) for b, s in enumerate(inputs)])
        pyramid = VoxelPyramid.build(coordinates)
        positions = torch.cat([scene.positions for scene in inputs])
        surface = self.sparse(pyramid, surface_features(pyramid.levels[0], positions, self.config))
        volume = self.dense(_stacked([scene.dense for scene in inputs]), [scene.grid for scene in inputs])
        with _full_precision(positions):
            viewpoints = [scene.viewpoint for scene in inputs]
            tokens = aggregate(pyramid, positions, surface, volume, self.config.voxel_size, viewpoints)
            scenes = zip(inputs, tokens, volume, strict=True)
            return [self._embed(scene, levels, maps) for scene, levels, maps in scenes]

    def _embed(self, scene: SceneInput, levels: tuple[Tokens, ...], maps: tuple[DenseMap, ...]) -> SceneEmbedding:
        bounds = scene_bounds(scene.positions, self.config)
        query_positions, votes, stages = self.refinement(levels, self.encoding, bounds)
        maps = self.coarse_volume(maps)
        given = DenseMap(scene.dense.permute(1, 2, 3, 0).contiguous(), PITCH, scene.grid.origin)
        return SceneEmbedding(
            voxels=scene.voxels,
            positions=scene.positions,
            bounds=bounds,
            tokens=levels,
            dense_maps=maps,
            dense_input=given,
            of_tokens=TokenReads(
                self.occupancy_features.of_tokens(levels, self.pooling),
                self.affordance_features.of_tokens(levels, self.pooling),
            ),
            hand_map=self.affordance.hand_map(maps[-1], given),
            query_positions=query_positions,
            votes=votes,
            stages=stages,
        )

    def decode_occupancy(
        self,
        embedding: SceneEmbedding,
        queries: Int[Tensor, " i"],
        points: Float[Tensor, "n 3"],
        stage: int = -1,
    ) -> Float[Tensor, "i n"]:
        """Occupancy logits of the instances of the given queries at points [m, workspace frame]; above 0 is inside.

        Differentiable in the points (through dense map and positions), for surface normals.

        Raises:
            InputError: for a stage that the configuration does not decode.
        """
        with _full_precision(points):
            features, latent = self._occupancy_inputs(embedding, queries, points, stage)
            seeds = embedding.query_positions[queries][:, None]
            return self.occupancy(self._placed(features, points, seeds, embedding), latent[:, None])[..., 0]

    def decode_occupancy_pairs(
        self,
        embedding: SceneEmbedding,
        queries: Int[Tensor, " i"],
        points: Float[Tensor, "n 3"],
        instances: Int[Tensor, "n k"],
        stage: int = -1,
    ) -> Float[Tensor, "n k"]:
        """As `decode_occupancy`, for `k` instances of each point alone; `instances` are rows of `queries`."""
        with _full_precision(points):
            features, latent = self._occupancy_inputs(embedding, queries, points, stage)
            seeds = embedding.query_positions[queries[instances]]
            where = self._placed(features[:, None], points[:, None], seeds, embedding)
            return self.occupancy(where, latent, instances)[..., 0]

    def _occupancy_inputs(
        self, embedding: SceneEmbedding, queries: Int[Tensor, " i"], points: Float[Tensor, "n 3"], stage: int
    ) -> tuple[Float[Tensor, "n f"], Float[Tensor, "i c"]]:
        """Features at the points, and what the decoder is told of the queries."""
        stage, _ = self._stage(embedding, stage)
        of_tokens = embedding.of_tokens.occupancy
        features = self.occupancy_features(points, embedding, of_tokens, feature_level(stage), self.pooling)
        return features, self._latent(embedding, queries, embedding.stages[stage].queries)

    def _placed(self, features: Tensor, points: Tensor, seeds: Tensor, embedding: SceneEmbedding) -> Tensor:
        """Features of points as seen from queries that were seeded there; the position relative to the seed first."""
        own = self.encoding(seeds, seeds, embedding.bounds)[..., :3]
        return placed(features, self.encoding(points, seeds, embedding.bounds), own)

    @property
    def device(self) -> torch.device:
        """What the network computes on."""
        return next(self.parameters()).device

    def decode_affordance(
        self,
        embedding: SceneEmbedding,
        queries: Int[Tensor, " g"],
        contacts: Float[Tensor, "g 3"],
        normals: Float[Tensor, "g 3"],
        hand: HandInput,
        stage: int = -1,
    ) -> Affordance:
        """Grasp success per approach angle and opening width at contacts, each with its own instance's query.

        Args:
            embedding: of the scene.
            queries: for each contact the query of the instance it is on.
            contacts: points on the objects [m, workspace frame].
            normals: outward unit normals there (table frame); a network of the published kind ignores them.
            hand: that is to grasp, see `hand_input`; a network of the published kind knows only its own.
            stage: which stage's queries are decoded; the last by default.

        Raises:
            InputError: for a stage that the configuration does not decode.
        """
        stage, affordance_queries = self._stage(embedding, stage)
        level = feature_level(stage)
        with _full_precision(contacts):
            of_tokens = embedding.of_tokens.affordance
            features = self.affordance_features(contacts, embedding, of_tokens, level, self.pooling)
            seeds = embedding.query_positions[queries]
            features = placed(features, self.encoding(contacts, seeds, embedding.bounds))
            latent = self._latent(embedding, queries, affordance_queries)
            told = ContactInputs(features, affordance_queries[queries], latent, contacts, normals, hand, embedding)
            return self.affordance(told)

    def hand_input(self, gripper: Gripper) -> HandInput:
        """What the affordance decoder is told of a hand."""
        return HandInput.of(gripper, self.config.hand).to(self.device)

    def _latent(self, embedding: SceneEmbedding, rows: Tensor, queries: Tensor) -> Tensor:
        """Query, its positional encoding and the scene scale, for the chosen rows."""
        seeds = embedding.query_positions[rows]
        positions = self.encoding(seeds, seeds, embedding.bounds)
        scale = embedding.bounds.extent.expand(len(rows), 1)
        return torch.cat([queries[rows], positions, scale], 1)

    def _stage(self, embedding: SceneEmbedding, stage: int) -> tuple[int, Float[Tensor, "q c"]]:
        stage = stage % len(embedding.stages)
        output: StageOutput = embedding.stages[stage]
        if output.affordance_queries is None:
            raise InputError(f"stage {stage} is not decoded; this network decodes {self.config.decoded_stages}")
        return stage, output.affordance_queries

    def _check(self, inputs: list[SceneInput]) -> None:
        for number, scene in enumerate(inputs):
            expected = (self.config.dense_channels, *scene.grid.shape)
            if len(scene.voxels) == 0:
                raise InputError(f"scene {number} has no voxels")
            if tuple(scene.dense.shape) != expected:
                raise InputError(f"scene {number}: dense grid {tuple(scene.dense.shape)}, expected {expected}")


def _stacked(grids: list[Float[Tensor, "d _ _ _"]]) -> Float[Tensor, "b d x y z"]:
    """Grids of one size or of several, these with zeros beyond their ends."""
    largest = [max(grid.shape[axis] for grid in grids) for axis in (1, 2, 3)]
    stacked = grids[0].new_zeros(len(grids), grids[0].shape[0], *largest)
    for whole, grid in zip(stacked, grids, strict=True):
        whole[:, : grid.shape[1], : grid.shape[2], : grid.shape[3]] = grid
    return stacked


def _full_precision(like: Tensor) -> torch.autocast:
    return torch.autocast(like.device.type, enabled=False)
