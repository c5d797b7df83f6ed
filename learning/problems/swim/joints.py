"""The coordinates of MuJoCo's joints: angles between links, and the velocity of the head in place of the centre's.

Of a reduced state x = (theta, theta', G') they are y = (theta_1, theta_i - theta_{i-1}, the same of theta', A0'), with
A0 the free end of the first link. With levers a_i (:func:`swimmer_mj.state.center_of_mass_levers`), from A.1::

    A0' = G' - sum_i a_i theta'_i (-sin theta_i, cos theta_i)

V learned in them swims faster in the end than V of the state itself: docs/beyond.md. Slopes go over by the transposed
Jacobian dy/dx, or its inverse.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from torch import Tensor, cat, cos, sin

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.elementary import cos_sin_of_lanes
from swimmer_mj.compiled.vectors import LANES, OPTIONS, load, store
from swimmer_mj.learning.problems.forms import BatchCoordinates, CoordinatesForm, Encoding
from swimmer_mj.learning.problems.swim.swimming import Swimming
from swimmer_mj.state import center_of_mass_levers

__all__ = ["batch_coordinates", "encoding", "enter", "make", "to_slope_in_joints", "to_slope_in_state"]

Array = NDArray[np.float64]

RATE_SCALE = 0.7
"""Of the rates of joints, as network inputs, s: so that they are of order one where it is learned (found in runs)."""
VELOCITY_SCALE = 1.7
"""Of the head's velocity, s/m."""


def make(problem: Swimming) -> CoordinatesForm | None:
    """The coordinates in torch; None if V is learned in the state's own."""
    if problem.coordinates != "joints":
        return None
    n, levers = problem.parameters.n_links, center_of_mass_levers(problem.parameters)

    def swing(theta: Tensor, omega: Tensor) -> Tensor:
        """G' - A0'."""
        rates = omega * omega.new_tensor(levers)
        return cat([-(rates * sin(theta)).sum(-1, True), (rates * cos(theta)).sum(-1, True)], dim=-1)

    def enter(x: Tensor) -> Tensor:
        theta, omega, velocity = x[..., :n], x[..., n : 2 * n], x[..., 2 * n :]
        bends = [cat([y[..., :1], y.diff(dim=-1)], dim=-1) for y in (theta, omega)]
        return cat([*bends, velocity - swing(theta, omega)], dim=-1)

    def leave(y: Tensor) -> Tensor:
        theta, omega = y[..., :n].cumsum(-1), y[..., n : 2 * n].cumsum(-1)
        return cat([theta, omega, y[..., 2 * n :] + swing(theta, omega)], dim=-1)

    def encode(y: Tensor) -> Tensor:
        code = encoding(n)
        angles = y[..., :n]
        return cat([cos(angles), sin(angles), y[..., n:] * y.new_tensor(code.scale)], dim=-1)

    return CoordinatesForm(enter, leave, encode)


def encoding(n: int) -> Encoding:
    """How the coordinates of n links enter a network."""
    angles, linear = np.arange(n), np.arange(n, 2 * n + 2)
    scale = np.array([RATE_SCALE] * n + [VELOCITY_SCALE] * 2)
    return Encoding(angles, angles, n + angles, linear, linear + n, scale)


def batch_coordinates(problem: Swimming) -> BatchCoordinates | None:
    """The coordinates, compiled; None if V is learned in the state's own."""
    if problem.coordinates != "joints":
        return None
    levers = center_of_mass_levers(problem.parameters)
    return BatchCoordinates(
        partial(enter, levers), partial(to_slope_in_state, levers), partial(to_slope_in_joints, levers)
    )


@entry_point(**OPTIONS)
def enter(levers: Array, x: Array, y: Array) -> None:
    """Fill y (p, N) with the coordinates of the states x (p, N); N is a multiple of LANES."""
    n, N = levers.size, x.shape[1]
    for b in range(0, N, LANES):
        forward, sideways = load(x, 2 * n * N + b), load(x, (2 * n + 1) * N + b)
        for i in range(n):
            angle, rate = load(x, i * N + b), load(x, (n + i) * N + b)
            c, s = cos_sin_of_lanes(angle)
            forward = forward + (levers[i] * rate) * s
            sideways = sideways - (levers[i] * rate) * c
            if i > 0:
                angle, rate = angle - load(x, (i - 1) * N + b), rate - load(x, (n + i - 1) * N + b)
            store(y, i * N + b, angle)
            store(y, (n + i) * N + b, rate)
        store(y, 2 * n * N + b, forward)
        store(y, (2 * n + 1) * N + b, sideways)


@entry_point(**OPTIONS)
def to_slope_in_state(levers: Array, x: Array, slope: Array) -> None:
    """Replace dV/dy by dV/dx, (p, N), at the states x (p, N); N is a multiple of LANES."""
    n, N = levers.size, x.shape[1]
    for b in range(0, N, LANES):
        gx, gy = load(slope, 2 * n * N + b), load(slope, (2 * n + 1) * N + b)
        for i in range(n):
            c, s = cos_sin_of_lanes(load(x, i * N + b))
            rate = load(x, (n + i) * N + b)
            turn = load(slope, i * N + b) + (levers[i] * rate) * (c * gx + s * gy)
            spin = load(slope, (n + i) * N + b) + levers[i] * (s * gx - c * gy)
            if i + 1 < n:
                turn = turn - load(slope, (i + 1) * N + b)
                spin = spin - load(slope, (n + i + 1) * N + b)
            store(slope, i * N + b, turn)
            store(slope, (n + i) * N + b, spin)


@entry_point(**OPTIONS)
def to_slope_in_joints(levers: Array, x: Array, slope: NDArray[Any]) -> None:
    """Replace dV/dx by dV/dy, (T, p, N), at the states x (T, p, N)."""
    n = levers.size
    for t in range(slope.shape[0]):
        for i in range(n - 1, -1, -1):
            for b in range(slope.shape[2]):
                gx, gy = slope[t, 2 * n, b], slope[t, 2 * n + 1, b]
                c, s = math.cos(x[t, i, b]), math.sin(x[t, i, b])
                turn = slope[t, i, b] - levers[i] * x[t, n + i, b] * (c * gx + s * gy)
                spin = slope[t, n + i, b] - levers[i] * (s * gx - c * gy)
                if i + 1 < n:
                    turn += slope[t, i + 1, b]
                    spin += slope[t, n + i + 1, b]
                slope[t, i, b], slope[t, n + i, b] = turn, spin
