"""Continuous TD(lambda) for the cascade network on problems that only Python can step, such as MuJoCo models.

:class:`~swimmer_mj.learning.td.fused.FusedTD` needs the dynamics in compiled code. Here the problem's own functions say
how a state moves, what it earns and which control is best, as they do for
:class:`~swimmer_mj.learning.td.continuous_td.ContinuousTD`; only V, its gradients and the step of weights and traces
are compiled. They are plain loops: beside a step of MuJoCo they take nothing.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.vectors import OPTIONS
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.problems.problem import ControlProblem
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings

__all__ = ["SteppedTD"]

Array = NDArray[np.float64]
Real = NDArray[Any]  # the network's dtype


@entry_point(**OPTIONS)
def _value_and_slopes(weight: Real, source: Real, logistic: bool, delta: Real, slope: Real) -> float:
    """V of a cascade, given inputs and bias in ``source``; fills the rest of it, and the slopes of V.

    Parameters
    ----------
    weight : ndarray, shape (n, m + n)
        By neuron and what it hears: m inputs, the bias, the n - 1 neurons before the last.
    source : ndarray, shape (m + n,)
        What is heard; outputs of neurons are filled in.
    logistic : bool
        Sigmoids 1 / (1 + exp(-a)) in place of tanh(a).
    delta : ndarray, shape (n,)
        Filled with dV/da of all neurons' activations a. So dV/dw is delta_i source_j.
    slope : ndarray, shape (m + n,)
        Filled with dV/d source.
    """
    n, first = weight.shape[0], weight.shape[1] - weight.shape[0] + 1
    real = weight.dtype.type
    one, half = real(1.0), real(0.5)
    V = real(0.0)
    for i in range(n):
        V = real(0.0)
        for j in range(first + i):
            V += weight[i, j] * source[j]
        if i < n - 1:
            source[first + i] = half + half * math.tanh(half * V) if logistic else math.tanh(V)
    slope[:] = 0
    for i in range(n - 1, -1, -1):
        if i == n - 1:
            delta[i] = one
        else:
            y = source[first + i]
            delta[i] = ((y if logistic else one) - y * y) * slope[first + i]
        for j in range(first + i):
            slope[j] += weight[i, j] * delta[i]
    return V


@entry_point(**OPTIONS)
def _update(
    weight: Real, trace: Real, rate: Real, delta: Real, source: Real, H: float, decay: float, dt: float
) -> None:
    """w += dt eta H e, and then e += dt (-decay e + dV/dw), where there are connections."""
    n, first = weight.shape[0], weight.shape[1] - weight.shape[0] + 1
    real = weight.dtype.type
    change, kept, step = real(dt * H), real(1.0 - dt * decay), real(dt)
    for i in range(n):
        for j in range(first + i):
            weight[i, j] += change * rate[i, j] * trace[i, j]
            trace[i, j] = kept * trace[i, j] + step * delta[i] * source[j]


class SteppedTD(ContinuousTD):
    """As :class:`~swimmer_mj.learning.td.continuous_td.ContinuousTD`, for a Cascade on the CPU, and faster.

    Parameters
    ----------
    problem, settings
        As there.
    network : Cascade
        V_w, in float32 or float64. Its weights change in place.
    """

    def __init__(self, problem: ControlProblem, network: Cascade, settings: TDSettings | None = None) -> None:
        super().__init__(problem, network, settings)
        real = network.weight.detach().numpy().dtype
        n, sources = network.weight.shape
        self._logistic = network.sigmoid == "logistic"
        self._source, self._slopes, self._delta = (np.zeros(size, real) for size in (sources, sources, n))
        self._source[network.n_inputs] = 1  # the bias

    def value_and_slope(self, x: Array) -> tuple[float, Array]:
        """V and dV/dx (p,) at x (p,); for :meth:`step_weights`, dV/dw there."""
        (weight,) = self.weights
        m = self.problem.n_inputs
        with torch.enable_grad():
            state = torch.tensor(x, dtype=weight.dtype, requires_grad=True)
            z = self.problem.inputs(state)
        self._source[:m] = z.detach().numpy()
        V = _value_and_slopes(
            weight.detach().numpy(), self._source, self._logistic, self._delta, self._slopes
        )
        (dVdx,) = torch.autograd.grad(z, state, torch.from_numpy(self._slopes[:m]))
        return float(V), dVdx.double().numpy()

    def step_weights(self, H: float) -> None:
        """One step of weights and traces after :meth:`value_and_slope`."""
        _update(
            self.weights[0].detach().numpy(),
            self.traces[0].numpy(),
            self.rates[0].numpy(),
            self._delta,
            self._source,
            H,
            self.problem.s_gamma + self.settings.s_lambda,
            self.settings.dt,
        )
