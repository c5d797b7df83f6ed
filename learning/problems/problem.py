"""What a learner has to know of a task: section 2.1 as an interface.

A control problem has states x in R^p, controls u with |u_i| <= U_i, dynamics that are affine in the control,
dx/dt = a(x) + B(x) u, a reward rate r(x), a shortness factor s_gamma and a law of initial states. Any object with
these attributes is one; nothing is inherited. A problem that a run is to keep in its config.json is a frozen dataclass
whose fields are its settings.

Beside these functions, in NumPy, a problem may offer other forms of itself: :mod:`swimmer_mj.learning.problems.forms`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.integrators import euler_step, rk4_step

__all__ = [
    "DT",
    "EPISODE_DURATION",
    "N_EPISODES",
    "SETTLING_TIME",
    "ControlProblem",
    "as_states",
    "discount_shares",
    "episode_shares",
    "episode_steps",
    "episode_sums",
    "is_by_euler",
    "require_euler",
    "step_by_euler",
]

Array = NDArray[np.float64]
Form = TypeVar("Form")

DT = 0.01
"""For how long a control is held in an evaluation, s."""
N_EPISODES = 64
"""Episodes in an evaluation."""
EPISODE_DURATION = 20.0
"""Length of each, s."""
SETTLING_TIME = 10.0
"""How much of each is left out, s: the start from a random state is not what was learned to be kept up."""


class ControlProblem(Protocol):
    """A task in continuous time and space. Functions of x accept leading batch axes.

    A problem may also have ``caution()``: one line that says why to learn it with care, or None. A learner warns with
    it when it is made (:mod:`~swimmer_mj.learning.problems.caution`).
    """

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

    def form(self, kind: type[Form]) -> Form | None:
        """The problem in another form, one of :mod:`swimmer_mj.learning.problems.forms`; None if it has no such form.

        What is offered has to be this problem: a subclass with equations or a reward of its own must not hand on the
        forms of its base class.
        """
        ...


def as_states(states: Array, p: int) -> Array:
    """``states`` as compiled code reads them: (count, p), float64, contiguous."""
    states = np.ascontiguousarray(states, dtype=np.float64)
    if states.ndim != 2 or states.shape[1] != p:
        raise ValueError(f"states must have shape (count, {p}), got {states.shape}")
    return states


def episode_steps(duration: float, skip: float, dt: float) -> tuple[int, int]:
    """Steps of ``dt`` in an episode of ``duration`` seconds, and in its first ``skip`` seconds, which do not count."""
    n_steps, n_skip = round(duration / dt), round(skip / dt)
    if not 0 <= skip < duration or n_skip >= n_steps:
        raise ValueError(
            f"skip must be in [0, duration), by a step of {dt} at least; got skip {skip} and duration {duration}"
        )
    return n_steps, n_skip


def episode_shares(duration: float, skip: float, dt: float) -> Array:
    """What the reward rate at each step of an episode counts in its mean after the first ``skip`` seconds; (steps,)."""
    n_steps, n_skip = episode_steps(duration, skip, dt)
    counts = np.arange(n_steps) >= n_skip
    return counts / counts.sum()


def discount_shares(s_gamma: float, duration: float, dt: float) -> Array:
    """What the reward rate at each step of an episode counts in equation 1, up to ``duration`` seconds; (steps,)."""
    n_steps, _ = episode_steps(duration, 0.0, dt)
    return np.exp(-s_gamma * dt * np.arange(n_steps)) * dt


def episode_sums(
    problem: ControlProblem,
    policy: Callable[[Array], Array],
    states: Array,
    shares: Array,
    dt: float,
    cost: Callable[[Array], Array] | None = None,
) -> Array:
    """Sums (N,) of the reward rates times ``shares`` (steps,) over episodes under any policy.

    They start at ``states`` (N, p), by RK4 with the control, (N, q), held for ``dt``. With ``cost`` c of x, (N, q), the
    rate is r - sum_i c_i u_i^2.
    """
    x = as_states(states, problem.state_size)
    total = np.zeros(len(x))
    for share in shares:
        u = policy(x)

        def f(y: Array, u: Array = u) -> Array:
            a, B = problem.drift_and_control_matrix(y)
            return a + np.einsum("...pq,...q->...p", B, u)

        r = problem.reward(x)
        total += share * (r if cost is None else r - (cost(x) * u**2).sum(axis=-1))
        x = rk4_step(f, x, dt)
    return total


def require_euler(problem: ControlProblem) -> None:
    """Refuse a problem that is stepped by another method than its learner would use."""
    if not is_by_euler(problem):
        integrator: Any = getattr(problem, "integrator", None)
        raise ValueError(
            f"this learner integrates by Euler's method, got integrator {integrator!r}; "
            "use SteppedTD, which is method td with engine 'stepped'"
        )


def is_by_euler(problem: ControlProblem) -> bool:
    """Whether ``problem`` is stepped by Euler's method, as it is if it does not say otherwise."""
    return getattr(problem, "integrator", "euler") == "euler"


def step_by_euler(problem: ControlProblem, x: Array, u: Array, dt: float) -> Array:
    """x(t + dt) = x + dt (a(x) + B(x) u), shape (..., p), with u (..., q) held: the integrator of section 4."""

    def f(y: Array) -> Array:
        a, B = problem.drift_and_control_matrix(y)
        return a + (B @ u[..., None])[..., 0]

    return euler_step(f, x, dt)
