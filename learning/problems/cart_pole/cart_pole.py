"""The cart-pole swing-up of Doya (2000, section 4.2), as torch functions: a problem described in one page.

A pole hangs on a cart on a track; the cart is pushed and the pole must stand upright with the cart near the middle. The
equations are those of Barto, Sutton and Anderson (1983) without the frictions, with theta = 0 upright and, as drift and
control matrix want it, sorted by the force u:

    theta'' = ((M + m) g sin theta - m l theta'^2 sin theta cos theta - u cos theta) / (l (4/3 (M + m) - m cos^2 theta))
    x''     = (u + m l (theta'^2 sin theta - theta'' cos theta)) / (M + m)

with l half the length of the pole.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.differentiable import TorchProblem
from swimmer_mj.learning.problems.settings import require_not_negative, require_positive

__all__ = ["CartPole"]

TRACK = 2.4
"""Half the length of the track on which the reward is felt, m."""


@dataclass(frozen=True)
class CartPole(TorchProblem):
    """Swing up the pole and hold it. State (x, x', theta, theta') in m, m/s, rad, rad/s; control: force, N.

    The reward rate is cos(theta) - (x / 2.4 m)^2: upright and in the middle it is 1.
    """

    cart_mass: float = 1.0
    pole_mass: float = 0.1
    half_length: float = 0.5
    gravity: float = 9.8
    force_limit: float = 5.0
    s_gamma: float = 1.0

    name = "cart-pole"

    def __post_init__(self) -> None:
        require_positive(self, "cart_mass", "pole_mass", "half_length", "force_limit")
        require_not_negative(self, "gravity")
        super().__post_init__()

    @property
    def limits(self) -> tuple[float]:
        """U, N."""
        return (self.force_limit,)

    def _denominator(self, c: Tensor) -> Tensor:
        return self.half_length * (4.0 / 3.0 * (self.cart_mass + self.pole_mass) - self.pole_mass * c**2)

    def drift(self, x: Tensor) -> Tensor:
        """a(x)."""
        M, m, l, g = self.cart_mass, self.pole_mass, self.half_length, self.gravity
        speed, theta, theta_dot = x[..., 1], x[..., 2], x[..., 3]
        s, c = torch.sin(theta), torch.cos(theta)
        theta_ddot = ((M + m) * g * s - m * l * theta_dot**2 * s * c) / self._denominator(c)
        acceleration = m * l * (theta_dot**2 * s - theta_ddot * c) / (M + m)
        return torch.stack([speed, acceleration, theta_dot, theta_ddot], dim=-1)

    def control_matrix(self, x: Tensor) -> Tensor:
        """B(x)."""
        M, m, l = self.cart_mass, self.pole_mass, self.half_length
        c = torch.cos(x[..., 2])
        theta_ddot = -c / self._denominator(c)
        acceleration = (1.0 - m * l * theta_ddot * c) / (M + m)
        zero = torch.zeros_like(c)
        return torch.stack([zero, acceleration, zero, theta_ddot], dim=-1)[..., None]

    def reward_rate(self, x: Tensor) -> Tensor:
        """r(x)."""
        return torch.cos(x[..., 2]) - (x[..., 0] / TRACK) ** 2

    def draw(self, rng: np.random.Generator, count: int) -> NDArray[np.float64]:
        """Anywhere near the middle, all angles; (count, 4)."""
        return rng.uniform([-1.0, -1.0, -math.pi, -2.0], [1.0, 1.0, math.pi, 2.0], (count, 4))

    def encode(self, x: Tensor) -> Tensor:
        """Position, speed, cos and sin of the angle, angular velocity; of order one."""
        position, speed, theta, theta_dot = x.unbind(-1)
        return torch.stack(
            [position, 0.5 * speed, torch.cos(theta), torch.sin(theta), 0.2 * theta_dot], dim=-1
        )
