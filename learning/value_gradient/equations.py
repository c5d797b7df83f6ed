"""Learning the value gradient: what greedy control asks for, taught directly.

The greedy control depends on dV/dx, not on V. Along a trajectory x(0), x(dt) .. x(T dt) with its controls held, the
model gives targets for both, backwards in time. With F = d x(t + dt) / d x(t) at held u, and l = exp(-s_lambda dt)::

    G(t) = r dt     + e^{-s_gamma dt}     [(1 - l) V(x(t + dt))     + l G(t + dt)]
    g(t) = dr/dx dt + e^{-s_gamma dt} F^T [(1 - l) dV/dx(x(t + dt)) + l g(t + dt)]

The first is the target of TD(lambda) in its forward view; the second is its gradient, the costate of Pontryagin's
principle, bootstrapped: value-gradient learning, VGL(lambda) (Fairbank and Alonso 2012,
doi:10.1109/IJCNN.2012.6252791); l = 0 is Werbos's dual heuristic programming. That u is held costs nothing when it is
greedy: inside its bounds dH/du = 0, and at a bound du/dx = 0 (for the controls that are affine here: Doya 2000,
doi:10.1162/089976600300015961).

A round moves a batch of trajectories on by some steps, computes their targets, and takes one pass of Adam over
minibatches of the loss (V - G)^2 + w sum_i S_i^2 (dV/dx_i - g_i)^2. S_i = 1 / |dz/dx_i| makes the errors of dV/dx those
of the slope in network inputs z: it is 5 for an angular velocity that enters as 0.2 theta'. Where dynamics are
unstable, what is looked ahead grows, and a few targets g are far off: Huber's loss keeps them from deciding
(:func:`huber`).

Here are the equations; :mod:`~swimmer_mj.learning.value_gradient.settings` has the algorithm's constants,
:mod:`~swimmer_mj.learning.value_gradient.learner` the learner, and :mod:`~swimmer_mj.learning.value_gradient.engines`
what it needs done fast.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

__all__ = [
    "Targets",
    "costate",
    "huber",
    "lookahead",
    "targets",
    "value_and_gradient_loss",
    "value_target",
    "weight_of_round",
]


def lookahead(estimate: Tensor, target: Tensor, s_lambda: float, dt: float) -> Tensor:
    """(1 - l) estimate + l target, l = exp(-s_lambda dt): what is known of time t + dt."""
    l = math.exp(-s_lambda * dt)
    return (1 - l) * estimate + l * target


def value_target(r: Tensor, later: Tensor, s_gamma: float, dt: float) -> Tensor:
    """G(t) = r dt + exp(-s_gamma dt) later, from what :func:`lookahead` says of V; shape (N,)."""
    return r * dt + math.exp(-s_gamma * dt) * later


def costate(drdx: Tensor, pulled_back: Tensor, s_gamma: float, dt: float) -> Tensor:
    """g(t) = dr/dx dt + exp(-s_gamma dt) F^T later, from F^T of what :func:`lookahead` says of dV/dx; shape (N, p)."""
    return drdx * dt + math.exp(-s_gamma * dt) * pulled_back


class Targets(NamedTuple):
    """Of every state of a batch of trajectories but the last."""

    value: Tensor
    """G, shape (T, N)."""
    gradient: Tensor
    """g, shape (T, N, p)."""


def targets(
    r: Tensor,
    drdx: Tensor,
    V: Tensor,
    dVdx: Tensor,
    pullback: Callable[[int, Tensor], Tensor],
    s_gamma: float,
    s_lambda: float,
    dt: float,
) -> Targets:
    """G and g along N trajectories of T steps, backwards from V and dV/dx at their ends.

    Parameters
    ----------
    r, drdx : Tensor, shapes (T, N) and (T, N, p)
        Reward rate and its gradient at the states 0 .. T - 1.
    V, dVdx : Tensor, shapes (T + 1, N) and (T + 1, N, p)
        Estimates at the states 0 .. T.
    pullback : callable
        ``pullback(t, costate)``: F(t)^T costate, shape (N, p).
    """
    G, g = V[-1], dVdx[-1]
    values, gradients = [], []
    for t in range(len(r) - 1, -1, -1):
        G = value_target(r[t], lookahead(V[t + 1], G, s_lambda, dt), s_gamma, dt)
        g = costate(drdx[t], pullback(t, lookahead(dVdx[t + 1], g, s_lambda, dt)), s_gamma, dt)
        values.append(G)
        gradients.append(g)
    return Targets(torch.stack(values[::-1]), torch.stack(gradients[::-1]))


def huber(dVdx: Tensor, g: Tensor, slope_weights: Tensor, most: float, dim: int = -1) -> Tensor:
    """The targets g, moved towards dVdx where their error is more than ``most`` times the mean one.

    Half the gradient of a squared error is the error, that of Huber's loss the error cut to a largest size (Huber 1964,
    doi:10.1214/aoms/1177703732); here the target is cut, once a round.

    Parameters
    ----------
    dVdx, g : Tensor
        Estimates and targets, components along ``dim``.
    slope_weights : Tensor, shape (p,)
        w S_i^2: sizes are those in the loss.
    most : float
        In mean sizes of all errors.
    """
    error = g - dVdx
    along = [1] * error.ndim
    along[dim] = -1
    size = (slope_weights.view(along) * error.square()).sum(dim, keepdim=True).sqrt()
    tiny = torch.finfo(size.dtype).tiny
    return dVdx + error * (most * size.mean() / size.clamp(min=tiny)).clamp(max=1)


def value_and_gradient_loss(
    V: Tensor, G: Tensor, dVdx: Tensor, g: Tensor, value_weight: float, slope_weights: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Mean of value_weight (V - G)^2 + sum_i slope_weights_i (dV/dx_i - g_i)^2; then of (V - G)^2, then of the sum."""
    value_error = (V - G).square().mean()
    slope_error = (slope_weights * (dVdx - g).square()).sum(-1).mean()
    return value_weight * value_error + slope_error, value_error, slope_error


def weight_of_round(k: int, share: float) -> float:
    """What round k, from 0 on, weighs in the average of the rounds so far: a / (k + a), a = 1 / share.

    Rounds then count in proportion to k^(a - 1): all alike with a share of 1, and with a small one as in a mean over
    the last ``share`` of them. Polynomial-decay averaging, Shamir and Zhang 2013 (arXiv:1212.1824).
    """
    return 1 / (k * share + 1)
