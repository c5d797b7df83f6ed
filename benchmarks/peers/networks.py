"""Policies and values of the peers: layers of tanh or ELU units on the inputs that this project's networks have."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Literal

import torch
from torch import Tensor, nn

from swimmer_mj.learning.problems.swim import Swimming

Unit = Literal["tanh", "elu"]
UNITS: dict[Unit, type[nn.Module]] = {"tanh": nn.Tanh, "elu": nn.ELU}


def layers(sizes: Sequence[int], unit: Unit, last_scale: float) -> nn.Sequential:
    """Fully connected, float32; the weights of the last are ``last_scale`` times torch's."""
    modules: list[nn.Module] = []
    for a, b in pairwise(sizes):
        modules += [nn.Linear(a, b), UNITS[unit]()]
    last = modules[-2]
    assert isinstance(last, nn.Linear)
    with torch.no_grad():
        last.weight.mul_(last_scale)
        last.bias.zero_()
    return nn.Sequential(*modules[:-1])


class TanhPolicy(nn.Module):
    """u = U tanh(mean(z) + spread noise), as SHAC has it."""

    def __init__(self, problem: Swimming, hidden: Sequence[int], unit: Unit, log_spread: float) -> None:
        super().__init__()
        self.problem = problem
        q = len(problem.control_limits)
        self.mean = layers((problem.n_inputs, *hidden, q), unit, 0.1)
        self.log_spread = nn.Parameter(torch.full((q,), log_spread))
        self.limits = torch.from_numpy(problem.control_limits.copy())

    def forward(self, x: Tensor, generator: torch.Generator | None = None) -> Tensor:
        """Torques (q, N), float64, at states (p, N); with noise where a generator is given."""
        activation = self.mean(self.problem.inputs(x.T).float())
        if generator is not None:
            noise = torch.randn(activation.shape, generator=generator)
            activation = activation + self.log_spread.exp() * noise
        return (self.limits * torch.tanh(activation).double()).T.contiguous()


class Value(nn.Module):
    """V(z), float32."""

    def __init__(self, problem: Swimming, hidden: Sequence[int], unit: Unit) -> None:
        super().__init__()
        self.problem = problem
        self.of_inputs = layers((problem.n_inputs, *hidden, 1), unit, 1.0)

    def forward(self, x: Tensor) -> Tensor:
        """V (N,) at states (p, N)."""
        return self.of_inputs(self.problem.inputs(x.T).float())[:, 0]
