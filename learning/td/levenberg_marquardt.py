"""Stochastic diagonal Levenberg-Marquardt (section 3.4; LeCun, Bottou, Orr and Müller 1998, section 9.1).

A learning rate for each weight from the curvature of the error: eta_jk = eta / (h_jk + mu), h_jk being a running
average of the Gauss-Newton approximation of d2E/dw_jk^2. doi:10.1007/3-540-49430-8_2

For a cascade (:class:`swimmer_mj.learning.networks.networks.Cascade`) with activations a_j = sum_k w_jk y_k, outputs
y_j = f(a_j) and a linear output, and for the error E = (V - target)^2 / 2 at one state,

    c_output = 1                                    d2E/da^2 of the output
    c_k      = f'(a_k)^2 sum_(j > k) w_jk^2 c_j     neuron k, over all later neurons j
    h_jk     = c_j y_k^2                            the connection from source k to neuron j

This is back-propagation with weights and slopes squared. It drops the terms with second derivatives of f and the
off-diagonal terms of the curvature in the activations. Where each neuron acts on the output along one path (one hidden
layer; a chain), there are no such off-diagonal terms, and h_jk = (dV/dw_jk)^2. In a cascade the paths are many:
(dV/dw_jk)^2 is the Gauss-Newton diagonal itself, and c_k leaves out what the products of different paths add to it. It
is the mean of (dV/da_k)^2 over all signs that the weights might have. :func:`squared_gradient` is there to compare.

Our choices, of what TD(lambda) leaves open:

- The error. Section 3.4 notes that the true Hessian of TD's total error is hard to come by, as H depends on dV/dx. By
  the forward view, a trial changes w by the integral of eta (R - V) dV/dw, with R the lambda-return; R is held fixed,
  as TD holds it. Then traces decide on the target and not on the curvature: that of the integral of (R - V)^2 / 2 is
  the trial's duration times the mean of (dV/dw)^2 over it. s_lambda is nowhere in h; the duration is left to eta.
- The average: after each trial, over the two states at which it began and ended, with the weights that it left; then
  over trials with decay gamma, 1/100 as vario-eta's beta.
- h(0) = 1 for all weights, the curvature of the output's bias: rates start low and grow. (With output weights 0,
  hidden weights have no curvature at all at first.)
- mu, which bounds a rate at eta / mu.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.learning.problems.settings import require_positive

__all__ = [
    "Firing",
    "LevenbergMarquardt",
    "average",
    "fire",
    "gauss_newton_diagonal",
    "learning_rate",
    "squared_gradient",
]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LevenbergMarquardt:
    """Constants of the method."""

    gamma: float = 0.01
    """Decay of the average per trial (chosen: that of vario-eta)."""
    mu: float = 0.1
    """Bounds the rate at eta / mu (chosen: a tenth of the largest curvature, that of the output's bias)."""
    initial_curvature: float = 1.0
    """h(0) (chosen)."""

    def __post_init__(self) -> None:
        if not 0 < self.gamma <= 1:
            raise ValueError(f"gamma must be in (0, 1], got {self.gamma!r}")
        require_positive(self, "mu", "initial_curvature")


class Firing(NamedTuple):
    """A cascade at given inputs."""

    sources: Array
    """y: inputs, 1 for the bias, outputs of the hidden neurons; shape (..., m + n)."""
    slopes: Array
    """f'(a) of the hidden neurons; shape (..., n - 1)."""


def fire(weight: Array, z: Array, sigmoid: Literal["tanh", "logistic"] = "tanh") -> Firing:
    """Outputs and slopes at inputs ``z`` (..., m), with ``weight`` (..., n, m + n) as a Cascade has it."""
    n, sources = weight.shape[-2:]
    first = sources - n + 1
    shape = np.broadcast_shapes(weight.shape[:-2], z.shape[:-1])
    y = np.zeros((*shape, sources))
    y[..., : first - 1] = z
    y[..., first - 1] = 1.0
    slope = np.empty((*shape, n - 1))
    for i in range(n - 1):
        a = (weight[..., i, : first + i] * y[..., : first + i]).sum(axis=-1)
        y[..., first + i] = output = np.tanh(a) if sigmoid == "tanh" else 0.5 + 0.5 * np.tanh(0.5 * a)
        slope[..., i] = 1 - output**2 if sigmoid == "tanh" else output * (1 - output)
    return Firing(y, slope)


def _propagate_back(weight: Array, slopes: Array) -> Array:
    """d_output = 1 and d_k = slope_k sum_j w_jk d_j over later neurons j; shape (..., n)."""
    n, sources = weight.shape[-2:]
    first = sources - n + 1
    shape = np.broadcast_shapes(weight.shape[:-2], slopes.shape[:-1])
    d = np.ones((*shape, n))
    for k in range(n - 2, -1, -1):
        d[..., k] = slopes[..., k] * (weight[..., k + 1 :, first + k] * d[..., k + 1 :]).sum(axis=-1)
    return d


def _connected(n: int, sources: int) -> NDArray[np.bool_]:
    return np.arange(sources) <= sources - n + np.arange(n)[:, None]


def gauss_newton_diagonal(weight: Array, firing: Firing) -> Array:
    """h_jk = c_j y_k^2, shape (..., n, m + n) as ``weight``; 0 where a cascade has no connection."""
    c = _propagate_back(weight**2, firing.slopes**2)
    return _connected(*weight.shape[-2:]) * c[..., :, None] * firing.sources[..., None, :] ** 2


def squared_gradient(weight: Array, firing: Firing) -> Array:
    """(dV/dw_jk)^2, shape (..., n, m + n): the Gauss-Newton diagonal, nothing else dropped."""
    delta = _propagate_back(weight, firing.slopes)
    return _connected(*weight.shape[-2:]) * (delta[..., :, None] * firing.sources[..., None, :]) ** 2


def average(h: Array, new: Array, gamma: float) -> Array:
    """h(k+1) = (1 - gamma) h(k) + gamma times what trial k showed."""
    return (1 - gamma) * h + gamma * new


def learning_rate(h: Array, eta: float | Array, mu: float | Array) -> Array:
    """eta_jk = eta / (h_jk + mu)."""
    return eta / (h + mu)
