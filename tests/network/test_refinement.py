import torch

from icgnet.geometry.workspace import TABLE_HEIGHT
from icgnet.network.config import NETWORKS
from icgnet.network.layers import Attention
from icgnet.network.refinement import (
    AffordanceRefinement,
    MaskClassHead,
    MaskScene,
    attention_blocks,
    ball_logits,
    extents,
    position_moments,
    spread_rows,
)
from icgnet.network.tokens import Tokens, token_widths


def tokens_of(of_voxel: list[int]) -> Tokens:
    count = max(of_voxel) + 1
    features, none = torch.rand(count, 4), torch.zeros(count, 3)
    return Tokens(torch.rand(count, 3), features, 0.006, torch.tensor(of_voxel), none)


def test_tokens_outside_a_query_s_pooled_mask_are_blocked():
    mask_logits = torch.tensor([[3.0, -1.0], [1.0, -1.0], [-5.0, 2.0], [1.0, -2.0]])
    blocked = attention_blocks(mask_logits, tokens_of([0, 0, 1, 1]), 0.5)
    assert blocked.tolist() == [[False, True], [True, False]]  # mean logits 2, -2 and -1, 0


def test_a_query_that_covers_nothing_attends_to_everything():
    blocked = attention_blocks(torch.full((4, 1), -9.0), tokens_of([0, 1, 2, 3]), 0.5)
    assert not blocked.any()


def test_blocked_tokens_have_no_influence():
    torch.manual_seed(0)
    attention = Attention(8, 2)
    queries, tokens, zeros = torch.randn(3, 8), torch.randn(5, 8), torch.zeros(5, 8)
    blocked = torch.zeros(3, 5, dtype=torch.bool)
    blocked[0, 3:] = True
    changed = tokens.clone()
    changed[3:] += 1.0
    before = attention(queries, zeros[:3], tokens, zeros, blocked)
    after = attention(queries, zeros[:3], changed, zeros, blocked)
    torch.testing.assert_close(before[0], after[0])
    assert (before[1:] - after[1:]).abs().max() > 1e-3


def test_affordance_queries_do_not_attend_to_queries_without_an_object():
    torch.manual_seed(0)
    refinement = AffordanceRefinement(NETWORKS["tiny"])
    queries, positions = torch.randn(4, 8), torch.randn(4, 8)
    class_logits = torch.zeros(4, 8)
    class_logits[:, 0] = 1.0
    class_logits[3, -1] = 5.0
    changed = queries.clone()
    changed[3] = torch.randn(8)
    before, after = refinement(queries, positions, class_logits), refinement(changed, positions, class_logits)
    torch.testing.assert_close(before[:3], after[:3])
    assert (before[3] - after[3]).abs().max() > 1e-3


def test_affordance_queries_are_finite_when_no_query_has_an_object():
    class_logits = torch.zeros(4, 8)
    class_logits[:, -1] = 1.0
    result = AffordanceRefinement(NETWORKS["tiny"])(torch.randn(4, 8), torch.randn(4, 8), class_logits)
    assert torch.isfinite(result).all()


def test_extents_do_not_change_when_the_object_turns_or_moves_on_the_table():
    torch.manual_seed(0)
    points = torch.rand(200, 3) * torch.tensor([0.10, 0.03, 0.06]) + torch.tensor([0.0, 0.0, TABLE_HEIGHT])
    turn = torch.tensor([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    shares = torch.full((1, 200), 1 / 200)
    moved = points @ turn.T + torch.tensor([0.1, 0.05, 0.0])
    before, after = (extents(shares @ position_moments(each)) for each in (points, moved))
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
    levels = tuple(Tokens(torch.rand(6, 3), torch.randn(6, width), 0.003, rows, none) for width in widths)
    scene = MaskScene(none, position_moments(levels[-1].positions), none, head.describe(levels), head.look_at(levels))
    queries = torch.randn(1, 8)
    masks = torch.tensor([[9.0, 9.0, 9.0, -9.0, -9.0, -9.0]]).T.requires_grad_()
    first, second = head(queries, masks, scene), head(queries, -masks, scene)
    assert (first - second).abs().max() > 1e-3
    assert not torch.autograd.grad(first.sum(), masks, allow_unused=True)[0]


def test_seeded_mask_is_a_ball_around_the_seed_that_the_query_moves_and_sizes():
    seed = torch.tensor([[0.1, 0.1, 0.1]])
    offsets = torch.tensor([0.0, 0.03 * 2**0.5, 0.10])
    positions = seed + torch.stack([offsets, torch.zeros(3), torch.zeros(3)], 1)
    scene = MaskScene(torch.zeros(3, 4), position_moments(positions), seed, *[torch.zeros(3, 0)] * 2)
    logits = ball_logits(torch.zeros(1, 4), scene)[:, 0]
    torch.testing.assert_close(logits[:2], torch.tensor([1.0, 0.0]), atol=1e-5, rtol=0)
    assert logits[2] < -4
    moved = ball_logits(torch.tensor([[2.0, 0, 0, 0]]), scene)[:, 0]
    torch.testing.assert_close(moved[2], torch.tensor(1.0), atol=1e-5, rtol=0)
    larger = ball_logits(torch.tensor([[0.0, 0, 0, 1]]), scene)[:, 0]
    assert (larger[1:] > logits[1:]).all()


def test_rows_are_spread_over_those_inside():
    inside = torch.zeros(100, 3, dtype=torch.bool)
    inside[20:60, 0] = True
    inside[[3, 97], 1] = True
    rows = spread_rows(inside, torch.tensor([0, 0, 42]), 10)
    assert rows[0].tolist() == list(range(22, 60, 4))
    assert rows[1].tolist() == [3] * 5 + [97] * 5
    assert rows[2].tolist() == [42] * 10
