"""A MuJoCo model for batches of trajectories, which stand on the last axis."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from swimmer_mj.learning.problems.held import Memory, Slope, held_control
from swimmer_mj.learning.problems.mujoco import costates, kernel
from swimmer_mj.learning.problems.mujoco.coordinates import Coordinates
from swimmer_mj.learning.problems.mujoco.kernel import Actuation, Readings, Simulation
from swimmer_mj.learning.problems.mujoco.simulations import Simulations

__all__ = ["EPSILON", "MujocoBatch", "Rate"]

Array = NDArray[np.float64]

EPSILON = 1e-6
"""By how much a coordinate is moved for a finite difference, in its own unit."""


class Rate(NamedTuple):
    """The reward rate r - sum c u^2."""

    reward: Array
    """r."""
    cost: Array
    """c."""


class MujocoBatch:
    """What a :class:`~swimmer_mj.learning.problems.forms.BatchForm` asks for.

    Parameters
    ----------
    learner, actor : Simulations
        Of the model as a learner steps it, and as it is.
    coordinates, actuation
        The state and the controls.
    rate : callable
        (x (N, p), readings (N, r)) -> r (N,), c (N, q), in torch.
    constant_cost : ndarray, shape (q,), optional
        c, if it does not depend on the state.
    centred : bool
        Central differences in place of forward ones, at twice the cost.
    timestep : float
        The model's own, s.
    held : bool
        Choose controls for the time for which they are held (:func:`held_control`), in place of for the instant.
    s_gamma, control_timestep : float
        The problem's shortness factor, 1/s, and for how long a policy's control is held, s; the model's own time step
        by default.
    """

    def __init__(
        self,
        learner: Simulations,
        actor: Simulations,
        coordinates: Coordinates,
        actuation: Actuation,
        rate: Callable[[Tensor, Tensor], tuple[Tensor, Tensor]],
        constant_cost: Array | None = None,
        centred: bool = False,
        *,
        timestep: float,
        held: bool = True,
        s_gamma: float = 1.0,
        control_timestep: float | None = None,
    ) -> None:
        self._learner, self._actor = learner, actor
        self._co, self._ac = coordinates, actuation
        self._rate, self._constant_cost = rate, constant_cost
        self._centred = centred
        self._timestep = timestep
        self.held, self._s_gamma = held, s_gamma
        self._control_timestep = self._timestep if control_timestep is None else control_timestep

    # States and rewards --------------------------------------------------------------------------------------------

    def read(self, x: Array) -> Array:
        """The readings at x (p, N), shape (r, N)."""
        out = np.empty((self._learner.n_readings, x.shape[1]))
        if out.size:
            fn, co = self._learner.functions, self._co

            def work(sim: Simulation, readings: Readings, first: int, last: int) -> None:
                kernel.read(fn, sim, co, readings, x, first, last, out)

            self._learner.run(work, x.shape[1])
        return out

    def rate(self, x: Array) -> Rate:
        """r (N,) and c (q, N) at x (p, N)."""
        with torch.no_grad():
            r, c = self._rate(torch.from_numpy(x).T, torch.from_numpy(self.read(x)).T)
        return Rate(r.numpy(), np.ascontiguousarray(c.T.numpy()))

    def reward(self, x: Array, u: Array) -> Array:
        """r - sum c u^2, (..., N), at x (..., p, N) and u (..., q, N)."""
        flat_x = np.ascontiguousarray(np.moveaxis(x, -2, 0).reshape(x.shape[-2], -1))
        flat_u = np.moveaxis(u, -2, 0).reshape(u.shape[-2], -1)
        r, c = self.rate(flat_x)
        return (r - (c * flat_u**2).sum(axis=0)).reshape(*x.shape[:-2], x.shape[-1])

    def _costs(self, x: Array) -> Array:
        """c (q, N) at x (p, N)."""
        if self._constant_cost is None:
            return self.rate(x).cost
        return np.tile(self._constant_cost[:, None], (1, x.shape[1]))

    # Dynamics ------------------------------------------------------------------------------------------------------

    def drift_and_control_matrix(self, x: Array) -> tuple[Array, Array]:
        """a (N, p) and B (N, p, q) at x (N, p)."""
        fn, co, ac = self._learner.functions, self._co, self._ac
        a, B = np.zeros_like(x), np.zeros((*x.shape, ac.limits.size))

        def work(sim: Simulation, readings: Readings, first: int, last: int) -> None:
            kernel.drift_and_control_matrix(fn, sim, co, ac, x, first, last, a, B)

        self._learner.run(work, len(x))
        return a, B

    def step(self, x: Array, u: Array, dt: float) -> Array:
        """The states (p, N) after a learner's step from x (p, N) under u (q, N)."""
        y = np.empty_like(x)
        self._move(self._learner, x, u, dt, 0, y)
        return y

    def _move(self, sims: Simulations, x: Array, u: Array, dt: float, steps: int, y: Array) -> None:
        fn, co, ac = sims.functions, self._co, self._ac

        def work(sim: Simulation, readings: Readings, first: int, last: int) -> None:
            kernel.step(fn, sim, co, ac, x, u, steps, first, last, y)

        sims.run(work, x.shape[1], dt)

    def _own_steps(self, duration: float) -> int:
        """How many of the model's own steps fit into ``duration``, at least 1."""
        return max(1, round(duration / self._timestep))

    def responses(self, x: Array, duration: float) -> tuple[Array, Array]:
        """Where x (p, N) comes to without control, (p, N), and what a held unit of each adds, (q, p, N).

        By one learner's step: V is that of its dynamics.
        """
        fn, co, ac = self._learner.functions, self._co, self._ac
        coast, gain = np.empty_like(x), np.empty((ac.limits.size, *x.shape))

        def work(sim: Simulation, readings: Readings, first: int, last: int) -> None:
            kernel.respond(fn, sim, co, ac, x, first, last, coast, gain)

        self._learner.run(work, x.shape[1], duration)
        return coast, gain

    def control(self, slope_at: Slope, x: Array, duration: float | None = None) -> Array:
        """Greedy u (q, N) of a policy at x (p, N), held for ``duration``, by default a control timestep."""
        hold = self._control_timestep if duration is None else duration
        return self._chosen(slope_at, x, slope_at(x), hold)

    def _chosen(self, slope_at: Slope, x: Array, dVdx: Array, hold: float) -> Array:
        """Greedy u (q, N)."""
        cost = self._costs(x)
        if self.held:
            coast, gain = self.responses(x, hold)
            price = hold * math.exp(self._s_gamma * hold) * cost
            return held_control(slope_at, coast, gain, self._ac.limits, price)
        fn, co, ac, u = self._learner.functions, self._co, self._ac, np.empty((len(cost), x.shape[1]))

        def work(sim: Simulation, readings: Readings, first: int, last: int) -> None:
            kernel.choose(fn, sim, co, ac, x, dVdx, cost, first, last, u)

        self._learner.run(work, x.shape[1])
        return u

    def greedy_step(
        self,
        slope_at: Slope,
        x: Array,
        dVdx: Array,
        flips: Array,
        dt: float,
        u: Array,
        y: Array,
        memory: Memory | None = None,
    ) -> None:
        """Greedy u (q, N) times ``flips``, and y (p, N) after a learner's step if dt > 0; y may be x.

        The ``memory`` is left alone: beside the model's steps V's slopes cost little.
        """
        if dt == 0:
            u[:] = flips * self._chosen(slope_at, x, dVdx, self._control_timestep)
            return
        u[:] = flips * self._chosen(slope_at, x, dVdx, dt)
        self._move(self._learner, x, u, dt, 0, y)

    def greedy_act(
        self, slope_at: Slope, x: Array, dVdx: Array, flips: Array, dt: float, u: Array, y: Array
    ) -> None:
        """As :meth:`greedy_step`, by the model's own integrator, in steps of its own as far as they fit into dt."""
        u[:] = flips * self._chosen(slope_at, x, dVdx, dt)
        steps = self._own_steps(dt)
        self._move(self._actor, x, u, dt / steps, steps, y)

    # Targets -------------------------------------------------------------------------------------------------------

    def _slopes(self, x: Array, u: Array, dt: float) -> tuple[Array, Array, Array]:
        """dt r (T, N), and dt times its slope in x, (T, p, N), and in the readings, (T, r, N); u is held."""
        T, p, N = x.shape
        flat = np.ascontiguousarray(x.transpose(1, 0, 2).reshape(p, T * N))
        values = torch.from_numpy(self.read(flat)).T.contiguous().requires_grad_()
        state = torch.from_numpy(flat).T.contiguous().requires_grad_()
        held = torch.from_numpy(u).transpose(1, 2).reshape(T * N, -1)
        with torch.enable_grad():
            r, c = self._rate(state, values)
            if not r.requires_grad:
                raise ValueError(
                    "the reward has no slope, which value gradients follow (constant, a comparison, or detached): "
                    "give a smooth one, or learn with --method td"
                )
            r = dt * (r - (c * held**2).sum(dim=1))
            drdx, rho = torch.autograd.grad(
                r.sum(), (state, values), allow_unused=True, materialize_grads=True
            )

        def rows(y: Tensor) -> Array:
            return np.ascontiguousarray(y.detach().view(T, N, y.shape[1]).transpose(1, 2).numpy())

        return r.detach().view(T, N).numpy(), rows(drdx), rows(rho)

    def targets(
        self,
        x: Array,
        u: Array,
        V: Array,
        dVdx: Array,
        dt: float,
        s_gamma: float,
        s_lambda: float,
        out: NDArray[Any],
    ) -> None:
        """g and G of :mod:`swimmer_mj.learning.value_gradient.equations` into ``out`` (T, p + 1, N)."""
        T, _, N = u.shape
        p = x.shape[1]
        l, discount = math.exp(-s_lambda * dt), math.exp(-s_gamma * dt)
        r, drdx, rho = self._slopes(x[:T], u, dt)
        G = V[T]
        for t in range(T - 1, -1, -1):
            G = r[t] + discount * ((1 - l) * V[t + 1] + l * G)
            out[t, p] = G
        fn, co, ac, g = self._learner.functions, self._co, self._ac, np.empty((T, p, N))
        epsilon, centred = EPSILON, self._centred

        def work(sim: Simulation, readings: Readings, first: int, last: int) -> None:
            costates.pull_back(
                fn,
                sim,
                co,
                ac,
                readings,
                x,
                u,
                dVdx,
                drdx,
                rho,
                l,
                discount,
                dt,
                epsilon,
                centred,
                first,
                last,
                g,
            )

        self._learner.run(work, N, dt)
        out[:, :p] = g
