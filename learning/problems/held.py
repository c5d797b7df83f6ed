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

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.vectors import OPTIONS

__all__ = ["Slope", "held_control", "share_of_way"]

Array = NDArray[np.float64]

Slope = Callable[[Array], Array]
"""dV/dx (p, N) at x (p, N)."""

REACHES = (1.0, 0.5)
"""How far a control is pushed to find the curvature, as a share of its limit, in each model after the other."""

SWEEPS = 10
"""Of coordinate ascent, if there is more than one coordinate."""


@np.errstate(invalid="ignore", over="ignore")  # of trajectories that have run away
def held_control(slope_at: Slope, coast: Array, gain: Array, limits: Array, price: Array) -> Array:
    """argmax over abs(u_i) <= limits_i of V(coast + gain u) - sum_i price_i u_i^2, by quadratic models of it.

    The first model has the slope in u at u = 0. Its curvature is what the slope changes by where one control after the
    other goes to the limit to which it points. Towards its argmax u goes as far as the slope at both ends of that way
    says (:func:`share_of_way`). The second model is made alike there, by half as long pushes. So V's slope is asked for
    2 q + 4 times, and the result is exact for a quadratic V that is concave.

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

    end = np.empty_like(coast)

    def slope(u: Array) -> Array:
        _lead(coast, gain, u, end)
        out = np.empty_like(u)
        _project(gain, np.ascontiguousarray(slope_at(end)), price, u, out)
        return out

    u = np.zeros((q, coast.shape[1]))
    for reach in REACHES:
        here, curvature = slope(u), np.empty((q, *u.shape))
        for i, U in enumerate(limits):
            push = reach * np.where(here[i] < 0, -U, U)
            np.negative(push, out=push, where=np.abs(u[i] + push) > U)
            pushed = u.copy()
            pushed[i] += push
            curvature[i] = (slope(pushed) - here) / push
        curvature = (curvature + curvature.swapaxes(0, 1)) / 2
        top = u.copy()
        _argmax_in_box(here - (curvature * u).sum(axis=1), curvature, limits, top)
        way = top - u
        u += share_of_way(here, slope(u + way), way) * way
    return u


def share_of_way(start: Array, end: Array, way: Array) -> Array:
    """How much of a way (q, N) to go, in [0, 1], (N,), given the slopes (q, N) at its start and at its end.

    All of it if it still goes up at its end; else to where the slope along it is 0 if it changes evenly.
    """
    rise, fall = np.maximum((start * way).sum(axis=0), 0.0), -(end * way).sum(axis=0)
    share = np.ones_like(rise)
    np.divide(rise, rise + fall, out=share, where=fall > 0)
    return share


@entry_point(**OPTIONS)
def _lead(coast: Array, gain: Array, u: Array, end: Array) -> None:
    """End = coast + sum_k gain_k u_k."""
    for i in range(coast.shape[0]):
        for b in range(coast.shape[1]):
            total = coast[i, b]
            for k in range(u.shape[0]):
                total += gain[k, i, b] * u[k, b]
            end[i, b] = total


@entry_point(**OPTIONS)
def _project(gain: Array, slope: Array, price: Array, u: Array, out: Array) -> None:
    """The slope in u of what has that slope in the state, less what u costs."""
    for k in range(u.shape[0]):
        for b in range(u.shape[1]):
            total = -2 * price[k, b] * u[k, b]
            for i in range(slope.shape[0]):
                total += gain[k, i, b] * slope[i, b]
            out[k, b] = total


@entry_point(**OPTIONS)
def _argmax_in_box(slope: Array, curvature: Array, limits: Array, u: Array) -> None:
    """Move u (q, N) to the argmax over abs(u_i) <= limits_i of slope . u + u . curvature u / 2, by coordinate ascent.

    Exact for one control, and in the limit of many sweeps where the curvature is negative definite; elsewhere a point
    from which no control alone can improve.

    Parameters
    ----------
    slope : ndarray, shape (q, N)
    curvature : ndarray, shape (q, q, N)
        Symmetric.
    limits : ndarray, shape (q,)
        U.
    u : ndarray, shape (q, N)
        From where it ascends, and then where it came to.
    """
    q = limits.size
    for _ in range(SWEEPS if q > 1 else 1):
        for i in range(q):
            for b in range(u.shape[1]):
                rest, bend = slope[i, b], curvature[i, i, b]
                for k in range(q):
                    if k != i:
                        rest += curvature[i, k, b] * u[k, b]
                best = -rest / bend if bend < 0 else np.sign(rest) * limits[i]
                u[i, b] = min(max(best, -limits[i]), limits[i])
