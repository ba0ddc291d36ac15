import copy

import pytest
import torch
from torch import nn

from icgnet.network.config import NETWORKS
from icgnet.network.icgnet import IcgNet
from icgnet.training.config import TRAININGS
from icgnet.training.loop import make_optimizer
from icgnet.training.muon import Muon, as_matrix, orthogonalised

RATE, DECAY = 1e-2, 0.1


def descend(optimizer, parameters, steps=4):
    torch.manual_seed(1)
    for _ in range(steps):
        for parameter in parameters:
            parameter.grad = torch.randn_like(parameter)
        optimizer.step()


def twins(*shapes):
    torch.manual_seed(0)
    first = [nn.Parameter(torch.randn(shape)) for shape in shapes]
    return first, copy.deepcopy(first)


@pytest.mark.parametrize("shape", [(3, 40, 40), (1, 200, 16), (2, 16, 200), (1, 1, 30)])
def test_singular_values_become_about_one(shape):
    torch.manual_seed(0)
    # Directions of a Gaussian square matrix that are a hundred times weaker than others are not all brought up.
    values = torch.linalg.svdvals(orthogonalised(torch.randn(shape)))
    assert values.max() < 1.3
    assert values.median() > 0.65


def test_the_product_with_rotations_commutes():
    torch.manual_seed(0)
    matrix, turn = torch.randn(1, 6, 9), torch.linalg.qr(torch.randn(6, 6))[0]
    torch.testing.assert_close(orthogonalised(turn @ matrix), turn @ orthogonalised(matrix), atol=1e-4, rtol=1e-4)


def test_matrices_move_as_with_the_muon_of_torch():
    ours, theirs = twins((24, 40), (24, 40), (60, 8))
    descend(Muon(ours, [], RATE, DECAY), ours)
    reference = torch.optim.Muon(theirs, RATE, DECAY, momentum=0.95, nesterov=True, adjust_lr_fn="match_rms_adamw")
    before = copy.deepcopy(theirs)
    descend(reference, theirs)
    for mine, other, start in zip(ours, theirs, before, strict=True):
        # torch iterates in 16 bits.
        torch.testing.assert_close(mine - start, other - start, atol=0.03 * float((other - start).abs().max()), rtol=0)


def test_vectors_move_as_with_adamw():
    ours, theirs = twins((7,), (3,))
    descend(Muon([], ours, RATE, DECAY), ours)
    descend(torch.optim.AdamW(theirs, RATE, betas=(0.9, 0.99), weight_decay=DECAY), theirs)
    for mine, other in zip(ours, theirs, strict=True):
        torch.testing.assert_close(mine, other)


def test_a_kernel_is_the_map_from_what_it_reads_to_what_it_gives():
    sparse, dense = torch.randn(27, 4, 6), torch.randn(6, 4, 3, 3, 3)
    assert as_matrix(sparse).shape == (108, 6)
    assert as_matrix(dense).shape == (6, 108)
    assert torch.equal(as_matrix(sparse)[5 * 4 + 2], sparse[5, 2])


def test_a_step_is_about_as_large_as_one_of_adam():
    parameter = nn.Parameter(torch.zeros(27, 16, 32))
    optimizer = Muon([parameter], [], RATE, 0.0)
    descend(optimizer, [parameter], steps=1)
    assert 0.1 * RATE < float(parameter.detach().square().mean().sqrt()) < 0.3 * RATE


def test_every_parameter_is_moved_once_and_the_learnt_content_row_by_row():
    network = IcgNet(NETWORKS["tiny"])
    optimizer = make_optimizer(network, TRAININGS["tiny"])
    matrices, others = ({id(each) for each in group["params"]} for group in optimizer.param_groups)
    assert not matrices & others
    assert matrices | others == {id(each) for each in network.parameters()}
    assert id(network.refinement.content) in others
    assert isinstance(make_optimizer(network, TRAININGS["paper"]), torch.optim.AdamW)


def test_a_restored_optimizer_goes_on_as_the_one_that_was_saved():
    ours, theirs = twins((5, 8), (4,))
    first = Muon(ours[:1], ours[1:], RATE, DECAY)
    descend(first, ours)
    second = Muon(theirs[:1], theirs[1:], RATE, DECAY)
    second.load_state_dict(copy.deepcopy(first.state_dict()))
    with torch.no_grad():
        for mine, other in zip(ours, theirs, strict=True):
            other.copy_(mine)
    descend(first, ours, 2)
    descend(second, theirs, 2)
    for mine, other in zip(ours, theirs, strict=True):
        assert torch.equal(mine, other)
