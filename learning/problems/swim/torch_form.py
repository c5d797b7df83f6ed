"""The equations of :mod:`swimmer_mj.learning.problems.swim.reduced` in torch, for any number of links."""

from __future__ import annotations

import numpy as np
from torch import Tensor, cat, cos, linalg, sin, stack

from swimmer_mj.learning.problems.forms import TorchForm
from swimmer_mj.learning.problems.swim.reduced import reduced_constants
from swimmer_mj.learning.problems.swim.swimming import Swimming
from swimmer_mj.parameters import SwimmerParameters

__all__ = ["make"]


def make(problem: Swimming) -> TorchForm | None:
    """The swimmer as torch functions."""
    equations = _ReducedEquations(problem.parameters)
    velocity = 2 * problem.parameters.n_links
    return TorchForm(equations.drift, equations.control_matrix, lambda x: x[..., velocity])


class _ReducedEquations:
    def __init__(self, parameters: SwimmerParameters) -> None:
        self.n = parameters.n_links
        self.constants = reduced_constants(parameters)

    def _inertia(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """cos and sin of theta_i - theta_j, and the inertia matrix, each (N, n, n)."""
        theta = x[..., : self.n]
        difference = theta[..., :, None] - theta[..., None, :]
        cosine = cos(difference)
        return cosine, sin(difference), x.new_tensor(self.constants.K) * cosine

    def drift(self, x: Tensor) -> Tensor:
        """a(x)."""
        n, constants = self.n, self.constants
        C, K = x.new_tensor(constants.C), x.new_tensor(constants.K)
        cosine, sine, inertia = self._inertia(x)
        c, s = cos(x[..., :n]), sin(x[..., :n])
        omega, velocity = x[..., n : 2 * n], x[..., 2 * n :]
        lever = C * cosine
        normal_velocity = velocity[..., 1:] * c - velocity[..., :1] * s + (lever @ omega[..., None])[..., 0]
        F = -x.new_tensor(constants.drag) * normal_velocity
        Q = (
            (lever.mT @ F[..., None])[..., 0]
            - x.new_tensor(constants.rotational_drag) * omega
            - ((K * sine) @ (omega**2)[..., None])[..., 0]
        )
        acceleration = linalg.solve(inertia, Q)
        force = stack([-(F * s).sum(-1), (F * c).sum(-1)], dim=-1)
        return cat([omega, acceleration, force / constants.total_mass], dim=-1)

    def control_matrix(self, x: Tensor) -> Tensor:
        """B(x)."""
        n = self.n
        joints = np.arange(n - 1)
        T = np.zeros((n, n - 1))
        T[joints, joints], T[joints + 1, joints] = -1.0, 1.0
        _, _, inertia = self._inertia(x)
        acceleration = linalg.solve(inertia, x.new_tensor(T).expand(*x.shape[:-1], n, n - 1))
        zeros = x.new_zeros(*x.shape[:-1], n, n - 1)
        return cat([zeros, acceleration, zeros[..., :2, :]], dim=-2)
