"""Instance queries: their start, their refinement by masked attention, and what is predicted from them."""

import math
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.network.config import NetworkConfig
from icgnet.network.inputs import second_moments
from icgnet.network.layers import Attention, FeedForward, ResidualBlock
from icgnet.network.neighbours import farthest_points, spaced_points
from icgnet.network.positional import Bounds, FourierEncoding, Places
from icgnet.network.tokens import Tokens, token_widths

BALL_OFFSET, BALL_SIZE = 0.05, 0.03
"""Units of a seeded mask's offset and size [m]: about the size of the objects."""
EXTENTS, EXTENT_UNIT = 5, 0.05
"""Numbers that tell the class head how large a mask is, and their unit [m]."""
CLASS_LEVELS = (0, 1)
"""Levels of the coarse tokens that the class head reads: 24 and 12 mm."""
CLASS_POINTS = 64
"""Voxels of a mask that the class head looks at one by one."""
GROUP_SIZE = 0.15
"""Queries in a tile of this edge attend together [m]: about as large as the objects that they are on."""
SEED_LEVEL = 2
"""Tokens that queries are seeded on, where they are seeded by area: 6 mm."""
OFF_MIDDLE = (1e-4, 2e-4, 3e-4)
"""Seeds are the voxels nearest to a place so far from a token's middle [m]: of two voxels both are as near to that, and
rounding would choose."""
OUT_OF_REACH = -20.0
"""Logit of a mask at a voxel that is farther from the query's seed than it may reach."""


@dataclass(frozen=True, eq=False)
class StageOutput:
    """What the queries say before a refinement stage, or (the last one) after all of them."""

    queries: Float[Tensor, "q c"]
    known_masks: Float[Tensor, "v q"] | None
    """Whether a voxel belongs to a query's instance; None outside of training at stages that are not decoded, which
    need their masks at coarser tokens only."""
    known_classes: Float[Tensor, "q k"] | None
    """Scores of the classes; the last one is "no object". None outside of training at stages that are not decoded."""
    affordance_queries: Float[Tensor, "q c"] | None
    """The queries for the affordance decoder; None at stages that the configuration does not decode."""

    @property
    def mask_logits(self) -> Float[Tensor, "v q"]:
        """The masks at a stage that has them."""
        assert self.known_masks is not None, "only the last stage has masks outside of training"
        return self.known_masks

    @property
    def class_logits(self) -> Float[Tensor, "q k"]:
        """The scores of the classes at a stage that has them."""
        assert self.known_classes is not None, "only the last stage is classed outside of training"
        return self.known_classes


def attention_blocks(
    pooled_logits: Float[Tensor, "t q"], threshold: float, far: Bool[Tensor, "q t"]
) -> Bool[Tensor, "q t"]:
    """Which tokens each query must not attend to: those that its pooled mask does not cover, and those that are far.

    A query whose mask covers nothing attends to everything that is not far.
    """
    blocked = far | (pooled_logits < _logit(threshold)).t()
    return torch.where(blocked.all(1, keepdim=True), far, blocked)


def _logit(probability: float) -> float:
    if not 0.0 < probability < 1.0:
        return math.copysign(math.inf, probability - 0.5)
    return math.log(probability / (1.0 - probability))


@dataclass(frozen=True, eq=False)
class MaskScene:
    """What all predictions of a scene share: they differ by the queries alone."""

    features: Float[Tensor, "v c"]
    """Projected features of the finest tokens."""
    places: Places
    """Where these are for every query."""
    far: Bool[Tensor, "q v"]
    """Which of them are out of a query's reach."""
    middle: Float[Tensor, "3"]
    """What moments are taken about, see `middle_on_table` [m, table frame]."""
    moments: Float[Tensor, "v m"]
    """Positions and their products, see `position_moments`; sums of them under a mask tell its place and extent."""
    seeds: Float[Tensor, "q 3"]
    """Where the queries were seeded [m, workspace frame]."""
    votes: Float[Tensor, "v b"]
    """Moments of where the voxels say that the middle of their object is; none without votes."""
    described: Float[Tensor, "v d"]
    """What the class head averages under a mask, see `ClassHead.describe`."""
    looked_at: Float[Tensor, "v e"]
    """What it reads at single voxels, see `ClassHead.look_at`."""

    def pooled(self, tokens: Tokens, far: Bool[Tensor, "q t"]) -> "MaskScene":
        """The same at coarser tokens, for masks alone: of means of what is read, these are the means of the logits."""
        places = Places(self.places.of_queries, tokens.pool(self.places.of_points))
        read = {name: tokens.pool(getattr(self, name)) for name in ("features", "moments", "votes")}
        not_read = dict.fromkeys(("described", "looked_at"), tokens.features[:, :0])
        return replace(self, places=places, far=far, **read, **not_read)


def middle_on_table(positions: Float[Tensor, "v 3"]) -> Float[Tensor, "3"]:
    """The middle of a scene at the height of the table: what moments are taken about, for the precision of squares."""
    middle = 0.5 * (positions.amin(0) + positions.amax(0))
    return torch.cat([middle[:2], middle.new_tensor([TABLE_HEIGHT])])


def tiles(points: Float[Tensor, "n 3"], size: float) -> tuple[Int[Tensor, "_"], ...]:
    """Rows of the points in each square tile of this edge [m] that holds any."""
    cells = torch.floor(points[:, :2] / size)
    _, tile = torch.unique(cells, dim=0, return_inverse=True)
    return tile.argsort(stable=True).split(torch.bincount(tile).tolist())


def position_moments(positions: Float[Tensor, "v 3"], middle: Float[Tensor, "3"]) -> Float[Tensor, "v 11"]:
    """1, position, its products xx, xy, xz, yy, yz, zz [m, m^2; about the middle], and the 8th power of height."""
    centred = positions - middle
    eighth = (centred[:, 2:] / EXTENT_UNIT).clamp(min=0).pow(8)
    return torch.cat([torch.ones_like(eighth), centred, second_moments(centred), eighth], 1)


class MaskHead(nn.Module):
    """Mask logits: dot product of an embedding of the query with a projection of the finest tokens."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.query_width
        self.project = nn.Linear(token_widths(config)[-1], width)
        self.norm = nn.LayerNorm(width)
        self.embed = nn.Sequential(*(ResidualBlock(width, width) for _ in range(3)), nn.Linear(width, width))

    def forward(self, queries: Float[Tensor, "q c"], scene: MaskScene) -> Float[Tensor, "v q"]:
        """Logits of the masks of the queries."""
        return scene.features @ self.embed(self.norm(queries)).t()


class SeededMaskHead(MaskHead):
    """Also reads the voxels' positional encoding, and adds a ball around the seed, moved and sized by the query.

    Differs from the paper: features alone cannot tell two alike objects apart before much training. A second ball, as
    strong as the query says, is around where the voxels vote that the middle of their object is: what touches has
    one surface, but two middles.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        self.place = nn.Linear(config.query_width, config.query_width, bias=False)
        self.ball = nn.Linear(config.query_width, 4)
        _make_zero(self.ball)
        self.vote_ball = None
        if config.votes:
            self.vote_ball = nn.Linear(config.query_width, 5)
            _make_zero(self.vote_ball)

    def forward(self, queries: Float[Tensor, "q c"], scene: MaskScene) -> Float[Tensor, "v q"]:
        """Logits of the masks of the queries."""
        queries = self.norm(queries)
        embedded = self.embed(queries)
        seeds = scene.seeds - scene.middle
        asked = [embedded, scene.places.dot(embedded @ self.place.weight), ball_weights(self.ball(queries), seeds)]
        if self.vote_ball is not None:
            ball, strength = self.vote_ball(queries).split((4, 1), 1)
            asked.append(strength * ball_weights(ball, seeds))
        # One product for all of them: what comes out is the largest thing in the network.
        read = torch.cat([scene.features, scene.places.of_points, scene.moments[:, :BALL_MOMENTS], scene.votes], 1)
        logits = torch.addmm(read.new_ones(1), read, torch.cat(asked, 1).t())
        return logits.masked_fill_(scene.far.t(), OUT_OF_REACH)


BALL_MOMENTS = 10
"""The moments that balls are made of: 1, positions and their products."""


def ball_weights(balls: Float[Tensor, "q 4"], seeds: Float[Tensor, "q 3"]) -> Float[Tensor, "q m"]:
    """Factors of the moments of a voxel for a logit that falls from 1 at a centre through 0 at the ball's radius.

    The logit is 1 plus the product of both: `1 - |p - c|^2 / (2 s^2)`.

    Args:
        balls: offset of the centre from the seed in units of 5 cm, and logarithm of the size in units of 3 cm.
        seeds: where the queries were seeded, from what moments are taken about [m].
    """
    centres = seeds + BALL_OFFSET * balls[:, :3]
    precision = (BALL_SIZE * balls[:, 3:].clamp(-1.5, 1.5).exp()) ** -2
    # |p - c|^2 = |c|^2 - 2 c p + |p|^2: one product of the moments up to the squares xx, yy and zz.
    square = centres.square().sum(1, keepdim=True)
    none, one = torch.zeros_like(square), torch.ones_like(square)
    factors = torch.cat([square, -2.0 * centres, one, none, none, one, none, one], 1)
    return -0.5 * precision * factors


class ClassHead(nn.Module):
    """Class logits of the queries, read from the query alone."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.query_width
        self.of_query = nn.Sequential(ResidualBlock(width, width), nn.Linear(width, len(config.classes) + 1))

    def describe(self, levels: tuple[Tokens, ...]) -> Float[Tensor, "v d"]:
        """Features of every voxel to average under a mask, from all tokens of a scene, coarse to fine: here none."""
        return levels[-1].features[:, :0]

    def look_at(self, levels: tuple[Tokens, ...]) -> Float[Tensor, "v e"]:
        """Features of every voxel to read one by one, from all tokens of a scene: here none."""
        return levels[-1].features[:, :0]

    def forward(
        self, queries: Float[Tensor, "q c"], mask_logits: Float[Tensor, "v q"], scene: MaskScene
    ) -> Float[Tensor, "q k"]:
        """Logits of the classes, the last one for "no object"; the masks are those of the queries in the scene."""
        return self.of_query(queries)


class MaskClassHead(ClassHead):
    """Also reads the mask: mean features of its voxels, how large they are together, and where some of them lie.

    Differs from the paper. The features are fine ones and those of the coarse tokens around; single voxels are read as
    PointNet does; gradients do not flow into the mask.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__(config)
        width = config.query_width
        coarse, fine = token_widths(config)[: len(CLASS_LEVELS)], token_widths(config)[-1]
        self.around = nn.ModuleList(nn.Linear(inputs, width, bias=False) for inputs in coarse)
        self.look = nn.Linear(fine, width)
        self.points = nn.Sequential(
            *(nn.Linear(width + 3, 2 * width), nn.ReLU()),
            *(nn.Linear(2 * width, 2 * width), nn.ReLU()),
            nn.Linear(2 * width, 2 * width),
        )
        inputs = width + fine + EXTENTS + width * len(coarse) + 2 * width
        self.of_mask = nn.Sequential(nn.Linear(inputs, 2 * width), nn.ReLU(), nn.Linear(2 * width, 2 * width))
        last = nn.Linear(2 * width, len(config.classes) + 1)
        _make_zero(last)
        self.end = nn.Sequential(nn.ReLU(), last)

    def describe(self, levels: tuple[Tokens, ...]) -> Float[Tensor, "v d"]:
        """Features of every voxel, fine and of the tokens around, from all tokens of a scene, coarse to fine."""
        around = [
            project(levels[index].features).index_select(0, levels[index].of_voxel)
            for index, project in zip(CLASS_LEVELS, self.around, strict=True)
        ]
        return torch.cat([levels[-1].features, *around], 1)

    def look_at(self, levels: tuple[Tokens, ...]) -> Float[Tensor, "v e"]:
        """Projected features of every voxel, from all tokens of a scene, coarse to fine."""
        return self.look(levels[-1].features)

    def forward(
        self, queries: Float[Tensor, "q c"], mask_logits: Float[Tensor, "v q"], scene: MaskScene
    ) -> Float[Tensor, "q k"]:
        """Logits of the classes, the last one for "no object"; the masks are those of the queries in the scene."""
        read = torch.cat([scene.described, scene.moments], 1)
        total = mask_logits.detach().float().sigmoid().t() @ read
        features, moments = total.split((scene.described.shape[1], scene.moments.shape[1]), 1)
        # The first moment is 1.
        weight = moments[:, :1].clamp(min=1e-6)
        features, moments = features / weight, moments / weight
        fine = features.shape[1] - len(self.around) * queries.shape[1]
        points = self._points(mask_logits, moments, scene)
        parts = [queries, features[:, :fine], extents(moments), features[:, fine:], points]
        return super().forward(queries, mask_logits, scene) + self.end(self.of_mask(torch.cat(parts, 1)))

    def _points(
        self, mask_logits: Float[Tensor, "v q"], moments: Float[Tensor, "q m"], scene: MaskScene
    ) -> Float[Tensor, "q c"]:
        """The most of what some voxels of each mask say, which know where they lie in it and above the table."""
        rows = spread_rows(mask_logits.detach() > 0, mask_logits.detach().argmax(0), CLASS_POINTS)
        middle = moments[:, 1:4] * moments.new_tensor([1.0, 1.0, 0.0])
        places = (scene.moments[:, 1:4][rows] - middle[:, None]) / EXTENT_UNIT
        return self.points(torch.cat([scene.looked_at[rows], places], 2)).amax(1)


def spread_rows(inside: Bool[Tensor, "v q"], otherwise: Int[Tensor, " q"], count: int) -> Int[Tensor, "q k"]:
    """For each column `count` of the rows that are inside, evenly spread; some of them often where there are few.

    Args:
        inside: which rows may be taken.
        otherwise: the row for a column in which none is inside.
        count: rows that are wanted for each column.
    """
    column, row = torch.nonzero(inside.t(), as_tuple=True)
    total = torch.bincount(column, minlength=inside.shape[1])[:, None]
    places = (torch.arange(count, device=inside.device) + 0.5) / count
    chosen = total.cumsum(0) - total + (places * total).long()
    rows = torch.cat([row, row.new_zeros(1)])[chosen.clamp(max=len(row))]
    return torch.where(total > 0, rows, otherwise[:, None])


def extents(moments: Float[Tensor, "q 11"]) -> Float[Tensor, "q e"]:
    """Size and height of weighted points, whatever their turn about the vertical, in units of 5 cm.

    Standard deviations (longer horizontal, shorter horizontal, vertical), mean height above the table, and nearly the
    largest height (the mean of eighth powers).

    Args:
        moments: weighted means of `position_moments`.
    """
    _, x, y, z, xx, xy, _, yy, _, zz, eighth = moments.unbind(1)
    xx, xy, yy, zz = xx - x * x, xy - x * y, yy - y * y, zz - z * z
    trace, half = xx + yy, 0.5 * (xx - yy)
    root = (half.square() + xy.square()).clamp(min=0).sqrt()
    spread = torch.stack([0.5 * trace + root, 0.5 * trace - root, zz], 1).clamp(min=0.0).sqrt()
    return torch.cat([spread / EXTENT_UNIT, z[:, None] / EXTENT_UNIT, eighth.clamp(min=0).pow(1 / 8)[:, None]], 1)


class RefinementStage(nn.Module):
    """One stage at one level: masked cross-attention to the tokens, self-attention, feed-forward.

    Paper: query refinement, with the additional MLP on the scene features.
    """

    def __init__(self, token_width: int, config: NetworkConfig) -> None:
        super().__init__()
        width = config.query_width
        self.tokens = nn.Sequential(ResidualBlock(token_width, width), FeedForward(width, config.token_feed_forward))
        self.cross_attention = Attention(width, config.heads)
        self.self_attention = Attention(width, config.heads)
        self.feed_forward = FeedForward(width, config.feed_forward)

    def forward(
        self,
        queries: Float[Tensor, "q c"],
        seeds: "Seeds",
        features: Float[Tensor, "t i"],
        places: Places,
        blocked: Bool[Tensor, "q t"],
    ) -> Float[Tensor, "q c"]:
        """Queries after one look at the tokens (`features` as aggregated) that are not blocked for them."""
        queries = self.cross_attention(queries, seeds.own, self.tokens(features), places, blocked, seeds.groups)
        queries = self.self_attention(queries, seeds.own, queries, seeds.places, seeds.far, seeds.groups)
        return self.feed_forward(queries)


class AffordanceRefinement(nn.Module):
    """Turns instance queries into affordance queries: feed-forward, then self-attention among the objects.

    Paper: "a final self attention and MLP layer to exchange inter-object information".
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width, hidden = config.query_width, config.affordance_feed_forward
        self.start = FeedForward(width, hidden)
        self.attentions = nn.ModuleList(Attention(width, config.heads) for _ in range(config.affordance_rounds))
        self.feed_forwards = nn.ModuleList(FeedForward(width, hidden) for _ in range(config.affordance_rounds))

    def forward(
        self, queries: Float[Tensor, "q c"], seeds: "Seeds", class_logits: Float[Tensor, "q k"]
    ) -> Float[Tensor, "q c"]:
        """Queries that are classed "no object" are not attended to, unless all in reach are."""
        empty = class_logits.detach().argmax(1) == class_logits.shape[1] - 1
        blocked = seeds.far | empty
        blocked = torch.where(blocked.all(1, keepdim=True), seeds.far, blocked)
        queries = self.start(queries)
        for attention, feed_forward in zip(self.attentions, self.feed_forwards, strict=True):
            queries = feed_forward(attention(queries, seeds.own, queries, seeds.places, blocked, seeds.groups))
        return queries


@dataclass(frozen=True, eq=False)
class Seeds:
    """Where the queries begin."""

    positions: Float[Tensor, "q 3"]
    """On the surface [m]."""
    own: Float[Tensor, "q c"]
    """Encoding of each one's place for itself."""
    places: Places
    """Where all of them are for each query."""
    far: Bool[Tensor, "q q"]
    """Which of them are out of a query's reach."""
    groups: tuple[Int[Tensor, "_"], ...]
    """Rows of the queries that lie together."""


class Votes(nn.Module):
    """Where the voxels say that the middle of their object is.

    Differs from the paper; center votes as in UOIS-Net-3D (Xie et al. 2021).
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = token_widths(config)[-1]
        last = nn.Linear(2 * width, 3)
        _make_zero(last)
        self.offset = nn.Sequential(nn.Linear(width, 2 * width), nn.ReLU(), last)

    def forward(self, tokens: Tokens) -> Float[Tensor, "v 3"]:
        """A place for each of the finest tokens [m, workspace frame]."""
        return tokens.positions + BALL_OFFSET * self.offset(tokens.features)


class QueryRefinement(nn.Module):
    """From the tokens of a scene to its instance queries, in four stages, coarse to fine."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        width = config.query_width
        self.content = nn.Parameter(torch.randn(1 if config.any_extent else config.queries, width))
        self.content_of_seed = None
        if config.seeded_content:
            self.content_of_seed = nn.Linear(token_widths(config)[-1], width)
            _make_zero(self.content_of_seed)
        self.stages = nn.ModuleList(RefinementStage(tokens, config) for tokens in token_widths(config))
        self.mask_head = SeededMaskHead(config) if config.seeded_masks else MaskHead(config)
        self.votes = Votes(config) if config.votes else None
        self.class_head = MaskClassHead(config) if config.class_of_mask else ClassHead(config)
        self.affordance = AffordanceRefinement(config)

    def forward(
        self, levels: tuple[Tokens, ...], encoding: FourierEncoding, bounds: Bounds
    ) -> tuple[Float[Tensor, "q 3"], Float[Tensor, "v 3"] | None, tuple[StageOutput, ...]]:
        """Positions of the queries, votes of the voxels [m, workspace frame], and the predictions of all stages."""
        finest = levels[-1]
        rows = self.seed_rows(levels)
        positions = finest.positions[rows]
        seeds = Seeds(
            positions=positions,
            own=encoding(positions, positions, bounds),
            places=encoding.places(positions, positions, bounds),
            far=self._far(positions, positions),
            groups=tiles(positions, GROUP_SIZE)
            if self.config.any_extent
            else (torch.arange(len(rows), device=rows.device),),
        )
        middle = middle_on_table(finest.positions)
        votes = None if self.votes is None else self.votes(finest)
        scene = MaskScene(
            features=self.mask_head.project(finest.features),
            places=encoding.places(finest.positions, positions, bounds),
            far=self._far(positions, finest.positions),
            middle=middle,
            moments=position_moments(finest.positions, middle),
            seeds=positions,
            votes=finest.positions[:, :0] if votes is None else position_moments(votes, middle)[:, :BALL_MOMENTS],
            described=self.class_head.describe(levels),
            looked_at=self.class_head.look_at(levels),
        )
        queries = self.content.expand(len(rows), -1)
        if self.content_of_seed is not None:
            queries = queries + self.content_of_seed(finest.features[rows])
        outputs = [self._predict(0, queries, seeds, scene)]
        for index, (stage, tokens) in enumerate(zip(self.stages, levels, strict=True)):
            features, places = tokens.features, encoding.places(tokens.positions, positions, bounds)
            far = scene.far if tokens is finest else self._far(positions, tokens.positions)
            masks = outputs[-1].known_masks
            at_tokens = self.mask_head(queries, scene.pooled(tokens, far)) if masks is None else tokens.pool(masks)
            blocked = attention_blocks(at_tokens.detach(), self.config.attention_threshold, far)
            limit = self.config.tokens_per_level[index]
            if self.training and len(features) > limit:
                kept = torch.randperm(len(features), device=features.device)[:limit]
                features, places, blocked = features[kept], places.select(kept), blocked[:, kept]
                blocked = blocked & ~blocked.all(1, keepdim=True)
            queries = stage(queries, seeds, features, places, blocked)
            outputs.append(self._predict(index + 1, queries, seeds, scene))
        return positions, votes, tuple(outputs)

    def seed_rows(self, levels: tuple[Tokens, ...]) -> Int[Tensor, " q"]:
        """The voxels that queries are seeded on: one every few centimetres of surface, or a fixed number.

        Paper: a fixed number of farthest points.
        """
        finest = levels[-1]
        if not self.config.any_extent:
            return farthest_points(finest.positions, self.config.queries)
        coarser = levels[SEED_LEVEL]
        places = coarser.positions[spaced_points(coarser.positions, self.config.seed_spacing)]
        return finest.search.nearest(places + places.new_tensor(OFF_MIDDLE), 1)[:, 0]

    def _far(self, seeds: Float[Tensor, "q 3"], points: Float[Tensor, "t 3"]) -> Bool[Tensor, "q t"]:
        """Which points are out of the reach of a query."""
        if not self.config.any_extent:
            return torch.zeros(len(seeds), len(points), dtype=torch.bool, device=points.device)
        return torch.cdist(seeds, points) > self.config.reach

    def _predict(self, index: int, queries: Tensor, seeds: Seeds, scene: MaskScene) -> StageOutput:
        decoded = index in self.config.decoded_stages
        if not decoded and not self.training:
            return StageOutput(queries, None, None, None)
        mask_logits = self.mask_head(queries, scene)
        class_logits = self.class_head(queries, mask_logits, scene)
        affordance_queries = self.affordance(queries, seeds, class_logits) if decoded else None
        return StageOutput(queries, mask_logits, class_logits, affordance_queries)


def _make_zero(layer: nn.Linear) -> None:
    """Starts a layer that adds to another with nothing to say."""
    nn.init.zeros_(layer.weight)
    nn.init.zeros_(layer.bias)
