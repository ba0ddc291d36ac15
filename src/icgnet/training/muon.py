"""Muon: steps of matrices in which every direction counts the same, and Adam for all the rest.

Published in Jordan et al., "Muon: An optimizer for hidden layers in neural networks", 2024. `torch.optim.Muon` takes
matrices alone; here convolution kernels are matrices too, from what they read to what they give, and matrices of one
size are treated together, which saves most of the time of a small network's step.

Differs from the paper, which trains with AdamW: see docs/decisions/0011-muon.md.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor, nn

COEFFICIENTS = (3.4445, -4.7750, 2.0315)
"""Of the Newton-Schulz iteration: the published ones, which bring singular values near 1 in five rounds."""
ROUNDS = 5
RMS_LIKE_ADAM = 0.2
"""Root mean square of a step's entries in units of the learning rate: that of Adam, so that rates carry over."""


class Muon(torch.optim.Optimizer):
    """Muon for the matrices and kernels, AdamW for vectors and what else is named, with one learning rate.

    Weights are decayed apart from the gradient, as in AdamW.
    """

    def __init__(
        self,
        matrices: Iterable[nn.Parameter],
        others: Iterable[nn.Parameter],
        learning_rate: float,
        weight_decay: float,
        momentum: float = 0.95,
        betas: tuple[float, float] = (0.9, 0.99),
    ) -> None:
        """A step of every parameter has entries of about the size `learning_rate`.

        Args:
            matrices: parameters with two or more axes; see `as_matrix`.
            others: parameters that Adam moves.
            learning_rate: of both.
            weight_decay: of both.
            momentum: of Muon, Nesterov's.
            betas: of Adam.
        """
        groups = [{"params": list(matrices), "muon": True}, {"params": list(others), "muon": False}]
        defaults = {"lr": learning_rate, "weight_decay": weight_decay, "momentum": momentum, "betas": betas}
        super().__init__(groups, defaults)

    @torch.no_grad()
    def step(self, closure: Callable[[], Any] | None = None) -> None:
        """Moves every parameter that has a gradient; `closure` is not used."""
        for group in self.param_groups:
            parameters = [parameter for parameter in group["params"] if parameter.grad is not None]
            (self._muon if group["muon"] else self._adam)(parameters, group)

    def _muon(self, parameters: list[nn.Parameter], group: dict[str, Any]) -> None:
        by_shape: dict[tuple[int, ...], list[tuple[nn.Parameter, Tensor]]] = defaultdict(list)
        for parameter in parameters:
            assert parameter.grad is not None
            state = self.state[parameter]
            if not state:
                state["momentum"] = torch.zeros_like(parameter)
            state["momentum"].lerp_(parameter.grad, 1.0 - group["momentum"])
            update = as_matrix(parameter.grad.lerp(state["momentum"], group["momentum"]))
            by_shape[tuple(update.shape)].append((parameter, update))
        for shape, members in by_shape.items():
            updates = orthogonalised(torch.stack([update for _, update in members]))
            scale = RMS_LIKE_ADAM * math.sqrt(max(shape)) * group["lr"]
            for (parameter, _), update in zip(members, updates, strict=True):
                parameter.mul_(1.0 - group["lr"] * group["weight_decay"])
                parameter.add_(update.reshape(parameter.shape), alpha=-scale)

    def _adam(self, parameters: list[nn.Parameter], group: dict[str, Any]) -> None:
        first, second = group["betas"]
        for parameter in parameters:
            assert parameter.grad is not None
            state = self.state[parameter]
            if not state:
                state |= {"mean": torch.zeros_like(parameter), "square": torch.zeros_like(parameter)}
                state["step"] = torch.zeros((), dtype=torch.int64)
            state["step"] += 1
            state["mean"].lerp_(parameter.grad, 1.0 - first)
            state["square"].lerp_(parameter.grad.square(), 1.0 - second)
            steps = int(state["step"])
            scale = (state["square"] / (1.0 - second**steps)).sqrt_().add_(1e-8)
            parameter.mul_(1.0 - group["lr"] * group["weight_decay"])
            parameter.addcdiv_(state["mean"], scale, value=-group["lr"] / (1.0 - first**steps))


def as_matrix(values: Float[Tensor, "..."]) -> Float[Tensor, "m n"]:
    """A parameter as one linear map.

    A matrix as it is; a sparse kernel `[volume, in, out]` with volume and inputs together; a dense kernel
    `[out, in, x, y, z]` with all but its outputs together.
    """
    if values.ndim == 2:
        return values
    return values.flatten(0, 1) if values.ndim == 3 else values.flatten(1)


def orthogonalised(matrices: Float[Tensor, "b m n"]) -> Float[Tensor, "b m n"]:
    """About the nearest matrices with singular values 1 (between 0.7 and 1.2), by a Newton-Schulz iteration.

    All rounds are polynomials of the same small square `x @ x^T`, so they are done there, and `x` is multiplied once.
    """
    tall = matrices.shape[1] > matrices.shape[2]
    x = matrices.transpose(1, 2) if tall else matrices
    x = x / x.flatten(1).norm(dim=1).clamp(min=1e-7)[:, None, None]
    square = x @ x.transpose(1, 2)
    one = torch.eye(len(square[0]), dtype=x.dtype, device=x.device)
    first, second, third = COEFFICIENTS
    total = one
    for _ in range(ROUNDS):
        factor = first * one + second * square + third * square @ square
        square, total = factor @ square @ factor, factor @ total
    x = total @ x
    return x.transpose(1, 2) if tall else x
