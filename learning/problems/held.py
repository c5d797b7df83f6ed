"""The greedy control where a control is held for a while: it is chosen for where it leads, not for the instant.

The greedy control of the instant maximises the Hamiltonian, r + dV/dx . f(x, u). Where dynamics are affine in u that is
a control at its limits, as if it could be changed at any time. Held for h seconds, a strong one oversteps: V falls
again before it ends. What is to be maximised then is, as in the discrete-time optimality equation,

    -h sum_i c_i u_i^2 + e^{-s_gamma h} V(y(u)),     y(u) = coast + sum_i gain_i u_i,

with y(u) the state at the end. As h goes to 0, its argmax goes to that of the Hamiltonian.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["Slope", "argmax_in_box", "held_control"]

Array = NDArray[np.float64]

Slope = Callable[[Array], Array]
"""dV/dx (p, N) at x (p, N)."""

SWEEPS = 10
"""Of coordinate ascent, if there is more than one coordinate."""


def held_control(slope_at: Slope, coast: Array, gain: Array, limits: Array, price: Array) -> Array:
    """argmax over abs(u_i) <= limits_i of V(coast + gain u) - sum_i price_i u_i^2, by a quadratic model of it.

    The model has the slope in u at u = 0. Its curvature is what the slope changes by where one control after the other
    goes to the limit to which it points. So V's slope is asked for q + 1 times, and the result is exact for a quadratic
    V that is concave.

    Parameters
    ----------
    slope_at : callable
        dV/dx (p, N) at x (p, N).
    coast : ndarray, shape (p, N)
        The state at the end of the hold without control.
    gain : ndarray, shape (q, p, N)
        What a unit of each control adds to it.
    limits : ndarray, shape (q,)
        U.
    price : ndarray, shape (q, N)
        c >= 0, for the whole hold, in units of V at its end.

    Returns
    -------
    ndarray, shape (q, N)
    """
    q = len(limits)
    slope = (gain * slope_at(coast)).sum(axis=1)
    curvature = np.empty((q, *slope.shape))
    for i in range(q):
        push = np.where(slope[i] < 0, -limits[i], limits[i])
        curvature[i] = ((gain * slope_at(coast + gain[i] * push)).sum(axis=1) - slope) / push
        curvature[i, i] -= 2 * price[i]
    return argmax_in_box(slope, (curvature + curvature.swapaxes(0, 1)) / 2, limits)


def argmax_in_box(slope: Array, curvature: Array, limits: Array) -> Array:
    """argmax over abs(u_i) <= limits_i of slope . u + u . curvature u / 2, by coordinate ascent from u = 0.

    Exact for one control, and in the limit of many sweeps where the curvature is negative definite; elsewhere a point
    from which no control alone can improve.

    Parameters
    ----------
    slope : ndarray, shape (q, N)
    curvature : ndarray, shape (q, q, N)
        Symmetric.
    limits : ndarray, shape (q,)
        U.

    Returns
    -------
    ndarray, shape (q, N)
    """
    q, u = len(limits), np.zeros_like(slope)
    for _ in range(SWEEPS if q > 1 else 1):
        for i, U in enumerate(limits):
            bend = curvature[i, i]
            rest = slope[i] + (curvature[i] * u).sum(axis=0) - bend * u[i]
            best = U * np.sign(rest)
            np.divide(rest, -bend, out=best, where=bend < 0)
            u[i] = np.clip(best, -U, U)
    return u
