"""The swimmer's forms for many trajectories at once, and how it chooses torques that are held."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.learning.problems.forms import BatchForm, Encoding, HoldForm
from swimmer_mj.learning.problems.held import Memory, Slope, held_control
from swimmer_mj.learning.problems.problem import DT
from swimmer_mj.learning.problems.swim import joints
from swimmer_mj.learning.problems.swim.batched_costates import targets
from swimmer_mj.learning.problems.swim.batched_equations import (
    greedy_rk4,
    greedy_step,
    responses,
    rk4,
    step,
    workspace,
)
from swimmer_mj.learning.problems.swim.reduced import reduced_constants
from swimmer_mj.learning.problems.swim.swimming import RATE_SCALE, Swimming

__all__ = ["held", "make"]

Array = NDArray[np.float64]


class _Held:
    """Torques that are chosen for where an Euler step leads under them."""

    def __init__(self, problem: Swimming) -> None:
        n = problem.parameters.n_links
        self.ws, self.constants = workspace(n), reduced_constants(problem.parameters)
        self.limits = problem.control_limits

    def control(self, slope_at: Slope, x: Array, duration: float, memory: Memory | None) -> Array:
        """u (q, N) at x (p, N), N a multiple of LANES."""
        coast, gain = np.empty_like(x), np.empty((self.limits.size, *x.shape))
        responses(self.ws, self.constants, x, duration, coast, gain)
        price = np.zeros((self.limits.size, x.shape[1]))
        return held_control(slope_at, coast, gain, self.limits, price, memory)

    def choose(
        self, slope_at: Slope, x: Array, duration: float | None, memory: Memory | None = None
    ) -> Array:
        """u (..., q) at x (..., p)."""
        flat = x.reshape(-1, x.shape[-1])
        rows = np.concatenate([flat, np.repeat(flat[-1:], -len(flat) % LANES, axis=0)])
        hold = DT if duration is None else duration
        u = self.control(slope_at, np.ascontiguousarray(rows.T), hold, memory)
        return u[:, : len(flat)].T.reshape(*x.shape[:-1], -1)

    def advance(
        self,
        move: Callable[..., None],
        slope_at: Slope,
        x: Array,
        dVdx: Array,
        flips: Array,
        dt: float,
        u: Array,
        y: Array,
        memory: Memory | None = None,
    ) -> None:
        """A step by :func:`step` or :func:`rk4`, as a BatchForm's; ``dVdx`` is not asked for."""
        u[:] = flips * self.control(slope_at, x, dt or DT, memory)
        if dt > 0:
            move(self.ws, self.constants, x, u, dt, y)


def held(problem: Swimming) -> HoldForm | None:
    """How torques are chosen that are held; None for the greedy ones of the instant."""
    return HoldForm(_Held(problem).choose) if problem.held else None


def make(problem: Swimming) -> BatchForm | None:
    """The swimmer for batches of trajectories; None with raw angles as inputs, or stepped by RK4."""
    if problem.encoding != "circle" or problem.integrator != "euler":
        return None
    n = problem.parameters.n_links
    angles, linear = np.arange(n), np.arange(n, 2 * n + 2)
    encoding = Encoding(
        angles, angles, n + angles, linear, linear + n, np.array([RATE_SCALE] * n + [1.0, 1.0])
    )
    coordinates = joints.batch_coordinates(problem)
    if coordinates is not None:
        encoding = joints.encoding(n)
    ws, constants = workspace(n), reduced_constants(problem.parameters)
    limits = problem.control_limits
    if problem.held:
        by_hold = _Held(problem)
        euler, exact = partial(by_hold.advance, step), partial(by_hold.advance, rk4)
    else:
        euler, exact = (
            lambda slope_at, *rest, memory=None, move=move: move(ws, constants, limits, *rest)
            for move in (greedy_step, greedy_rk4)
        )
    return BatchForm(
        encoding, euler, exact, partial(targets, ws, constants), lambda x, u: x[..., 2 * n, :], coordinates
    )
