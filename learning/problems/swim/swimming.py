"""Swimming as a control problem: section 4, in the swimmer's 12 reduced variables.

The target direction is the x axis; by symmetry a policy for it swims in any direction, given the state in a frame
that is turned. The reward is the velocity of the centre of mass along x (A.4).

Here the problem is stated in NumPy, by A.3 or by MuJoCo. The other files of this folder have its other forms.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal, Self, TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.initial_states import InitialLaw, random_initial_state
from swimmer_mj.integrators import euler_step, rk4_step
from swimmer_mj.learning.problems.forms import (
    BatchForm,
    CompiledForm,
    CoordinatesForm,
    EnvironmentForm,
    HoldForm,
    LanesForm,
    SwimmerForm,
    TorchForm,
    TrialsForm,
)
from swimmer_mj.learning.problems.settings import require_choices, require_positive
from swimmer_mj.parameters import PAPER, SwimmerParameters

if TYPE_CHECKING:
    from swimmer_mj.dynamics import Dynamics

__all__ = ["RATE_SCALE", "TURN", "Swimming"]

Array = NDArray[np.float64]
Form = TypeVar("Form")

RATE_SCALE = 0.2
"""theta' is scaled by this as a network input, so that it is of order one (chosen)."""
TURN = 2 * math.pi
"""rad."""


@dataclass(frozen=True)
class Swimming:
    """Swim along x as fast as possible. State z as in :mod:`swimmer_mj.state`, control: torques, N·m."""

    parameters: SwimmerParameters = PAPER
    """The swimmer."""
    s_gamma: float = 1.0
    """Shortness factor, 1/s (left open by the paper; 1 was seen to learn by TD(lambda), 0.5 by value gradients)."""
    physics: Literal["analytic", "mujoco"] = "analytic"
    """Who computes drift and control matrix: A.3, or MuJoCo. With "mujoco", TD(lambda) learns in dm_control itself."""
    integrator: Literal["euler", "rk4"] = "euler"
    """"euler" steps the reduced variables (section 4); "rk4" steps the full state, as MuJoCo's RK4 does."""
    encoding: Literal["circle", "angle", "unwrapped"] = "circle"
    """Inputs for each angle: its cosine and sine (chosen), or the angle itself in [-pi, pi], or as it is after however
    many turns. An environment observes angles within a turn: an "unwrapped" policy is shown those there."""
    initial_law: InitialLaw = "moderate"
    """See :func:`swimmer_mj.initial_states.random_initial_state`."""
    coordinates: Literal["links", "joints"] = "links"
    """In which V is learned: the state's own, or angles between links and the velocity of the head
    (:mod:`swimmer_mj.learning.problems.swim.joints`)."""
    held: bool = False
    """Choose torques for the time for which they are held (:mod:`swimmer_mj.learning.problems.held`), not for the
    instant."""

    def __post_init__(self) -> None:
        require_choices(self)
        if self.parameters.n_links < 2:
            raise ValueError(
                f"a swimmer needs at least 2 links to have a joint to move, got {self.parameters.n_links}"
            )
        if self.coordinates == "joints" and self.encoding != "circle":
            raise ValueError(f"coordinates 'joints' need encoding 'circle', got {self.encoding!r}")
        require_positive(self, "s_gamma")

    @classmethod
    def from_options(
        cls,
        links: int = PAPER.n_links,
        s_gamma: float = 1.0,
        physics: Literal["analytic", "mujoco"] = "analytic",
        coordinates: Literal["links", "joints"] = "links",
        held: bool = False,
    ) -> Self:
        """The problem by the options of the command line."""
        return cls(SwimmerParameters(n_links=links), s_gamma, physics, coordinates=coordinates, held=held)

    @property
    def dynamics(self) -> Dynamics:
        """The equations of motion in the full state; each thread has its own, as runs of several seeds share one."""
        own = self.__dict__.setdefault("_own", threading.local())
        if not hasattr(own, "dynamics"):
            own.dynamics = self._make_dynamics()
        return own.dynamics

    def _make_dynamics(self) -> Dynamics:
        if self.physics == "analytic":
            return AnalyticSwimmer(self.parameters)
        from swimmer_mj.dynamics import MujocoSwimmer

        return MujocoSwimmer(self.parameters)

    def __getstate__(self) -> dict[str, Any]:
        """Without what belongs to a thread, and is made again when it is needed."""
        return {name: value for name, value in self.__dict__.items() if name != "_own"}

    @property
    def advice(self) -> Mapping[str, Any]:
        """Settings of value gradients that learn it faster; torques to be held cost more, so fewer states a round."""
        return {"huber": 1.0, **({"trajectories": 256, "minibatch": 256} if self.held else {})}

    @property
    def name(self) -> str:
        """swim5 for 5 links, and so on."""
        return f"swim{self.parameters.n_links}"

    @property
    def state_size(self) -> int:
        """2n + 2."""
        return st.reduced_size(self.parameters.n_links)

    @property
    def n_inputs(self) -> int:
        """3n + 2: cos and sin of each angle, each angular velocity, the velocity; 2n + 2 with raw angles."""
        return (3 if self.encoding == "circle" else 2) * self.parameters.n_links + 2

    @property
    def control_limits(self) -> Array:
        """U, shape (n - 1,), N·m."""
        return self.parameters.torque_limits

    def drift_and_control_matrix(self, x: Array) -> tuple[Array, Array]:
        """a, shape (..., 2n + 2), and B, shape (..., 2n + 2, n - 1), of the reduced state."""
        p = self.parameters
        full = st.expand(p, x)
        drift, control_matrix = self.dynamics.drift_and_control_matrix(full)
        # dx/du has no kinematic part, so that reduce_derivative is linear in its columns.
        columns = np.moveaxis(control_matrix, -1, 0)
        B = np.moveaxis(st.reduce_derivative(p, full, columns), 0, -1)
        return st.reduce_derivative(p, full, drift), B

    def reward(self, x: Array) -> Array:
        """Velocity of the centre of mass along x, m/s."""
        return st.split_reduced(x, self.parameters.n_links).velocity[..., 0]

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """x(t + dt) with the torques u held."""
        p = self.parameters
        if self.integrator == "rk4":
            full = rk4_step(lambda y: self.dynamics.derivative(y, u), st.expand(p, x), dt)
            return st.reduce(p, full)

        def f(y: Array) -> Array:
            full = st.expand(p, y)
            return st.reduce_derivative(p, full, self.dynamics.derivative(full, u))

        return euler_step(f, x, dt)

    def initial_states(self, rng: np.random.Generator, count: int) -> Array:
        """Random initial states, shape (count, 2n + 2); see :mod:`swimmer_mj.initial_states`."""
        return random_initial_state(rng, self.parameters.n_links, size=count, law=self.initial_law)

    def inputs(self, x: torch.Tensor) -> torch.Tensor:
        """cos theta, sin theta (or theta), theta' scaled, dG; shape (..., 3n + 2). Or the same of joints and head."""
        other = self.form(CoordinatesForm)
        if other is not None:
            return other.encode(other.enter(x))
        n = self.parameters.n_links
        theta, theta_dot, velocity = x[..., :n], x[..., n : 2 * n], x[..., 2 * n :]
        if self.encoding != "circle":
            turns = torch.round(theta / TURN) if self.encoding == "angle" else 0.0
            return torch.cat([theta - TURN * turns, RATE_SCALE * theta_dot, velocity], dim=-1)
        return torch.cat([torch.cos(theta), torch.sin(theta), RATE_SCALE * theta_dot, velocity], dim=-1)

    def form(self, kind: type[Form]) -> Form | None:
        """The swimmer in another form; of a subclass, which may have equations or a reward of its own, none."""
        if type(self) is not Swimming or (kind is TrialsForm and self.physics != "mujoco"):
            return None
        # Each form in a file of its own, which is imported when it is asked for
        place = _FORMS.get(kind)
        if place is None:
            return None
        module, make = place
        return getattr(import_module(f"swimmer_mj.learning.problems.swim.{module}"), make)(self)


_FORMS: dict[type[Any], tuple[str, str]] = {
    TorchForm: ("torch_form", "make"),
    CompiledForm: ("scalar", "make"),
    LanesForm: ("lanes", "make"),
    BatchForm: ("batched", "make"),
    CoordinatesForm: ("joints", "make"),
    HoldForm: ("batched", "held"),
    EnvironmentForm: ("environment", "judged"),
    SwimmerForm: ("environment", "drawn"),
    TrialsForm: ("environment", "learned"),
}
"""Module and function of each form."""
