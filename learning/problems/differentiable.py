"""Control problems as torch functions, so that their Jacobians come from automatic differentiation.

A problem of one's own is written in one of two ways: by functions, in a :class:`DifferentiableProblem`
(docs/own-problem.md), or as a frozen dataclass that derives from :class:`TorchProblem` (docs/extending.md), which a run
can keep in its config.json.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import ClassVar, Protocol, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.forms import EPISODE, EpisodeForm, Field, TorchForm
from swimmer_mj.learning.problems.problem import ControlProblem, step_by_euler
from swimmer_mj.learning.problems.settings import require_positive

__all__ = ["DifferentiableProblem", "TorchProblem", "require_torch", "transition", "transition_pullback"]

Array = NDArray[np.float64]
Form = TypeVar("Form")


class _Equations(Protocol):
    """What a :class:`TorchProblem` states."""

    episode: ClassVar[EpisodeForm]

    @property
    def name(self) -> str: ...
    @property
    def limits(self) -> tuple[float, ...]: ...
    @property
    def s_gamma(self) -> float: ...
    def drift(self, x: Tensor, /) -> Tensor: ...
    def control_matrix(self, x: Tensor, /) -> Tensor: ...
    def reward_rate(self, x: Tensor, /) -> Tensor: ...
    def encode(self, x: Tensor, /) -> Tensor: ...
    def draw(self, rng: np.random.Generator, count: int, /) -> Array: ...


class TorchProblem:
    """A :class:`~swimmer_mj.learning.problems.problem.ControlProblem` from equations in torch; derive from it.

    State, with N the size of a batch: ``name``; ``limits``, U, a tuple; ``s_gamma``, 1/s; the differentiable functions
    ``drift``, (N, p) -> (N, p), ``control_matrix``, (N, p) -> (N, p, q), and ``reward_rate``, (N, p) -> (N,); and
    ``draw``, the law of initial states: (generator, count) -> (count, p), from which p is read. ``encode`` gives the
    network's inputs, (N, p) -> (N, m): the state itself, unless it is overridden, for instance by cos and sin of an
    angle. V does not depend on a state variable that is left out there: its slope is 0 and is not learned. ``episode``
    says over how long what was learned is judged, and for how long a control is held there.
    """

    episode: ClassVar[EpisodeForm] = EPISODE

    def encode(self, x: Tensor, /) -> Tensor:
        """The network's inputs, (N, m)."""
        return x

    def __post_init__(self: _Equations) -> None:
        # Functions whose results have other shapes or types, or are not finite at a state that is drawn, are refused.
        require_positive(self, "s_gamma")
        if (
            not np.iterable(self.limits)
            or not [*self.limits]
            or not all(0 < U < math.inf for U in self.limits)
        ):
            raise ValueError(f"limits must be positive and finite, one per control; got {self.limits!r}")
        drawn = np.shape(self.draw(np.random.default_rng(0), 3))
        if len(drawn) != 2 or drawn[0] != 3:
            raise ValueError(f"draw must return shape (count, p), got {drawn} for a count of 3")
        p, q = drawn[1], len(self.limits)
        n = p + q + 1  # states: neither p nor q
        sample = _sample(self)
        x = sample.expand(n, p)
        for name, value, shape in (
            ("drift", self.drift(x), (n, p)),
            ("control_matrix", self.control_matrix(x), (n, p, q)),
            ("reward_rate", self.reward_rate(x), (n,)),
        ):
            if not isinstance(value, Tensor):
                raise ValueError(f"{name} must return a tensor, got {type(value).__name__}")
            if value.shape != shape:
                raise ValueError(
                    f"{name} must return shape {shape} for states ({n}, {p}), got {tuple(value.shape)}"
                )
            if name != "reward_rate":
                _require_type_of(name, value, x)
            if not bool(torch.isfinite(value).all()):
                raise ValueError(f"{name} is not finite at {sample[0].tolist()}")
        z = self.encode(x)
        if z.ndim != 2 or len(z) != n:
            raise ValueError(f"encode must return shape ({n}, m) for states ({n}, {p}), got {tuple(z.shape)}")
        for states in (x, x.float()):  # a network is asked in its own type
            _require_type_of("encode", self.encode(states), states)

    @property
    def state_size(self: _Equations) -> int:
        """p."""
        return _sample(self).shape[1]

    @property
    def n_inputs(self: _Equations) -> int:
        """m."""
        return self.encode(_sample(self)).shape[-1]

    @property
    def control_limits(self: _Equations) -> Array:
        """U, shape (q,)."""
        return np.array(self.limits, dtype=np.float64)

    def drift_and_control_matrix(self: _Equations, x: Array) -> tuple[Array, Array]:
        """a(x), shape (..., p), and B(x), shape (..., p, q)."""
        return _numpy(self.drift, x), _numpy(self.control_matrix, x)

    def reward(self: _Equations, x: Array) -> Array:
        """r(x), shape (...)."""
        return _numpy(self.reward_rate, x)

    def step(self: ControlProblem, x: Array, u: Array, dt: float) -> Array:
        """x(t + dt) by Euler's method, u held."""
        return step_by_euler(self, x, u, dt)

    def initial_states(self: _Equations, rng: np.random.Generator, count: int) -> Array:
        """``count`` draws from the law of initial states, shape (count, p)."""
        return np.asarray(self.draw(rng, count), dtype=np.float64)

    def inputs(self: _Equations, x: Tensor) -> Tensor:
        """The network's inputs, shape (..., m)."""
        z = self.encode(x.reshape(-1, x.shape[-1]))
        return z.reshape(*x.shape[:-1], z.shape[-1])

    def form(self: _Equations, kind: type[Form]) -> Form | None:
        """The equations in torch, and how they are judged; no other form."""
        if kind is TorchForm:
            return TorchForm(self.drift, self.control_matrix, self.reward_rate)  # pyright: ignore[reportReturnType]
        if kind is EpisodeForm:
            return self.episode  # pyright: ignore[reportReturnType]
        return None


def _require_type_of(name: str, value: Tensor, x: Tensor) -> None:
    """Refuse what the function ``name`` made of the states ``x`` if its numbers are of another type."""
    if value.dtype != x.dtype:
        raise ValueError(
            f"{name} must return {x.dtype} for states of {x.dtype}, got {value.dtype}; make constants by x.new_tensor"
        )


def _sample(problem: _Equations) -> Tensor:
    """One initial state, (1, p)."""
    return torch.from_numpy(np.asarray(problem.draw(np.random.default_rng(0), 1), dtype=np.float64))


def _numpy(function: Field, x: Array) -> Array:
    """``function`` of the states ``x`` (..., p), in float64."""
    x = np.asarray(x, dtype=np.float64)
    flat = torch.from_numpy(x.reshape(-1, x.shape[-1]))
    with torch.no_grad():
        result = function(flat).numpy()
    return result.reshape((*x.shape[:-1], *result.shape[1:]))


def _itself(x: Tensor) -> Tensor:
    return x


@dataclass(frozen=True)
class DifferentiableProblem(TorchProblem):
    """dx/dt = a(x) + B(x) u with |u_i| <= U_i and reward rate r(x), all torch functions of batches of states."""

    name: str
    """What to call it in a table."""
    drift: Field
    """a: (N, p) -> (N, p), differentiable."""
    control_matrix: Field
    """B: (N, p) -> (N, p, q), differentiable."""
    reward_rate: Field
    """r: (N, p) -> (N,), differentiable."""
    limits: tuple[float, ...]
    """U, one per control."""
    draw: Callable[[np.random.Generator, int], Array]
    """The law of initial states: (generator, count) -> (count, p). p is read from it."""
    s_gamma: float = 1.0
    """Shortness factor, 1/s."""
    encode: Field = field(default=_itself)  # pyright: ignore[reportIncompatibleMethodOverride]
    """Network inputs of a state, (N, p) -> (N, m), differentiable: for instance cos and sin in place of an angle.

    V does not depend on a state variable that is left out: its slope is 0 and is not learned."""


def transition(form: TorchForm, x: Tensor, u: Tensor, dt: float) -> Tensor:
    """x(t + dt) by Euler's method with u (N, q) held, shape (N, p)."""
    return x + dt * (form.drift(x) + torch.einsum("npq,nq->np", form.control_matrix(x), u))


def transition_pullback(form: TorchForm, x: Tensor, u: Tensor, dt: float, costate: Tensor) -> Tensor:
    """F^T costate with F = d x(t + dt) / d x at held u, shape (N, p); exact, by torch.func.vjp."""
    pullback = torch.func.vjp(lambda y: transition(form, y, u, dt), x)[1]
    return pullback(costate)[0]


def require_torch(problem: ControlProblem) -> TorchForm:
    """The torch form of ``problem``; TypeError if it has none."""
    form = problem.form(TorchForm)
    if form is None:
        raise TypeError(f"problem {problem.name!r} has no torch form; describe it as a DifferentiableProblem")
    return form
