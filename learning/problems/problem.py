"""What a learner has to know of a task: section 2.1 as an interface.

A control problem has states x in R^p, controls u with |u_i| <= U_i, dynamics that are affine in the control,
dx/dt = a(x) + B(x) u, a reward rate r(x), a shortness factor s_gamma and a law of initial states. Any object with
these attributes is one; nothing is inherited.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.integrators import euler_step

__all__ = ["CompiledProblem", "ControlProblem", "episode_steps", "require_euler", "step_by_euler"]

Array = NDArray[np.float64]


class CompiledProblem(NamedTuple):
    """The same problem as numba functions, for the fused kernel.

    They write into the arrays that they are given and allocate nothing. ``z`` and ``dVdz`` have the learner's dtype,
    everything else is float64.
    """

    constants: Any
    """First argument of ``dynamics`` and ``reward``: whatever numba can take."""
    dynamics: Callable[..., None]
    """(constants, x, a, B): fill the drift a (p,) and the control matrix B (p, q), which starts as zeros."""
    reward: Callable[..., float]
    """(constants, x): r(x)."""
    inputs: Callable[..., None]
    """(x, z): fill the network's inputs z (m,)."""
    input_pullback: Callable[..., None]
    """(z, dVdz, dVdx): fill dVdx (p,) with (dz/dx)^T dVdz, given the inputs z at x."""


class ControlProblem(Protocol):
    """A task in continuous time and space. Functions of x accept leading batch axes."""

    @property
    def name(self) -> str:
        """What to call it in a table."""
        ...

    @property
    def state_size(self) -> int:
        """p."""
        ...

    @property
    def n_inputs(self) -> int:
        """m, the number of network inputs that encode a state."""
        ...

    @property
    def control_limits(self) -> Array:
        """U, shape (q,)."""
        ...

    @property
    def s_gamma(self) -> float:
        """Shortness factor, 1/s: a reward t seconds ahead counts exp(-s_gamma t)."""
        ...

    def drift_and_control_matrix(self, x: Array) -> tuple[Array, Array]:
        """a(x), shape (..., p), and B(x), shape (..., p, q)."""
        ...

    def reward(self, x: Array) -> Array:
        """r(x), shape (...)."""
        ...

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """x(t + dt) with u held."""
        ...

    def initial_states(self, rng: np.random.Generator, count: int) -> Array:
        """``count`` draws from the law of initial states, shape (count, p)."""
        ...

    def inputs(self, x: torch.Tensor) -> torch.Tensor:
        """The network's inputs, shape (..., m), differentiable in x and of its dtype."""
        ...

    def compile(self) -> CompiledProblem | None:
        """The problem for the fused kernel; None where only the torch reference can learn it."""
        ...


def episode_steps(duration: float, skip: float, dt: float) -> tuple[int, int]:
    """Steps of ``dt`` in an episode of ``duration`` seconds, and in its first ``skip`` seconds, which do not count."""
    n_steps, n_skip = round(duration / dt), round(skip / dt)
    if not 0 <= skip < duration or n_skip >= n_steps:
        raise ValueError(
            f"skip must be in [0, duration), by a step of {dt} at least; got skip {skip} and duration {duration}"
        )
    return n_steps, n_skip


def require_euler(problem: ControlProblem) -> None:
    """Refuse a problem that is stepped by another method than its learner would use."""
    integrator = getattr(problem, "integrator", "euler")
    if integrator != "euler":
        raise ValueError(
            f"this learner integrates by Euler's method, got integrator {integrator!r}; use ContinuousTD"
        )


def step_by_euler(problem: ControlProblem, x: Array, u: Array, dt: float) -> Array:
    """x(t + dt) = x + dt (a(x) + B(x) u), shape (..., p), with u (..., q) held: the integrator of section 4."""

    def f(y: Array) -> Array:
        a, B = problem.drift_and_control_matrix(y)
        return a + (B @ u[..., None])[..., 0]

    return euler_step(f, x, dt)
