"""The pendulum as torch functions."""

from __future__ import annotations

import torch
from torch import Tensor

from swimmer_mj.learning.problems.forms import TorchForm
from swimmer_mj.learning.problems.pendulum.pendulum import Pendulum

__all__ = ["make"]


def make(problem: Pendulum) -> TorchForm | None:
    """a, B and r."""
    inertia, weight_moment, damping = problem.constants

    def drift(x: Tensor) -> Tensor:
        theta, theta_dot = x[..., 0], x[..., 1]
        moment = weight_moment * torch.sin(theta) - damping * theta_dot
        return torch.stack([theta_dot, moment / inertia], dim=-1)

    def control_matrix(x: Tensor) -> Tensor:
        return x.new_tensor([[0.0], [1.0 / inertia]]).expand(*x.shape, 1)

    return TorchForm(drift, control_matrix, lambda x: torch.cos(x[..., 0]))
