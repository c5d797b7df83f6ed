"""The pendulum swing-up of Doya (2000, section 4.1): the smallest task on which the learner must succeed.

theta = 0 is upright. m l^2 theta'' = -mu theta' + m g l sin(theta) + u with m = l = 1, g = 9.8, mu = 0.01 and |u| <= 5,
which is half of what lifting it straight up takes; r = cos(theta). doi:10.1162/089976600300015961
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.learning.problems.forms import CompiledForm, TorchForm
from swimmer_mj.learning.problems.problem import step_by_euler
from swimmer_mj.learning.problems.settings import require_not_negative, require_positive

__all__ = ["RATE_SCALE", "Constants", "Pendulum"]

Array = NDArray[np.float64]
Form = TypeVar("Form")

RATE_SCALE = 0.2
"""theta' is scaled by this as a network input, so that it is of order one (chosen)."""


class Constants(NamedTuple):
    """Of the equations: kg·m², N·m, N·m·s."""

    inertia: float
    weight_moment: float
    damping: float


@dataclass(frozen=True)
class Pendulum:
    """A rod that a weak motor must swing up and hold. State x = (theta, theta'), control u (1,), N·m."""

    mass: float = 1.0
    length: float = 1.0
    gravity: float = 9.8
    damping: float = 0.01
    torque_limit: float = 5.0
    s_gamma: float = 1.0

    def __post_init__(self) -> None:
        require_positive(self, "mass", "length", "torque_limit", "s_gamma")
        require_not_negative(self, "gravity", "damping")

    name = "pendulum"
    state_size = 2
    n_inputs = 3

    @property
    def control_limits(self) -> Array:
        """U, shape (1,), N·m."""
        return np.array([self.torque_limit])

    @property
    def constants(self) -> Constants:
        """What the equations need."""
        m, l, g = self.mass, self.length, self.gravity
        return Constants(m * l**2, m * g * l, self.damping)

    def drift_and_control_matrix(self, x: Array) -> tuple[Array, Array]:
        """a(x), shape (..., 2), and B(x), shape (..., 2, 1)."""
        constants = self.constants
        theta, theta_dot = x[..., 0], x[..., 1]
        moment = constants.weight_moment * np.sin(theta) - constants.damping * theta_dot
        a = np.stack([theta_dot, moment / constants.inertia], axis=-1)
        B = np.broadcast_to(np.array([[0.0], [1.0 / constants.inertia]]), (*x.shape, 1))
        return a, B

    def reward(self, x: Array) -> Array:
        """cos(theta), the height of the tip."""
        return np.cos(x[..., 0])

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """x(t + dt) by Euler's method, u held."""
        return step_by_euler(self, x, u, dt)

    def initial_states(self, rng: np.random.Generator, count: int) -> Array:
        """Angles all around, angular velocities in [-5, 5] rad/s; shape (count, 2)."""
        return rng.uniform([-np.pi, -5.0], [np.pi, 5.0], (count, 2))

    def inputs(self, x: torch.Tensor) -> torch.Tensor:
        """cos(theta), sin(theta), theta' scaled; shape (..., 3)."""
        theta, theta_dot = x[..., 0], x[..., 1]
        return torch.stack([torch.cos(theta), torch.sin(theta), RATE_SCALE * theta_dot], dim=-1)

    def form(self, kind: type[Form]) -> Form | None:
        """The pendulum in another form; of a subclass, which may have equations or a reward of its own, none."""
        if type(self) is not Pendulum:
            return None
        from swimmer_mj.learning.problems.pendulum import scalar, torch_form

        make = {TorchForm: torch_form.make, CompiledForm: scalar.make}.get(kind)
        return None if make is None else make(self)  # pyright: ignore[reportReturnType] - of the kind asked for
