from dataclasses import replace

import pytest
import torch

from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.network.config import NETWORKS
from icgnet.network.layers import Attention
from icgnet.network.positional import FourierEncoding, Places, scene_bounds
from icgnet.network.refinement import (
    BALL_MOMENTS,
    AffordanceRefinement,
    MaskClassHead,
    MaskScene,
    QueryRefinement,
    SeededMaskHead,
    Seeds,
    Votes,
    attention_blocks,
    ball_weights,
    extents,
    middle_on_table,
    position_moments,
    spread_rows,
    tiles,
)
from icgnet.network.tokens import Tokens, token_widths

TINY = NETWORKS["tiny"]
ENCODING = FourierEncoding(TINY)
GROUPS = (torch.tensor([2, 0]), torch.tensor([1]))
"""Of three queries."""


def places_of(points: torch.Tensor, seeds: torch.Tensor) -> Places:
    return ENCODING.places(points, seeds, scene_bounds(points, TINY))


def nothing_far(queries: int, points: int) -> torch.Tensor:
    return torch.zeros(queries, points, dtype=torch.bool)


def seeds_of(positions: torch.Tensor) -> Seeds:
    own = ENCODING(positions, positions, scene_bounds(positions, TINY))
    far = nothing_far(len(positions), len(positions))
    return Seeds(positions, own, places_of(positions, positions), far, tiles(positions, 0.15))


def ball_logits(balls: torch.Tensor, scene: MaskScene) -> torch.Tensor:
    return 1.0 + scene.moments[:, :BALL_MOMENTS] @ ball_weights(balls, scene.seeds - scene.middle).t()


def scene_of(positions: torch.Tensor, seeds: torch.Tensor, **known: torch.Tensor) -> MaskScene:
    """Voxels without features, but for those that are known."""
    none = torch.zeros(len(positions), 0)
    shared = {"features": torch.zeros(len(positions), 8), "described": none, "looked_at": none}
    shared["votes"] = torch.zeros(len(positions), BALL_MOMENTS)
    shared["far"] = nothing_far(len(seeds), len(positions))
    places, middle = places_of(positions, seeds), middle_on_table(positions)
    moments = position_moments(positions, middle)
    return MaskScene(places=places, middle=middle, moments=moments, seeds=seeds, **(shared | known))


def tokens_of(of_voxel: list[int]) -> Tokens:
    count = max(of_voxel) + 1
    features, none = torch.rand(count, 4), torch.zeros(count, 3)
    return Tokens(torch.rand(count, 3), features, 0.006, torch.tensor(of_voxel), none)


def test_tokens_outside_a_query_s_pooled_mask_are_blocked():
    mask_logits = torch.tensor([[3.0, -1.0], [1.0, -1.0], [-5.0, 2.0], [1.0, -2.0]])
    blocked = attention_blocks(tokens_of([0, 0, 1, 1]).pool(mask_logits), 0.5, nothing_far(2, 2))
    assert blocked.tolist() == [[False, True], [True, False]]  # mean logits 2, -2 and -1, 0


def test_a_query_that_covers_nothing_attends_to_everything_in_its_reach():
    nothing = torch.full((4, 1), -9.0)
    assert not attention_blocks(nothing, 0.5, nothing_far(1, 4)).any()
    far = torch.tensor([[False, True, False, True]])
    assert torch.equal(attention_blocks(nothing, 0.5, far), far)


def test_masks_at_coarser_tokens_are_the_means_of_those_of_their_voxels():
    torch.manual_seed(0)
    head, positions, seeds = SeededMaskHead(TINY), torch.rand(20, 3) * 0.2, torch.rand(4, 3) * 0.2
    head.vote_ball.weight.data.normal_()
    votes = position_moments(torch.rand(20, 3) * 0.2, middle_on_table(positions))[:, :BALL_MOMENTS]
    scene = scene_of(positions, seeds, features=torch.randn(20, 8), votes=votes)
    tokens, queries = tokens_of(list(range(7)) * 2 + list(range(6))), torch.randn(4, 8)
    pooled = head(queries, scene.pooled(tokens, nothing_far(4, 7)))
    torch.testing.assert_close(pooled, tokens.pool(head(queries, scene)), atol=1e-4, rtol=1e-4)


def test_what_is_out_of_reach_is_blocked_even_where_a_mask_covers_it():
    far = torch.tensor([[False, True]])
    assert torch.equal(attention_blocks(torch.full((2, 1), 9.0), 0.5, far), far)


def test_blocked_tokens_have_no_influence():
    torch.manual_seed(0)
    attention = Attention(8, 2)
    queries, tokens, own = torch.randn(3, 8), torch.randn(5, 8), torch.randn(3, 8)
    places = places_of(torch.rand(5, 3), torch.rand(3, 3))
    blocked = torch.zeros(3, 5, dtype=torch.bool)
    blocked[0, 3:] = True
    changed = tokens.clone()
    changed[3:] += 1.0
    before = attention(queries, own, tokens, places, blocked, GROUPS)
    after = attention(queries, own, changed, places, blocked, GROUPS)
    torch.testing.assert_close(before[0], after[0])
    assert (before[1:] - after[1:]).abs().max() > 1e-3


def test_affordance_queries_do_not_attend_to_queries_without_an_object():
    torch.manual_seed(0)
    refinement = AffordanceRefinement(NETWORKS["tiny"])
    queries, seeds = torch.randn(4, 8), seeds_of(torch.rand(4, 3) * 0.1)
    class_logits = torch.zeros(4, 8)
    class_logits[:, 0] = 1.0
    class_logits[3, -1] = 5.0
    changed = queries.clone()
    changed[3] = torch.randn(8)
    before, after = refinement(queries, seeds, class_logits), refinement(changed, seeds, class_logits)
    torch.testing.assert_close(before[:3], after[:3])
    assert (before[3] - after[3]).abs().max() > 1e-3


def test_affordance_queries_are_finite_when_no_query_has_an_object():
    class_logits = torch.zeros(4, 8)
    class_logits[:, -1] = 1.0
    result = AffordanceRefinement(NETWORKS["tiny"])(torch.randn(4, 8), seeds_of(torch.rand(4, 3)), class_logits)
    assert torch.isfinite(result).all()


def test_affordance_queries_attend_only_to_those_in_reach():
    torch.manual_seed(0)
    refinement = AffordanceRefinement(NETWORKS["tiny"])
    queries, seeds = torch.randn(4, 8), seeds_of(torch.tensor([[0.1, 0.1, 0.1], [0.2, 0.1, 0.1]] * 2))
    seeds.far[:2, 2:] = seeds.far[2:, :2] = True
    changed = queries.clone()
    changed[2] = torch.randn(8)
    for last in (0.0, 5.0):  # With objects, and if no query is one.
        class_logits = torch.zeros(4, 8)
        class_logits[:, 0], class_logits[:, -1] = 1.0, last
        before, after = refinement(queries, seeds, class_logits), refinement(changed, seeds, class_logits)
        torch.testing.assert_close(before[:2], after[:2])
        assert (before[2:] - after[2:]).abs().amin(0).max() > 1e-3


def test_extents_do_not_change_when_the_object_turns_or_moves_on_the_table():
    torch.manual_seed(0)
    points = torch.rand(200, 3) * torch.tensor([0.10, 0.03, 0.06]) + torch.tensor([0.0, 0.0, TABLE_HEIGHT])
    turn = torch.tensor([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    shares = torch.full((1, 200), 1 / 200)
    moved = points @ turn.T + torch.tensor([0.1, 0.05, 0.0])
    before, after = (extents(shares @ position_moments(each, middle_on_table(points))) for each in (points, moved))
    torch.testing.assert_close(before, after, rtol=1e-3, atol=1e-3)
    wanted = torch.tensor([0.10 / 12**0.5, 0.03 / 12**0.5, 0.06 / 12**0.5, 0.03]) / 0.05
    torch.testing.assert_close(before[0, :4], wanted, rtol=0.1, atol=0.01)
    assert 0.03 < 0.05 * before[0, 4] < 0.06


def test_the_class_depends_on_what_the_mask_covers_and_no_gradient_reaches_the_mask():
    torch.manual_seed(0)
    head = MaskClassHead(NETWORKS["tiny"])
    torch.nn.init.normal_(head.end[1].weight)
    widths = token_widths(NETWORKS["tiny"])
    none, rows = torch.zeros(6, 3), torch.arange(6)
    voxels, seeds = torch.rand(6, 3), torch.rand(1, 3)
    levels = tuple(Tokens(voxels, torch.randn(6, width), 0.003, rows, none) for width in widths)
    scene = scene_of(voxels, seeds, described=head.describe(levels), looked_at=head.look_at(levels))
    queries = torch.randn(1, 8)
    masks = torch.tensor([[9.0, 9.0, 9.0, -9.0, -9.0, -9.0]]).T.requires_grad_()
    first, second = head(queries, masks, scene), head(queries, -masks, scene)
    assert (first - second).abs().max() > 1e-3
    assert not torch.autograd.grad(first.sum(), masks, allow_unused=True)[0]


def test_seeded_mask_is_a_ball_around_the_seed_that_the_query_moves_and_sizes():
    seed = torch.tensor([[0.1, 0.1, 0.1]])
    offsets = torch.tensor([0.0, 0.03 * 2**0.5, 0.10])
    positions = seed + torch.stack([offsets, torch.zeros(3), torch.zeros(3)], 1)
    scene = scene_of(positions, seed)
    logits = ball_logits(torch.zeros(1, 4), scene)[:, 0]
    torch.testing.assert_close(logits[:2], torch.tensor([1.0, 0.0]), atol=1e-5, rtol=0)
    assert logits[2] < -4
    moved = ball_logits(torch.tensor([[2.0, 0, 0, 0]]), scene)[:, 0]
    torch.testing.assert_close(moved[2], torch.tensor(1.0), atol=1e-5, rtol=0)
    larger = ball_logits(torch.tensor([[0.0, 0, 0, 1]]), scene)[:, 0]
    assert (larger[1:] > logits[1:]).all()


def test_a_mask_may_follow_the_votes_of_voxels_that_lie_together():
    head, positions = SeededMaskHead(NETWORKS["tiny"]), torch.tensor([[0.1, 0.1, 0.1], [0.11, 0.1, 0.1]])
    votes = torch.tensor([[0.1, 0.1, 0.07], [0.11, 0.1, 0.14]])
    scene = scene_of(positions, positions[:1])
    scene = replace(scene, votes=position_moments(votes, scene.middle)[:, :BALL_MOMENTS])
    queries = torch.randn(1, 8)
    before = head(queries, scene)[:, 0]
    head.vote_ball.bias.data = torch.tensor([0.0, 0.0, -0.6, -1.0, 3.0])  # around what is 3 cm below, strong
    added = head(queries, scene)[:, 0] - before
    assert float(added[0]) == pytest.approx(0.0, abs=1e-3)
    assert added[1] < -30


def test_votes_begin_where_the_voxels_are():
    votes = Votes(NETWORKS["tiny"])
    width = votes.offset[0].in_features
    tokens = Tokens(torch.rand(5, 3), torch.randn(5, width), 0.003, torch.arange(5), torch.zeros(5, 3))
    torch.testing.assert_close(votes(tokens), tokens.positions)


def test_rows_are_spread_over_those_inside():
    inside = torch.zeros(100, 3, dtype=torch.bool)
    inside[20:60, 0] = True
    inside[[3, 97], 1] = True
    rows = spread_rows(inside, torch.tensor([0, 0, 42]), 10)
    assert rows[0].tolist() == list(range(22, 60, 4))
    assert rows[1].tolist() == [3] * 5 + [97] * 5
    assert rows[2].tolist() == [42] * 10


def test_attention_adds_the_place_of_a_token_for_the_query_to_its_key():
    torch.manual_seed(0)
    attention, far = Attention(8, 2), nothing_far(3, 5)
    points, seeds = torch.rand(5, 3) * 0.3, torch.rand(3, 3) * 0.3
    queries, tokens, own = torch.randn(3, 8), torch.randn(5, 8), torch.randn(3, 8)
    answers = attention(queries, own, tokens, places_of(points, seeds), far, GROUPS)
    encoded = ENCODING(points, seeds[:, None], scene_bounds(points, TINY))
    for row in range(3):
        asked = attention.to_queries(queries[row] + own[row]).view(2, 4)
        keys, values = (attention.to_keys(tokens + encoded[row]), attention.to_values(tokens))
        shares = (torch.einsum("hd,thd->ht", asked, keys.view(5, 2, 4)) / 2.0).softmax(1)
        attended = torch.einsum("ht,thd->hd", shares, values.view(5, 2, 4)).flatten()
        wanted = attention.norm(queries[row] + attention.end(attended))
        torch.testing.assert_close(answers[row], wanted, rtol=0, atol=1e-4)


def test_seeded_masks_read_the_place_of_a_voxel_for_the_query_and_end_at_its_reach():
    torch.manual_seed(0)
    head = SeededMaskHead(TINY)
    torch.nn.init.normal_(head.ball.weight)
    voxels, seeds, queries = torch.rand(20, 3) * 0.3, torch.rand(4, 3) * 0.3, torch.randn(4, 8)
    scene = scene_of(voxels, seeds, features=torch.randn(20, 8), far=torch.rand(4, 20) < 0.3)
    logits = head(queries, scene)
    encoded = ENCODING(voxels, seeds[:, None], scene_bounds(voxels, TINY))
    normed = head.norm(queries)
    ball = ball_logits(head.ball(normed), scene)
    wanted = torch.einsum("qc,qvc->vq", head.embed(normed), scene.features + head.place(encoded)) + ball
    torch.testing.assert_close(logits, wanted.masked_fill(scene.far.t(), -20.0), rtol=0, atol=1e-3)
    assert (logits[scene.far.t()] == -20.0).all()


def test_queries_are_seeded_on_voxels_one_every_few_centimetres_of_surface():
    torch.manual_seed(0)
    voxels = torch.rand(600, 3) * torch.tensor([0.3, 0.2, 0.02])
    count = 200
    coarse = Tokens(voxels[:count], torch.rand(count, 8), 0.006, torch.arange(600) % count, torch.zeros(count, 3))
    fine = Tokens(voxels, torch.rand(600, 8), 0.003, torch.arange(600), torch.zeros(600, 3))
    by_area, fixed = QueryRefinement(TINY), QueryRefinement(replace(TINY, any_extent=False))
    rows = by_area.seed_rows((coarse, coarse, coarse, fine))
    assert len(rows) > 20
    assert torch.cdist(voxels[rows], voxels[rows]).fill_diagonal_(1.0).min() > TINY.seed_spacing
    assert torch.cdist(coarse.positions, voxels[rows]).amin(1).max() <= TINY.seed_spacing
    assert len(fixed.seed_rows((coarse, coarse, coarse, fine))) == TINY.queries


def test_how_queries_are_grouped_makes_no_difference():
    torch.manual_seed(0)
    attention, far = Attention(8, 2), torch.rand(3, 5) < 0.4
    far[:, 0] = False
    queries, own, tokens = torch.randn(3, 8), torch.randn(3, 8), torch.randn(5, 8)
    places = places_of(torch.rand(5, 3), torch.rand(3, 3))
    together = attention(queries, own, tokens, places, far, (torch.arange(3),))
    torch.testing.assert_close(attention(queries, own, tokens, places, far, GROUPS), together)


def test_tiles_hold_every_row_once_and_are_no_larger_than_asked():
    points = torch.rand(100, 3, generator=torch.Generator().manual_seed(0)) - 0.5
    found = tiles(points, 0.15)
    assert sorted(torch.cat(found).tolist()) == list(range(100))
    assert all((points[rows, :2].amax(0) - points[rows, :2].amin(0) < 0.15).all() for rows in found)
    assert 20 < len(found) < 50
