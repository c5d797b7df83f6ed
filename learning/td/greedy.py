"""Greedy control in compiled code, and episodes under it: what the learners of this folder share."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.vectors import OPTIONS

__all__ = ["decide", "hold_for_a_step"]

Array = NDArray[np.float64]


@njit(forceinline=True, **OPTIONS)
def decide(limits: Array, dVdx: Array, a: Array, B: Array, u: Array, f: Array) -> float:
    """Fill the greedy control u = U sign(B^T dV/dx) and f = a + B u; returns dV/dx . f."""
    p, q = B.shape
    rate = 0.0
    for i in range(p):
        f[i] = a[i]
        rate += a[i] * dVdx[i]
    for k in range(q):
        slope = 0.0
        for i in range(p):
            slope += B[i, k] * dVdx[i]
        u[k] = limits[k] if slope > 0 else (-limits[k] if slope < 0 else 0.0)
        rate += u[k] * slope
        for i in range(p):
            f[i] += u[k] * B[i, k]
    return rate


@njit(**OPTIONS)
def hold_for_a_step(
    form: Any,
    constants: Any,
    limits: Array,
    dVdx: Array,
    x: Array,
    a: Array,
    B: Array,
    u: Array,
    f: Array,
    t: float,
    dt: float,
    s_gamma: float,
) -> tuple[float, float]:
    """From x(t) to x(t + dt) by the classical Runge-Kutta method, the greedy control at x(t) being held.

    Returns the mean of r over the step and the integral of exp(-s_gamma t) r, by the same method.
    """
    p, q = B.shape
    start, increment = x.copy(), np.zeros(p)
    mean = discounted = 0.0
    for stage in range(4):
        form.dynamics(constants, x, a, B)
        r = form.reward(constants, x)
        if stage == 0:
            decide(limits, dVdx, a, B, u, f)
        else:
            for i in range(p):
                f[i] = a[i]
                for k in range(q):
                    f[i] += B[i, k] * u[k]
        share = (1.0 if stage in (0, 3) else 2.0) / 6.0
        fraction = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)  # of dt, of this stage
        following = 1.0 if stage == 2 else 0.5  # of dt, of the next
        mean += share * r
        discounted += share * dt * math.exp(-s_gamma * (t + dt * fraction)) * r
        for i in range(p):
            increment[i] += share * f[i]
            x[i] = start[i] + dt * (increment[i] if stage == 3 else following * f[i])
    return mean, discounted
