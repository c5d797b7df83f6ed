"""The learner of equation 2 for a linear value function, the paper's foil: V_w(x) = w . phi(x).

Its order of updates is that of :class:`~swimmer_mj.learning.td.continuous_td.ContinuousTD`, with dV/dw = phi
(:mod:`~swimmer_mj.learning.td.features`). Where V is piecewise constant, as with tile coding, equation 2 does not apply
as it stands. Chosen: H by the finite difference (V(x(t + dt)) - V(x(t))) / dt, which is the discrete TD error; and, for
the greedy control, the slope of V averaged over an interval along each axis, which is exactly
(V(x + h e_i) - V(x - h e_i)) / 2h, 2h its width.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.learning.problems.problem import ControlProblem, as_states, episode_steps, require_euler
from swimmer_mj.learning.td import linear_kernel as kernel
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.features import Features
from swimmer_mj.learning.td.fused import Rollouts, SampleStatistics, TrialStatistics, compiled_form

__all__ = ["LinearTD"]

Array = NDArray[np.float64]


class LinearTD:
    """The learner of equation 2 for V_w = w . phi, compiled, in float64.

    Parameters
    ----------
    problem : ControlProblem
        What to learn; must have a compiled form, and controls of the instant that cost nothing.
    features : Features
        phi, over the problem's state variables.
    settings : TDSettings, optional
        The algorithm's constants; ``output_scaling`` means nothing here and ``vario`` must be None.
    hamiltonian : "gradient" or "difference", optional
        H with dV/dx . f, or with (V(x(t + dt)) - V(x(t))) / dt; "gradient" by default where phi is smooth.
    """

    def __init__(
        self,
        problem: ControlProblem,
        features: Features,
        settings: TDSettings | None = None,
        hamiltonian: Literal["gradient", "difference"] | None = None,
    ) -> None:
        self.settings = settings = TDSettings() if settings is None else settings
        if settings.vario is not None:
            raise ValueError("LinearTD has one learning rate: settings.vario must be None")
        compiled = compiled_form(problem)
        if features.n_axes != problem.state_size:
            raise ValueError(
                f"{problem.name} has {problem.state_size} state variables, the features {features.n_axes}"
            )
        if hamiltonian is None:
            hamiltonian = "gradient" if features.smooth else "difference"
        if hamiltonian not in ("gradient", "difference"):
            raise ValueError(f"hamiltonian must be 'gradient' or 'difference', got {hamiltonian!r}")
        if hamiltonian == "gradient" and not features.smooth:
            raise ValueError("hamiltonian must be 'difference' where V is piecewise constant, got 'gradient'")
        self.problem = problem
        self.features = features
        self.hamiltonian = hamiltonian
        self.weight: Array = np.zeros(features.size)
        self.trace: Array = np.zeros(features.size)
        self._scratch: Array = np.zeros(features.size)
        self._limits = np.asarray(problem.control_limits, dtype=np.float64)
        self._constants = compiled.constants
        self._phi = features.compile()
        self._form = kernel.form_of(compiled, self._phi, hamiltonian == "difference")

    def phi(self, x: Array) -> Array:
        """Features, shape (N,), at ``x``, shape (p,)."""
        out = np.zeros(self.features.size)
        kernel.add(self._form, self._phi.constants, self._state(x), 1.0, out, self._scratch)
        return out

    def slope(self, x: Array) -> Array:
        """dV/dx, shape (p,), at ``x``, shape (p,); of the averaged V where the features are not smooth."""
        out = np.empty(self.features.n_axes)
        kernel.slope(self._form, self._phi.constants, self._state(x), self.weight, out, self._scratch)
        return out

    def value(self, x: Array) -> float:
        """V at ``x``, shape (p,)."""
        return kernel.value(self._form, self._phi.constants, self._state(x), self.weight, self._scratch)

    def _state(self, x: Array) -> Array:
        return as_states(np.asarray(x)[None], self.problem.state_size)[0]

    def train(self, initial_states: Array) -> TrialStatistics:
        """One trial from each of ``initial_states`` (trials, p), one after the other."""
        require_euler(self.problem)
        states = as_states(initial_states, self.problem.state_size)
        settings = self.settings
        statistics = np.empty((len(states), 3))
        kernel.train(
            self._form,
            self._constants,
            self._phi.constants,
            self._limits,
            states,
            settings.steps_per_trial,
            settings.dt,
            self.problem.s_gamma,
            settings.s_lambda,
            settings.eta,
            self.weight,
            self.trace,
            self._scratch,
            statistics,
        )
        return TrialStatistics(*statistics.T)

    def sample(self, states: Array) -> SampleStatistics:
        """V and H at each of ``states`` (count, p); nothing is learned."""
        states = as_states(states, self.problem.state_size)
        out = np.empty((len(states), 2))
        kernel.sample(
            self._form,
            self._constants,
            self._phi.constants,
            self._limits,
            states,
            self.settings.dt,
            self.problem.s_gamma,
            self.weight,
            self._scratch,
            out,
        )
        return SampleStatistics(*out.T)

    def rollout(
        self, initial_states: Array, duration: float, skip: float = 0.0, dt: float = 0.01
    ) -> Rollouts:
        """Greedy episodes of ``duration`` seconds by RK4 with the control held for ``dt``; nothing is learned."""
        states = as_states(initial_states, self.problem.state_size)
        n_steps, n_skip = episode_steps(duration, skip, dt)
        out = np.empty((len(states), 2))
        kernel.rollout(
            self._form,
            self._constants,
            self._phi.constants,
            self._limits,
            states,
            n_steps,
            n_skip,
            dt,
            self.problem.s_gamma,
            self.weight,
            self._scratch,
            out,
        )
        return Rollouts(*out.T)
