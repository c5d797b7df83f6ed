"""The greedy control where a control is held for a while: it is chosen for where it leads, not for the instant.

The greedy control of the instant maximises the Hamiltonian, r + dV/dx . f(x, u). Where dynamics are affine in u that is
a control at its limits, as if it could be changed at any time. Held for h seconds, a strong one oversteps: V falls
again before it ends. What is to be maximised then is, as in the discrete-time optimality equation,

    -h sum_i c_i u_i^2 + e^{-s_gamma h} V(y(u)),     y(u) = coast + sum_i gain_i u_i,

with y(u) the state at the end. As h goes to 0, its argmax goes to that of the Hamiltonian.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.vectors import OPTIONS

__all__ = ["Memory", "Slope", "held_control", "share_of_way"]

Array = NDArray[np.float64]

Slope = Callable[[Array], Array]
"""dV/dx (p, N) at x (p, N)."""

REACHES = (1.0, 0.5)
"""How far a control is pushed to find the curvature, as a share of its limit, in each model after the other."""

SWEEPS = 10
"""Of coordinate ascent, if there is more than one coordinate."""

CLEAR, SHORT = 1e-3, 1e-6
"""A change of slope that the curvature did not foresee counts if its cosine with the way is more than the one, and the
way, in shares of the limits, longer than the other: what is found on shorter ones is V's rounding."""


@dataclass
class Memory:
    """What one choice leaves to the next along the same trajectories; nothing before the first."""

    u: Array | None = None
    """What was chosen, (q, N)."""
    curvature: Array | None = None
    """Of what is maximised, in u, (q, q, N)."""


@np.errstate(invalid="ignore", over="ignore")  # of trajectories that have run away
def held_control(
    slope_at: Slope, coast: Array, gain: Array, limits: Array, price: Array, memory: Memory | None = None
) -> Array:
    """argmax over abs(u_i) <= limits_i of V(coast + gain u) - sum_i price_i u_i^2, by quadratic models of it.

    The first model has the slope in u at u = 0. Its curvature is what the slope changes by where one control after the
    other goes to the limit to which it points. Towards its argmax u goes as far as the slope at both ends of that way
    says (:func:`share_of_way`). The second model is made alike there, by half as long pushes. So V's slope is asked for
    2 q + 4 times, and the result is exact for a quadratic V that is concave.

    With a ``memory`` that is not empty there is one model, at what was chosen before and with the curvature of then,
    and V's slope is asked for twice. The curvature learns what the slope at the end of the way says of it. Along a
    trajectory, where little changes from control to control, that does as well.

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
    memory : Memory, optional
        Of the choice before along these trajectories; it is brought up to date.

    Returns
    -------
    ndarray, shape (q, N)
    """
    end = np.empty_like(coast)

    def slope(u: Array) -> Array:
        _lead(coast, gain, u, end)
        out = np.empty_like(u)
        _project(gain, np.ascontiguousarray(slope_at(end)), price, u, out)
        return out

    if memory is None or memory.u is None or memory.curvature is None:
        u, curvature = _from_nothing(slope, limits, coast.shape[1])
    else:
        u, curvature = _from_before(slope, limits, memory.u, memory.curvature)
    if memory is not None:
        memory.u, memory.curvature = u.copy(), curvature
    return u


def _from_nothing(slope: Callable[[Array], Array], limits: Array, N: int) -> tuple[Array, Array]:
    """The control and the curvature there, given the slope in u (q, N)."""
    q = len(limits)
    u, curvature = np.zeros((q, N)), np.zeros((q, q, N))
    for reach in REACHES:
        here = slope(u)
        for i, U in enumerate(limits):
            push = reach * np.where(here[i] < 0, -U, U)
            np.negative(push, out=push, where=np.abs(u[i] + push) > U)
            pushed = u.copy()
            pushed[i] += push
            curvature[i] = (slope(pushed) - here) / push
        curvature = (curvature + curvature.swapaxes(0, 1)) / 2
        way = _to_the_top(here, curvature, limits, u)
        u += share_of_way(here, slope(u + way), way) * way
    return u, curvature


def _from_before(
    slope: Callable[[Array], Array], limits: Array, before: Array, curvature: Array
) -> tuple[Array, Array]:
    """As :func:`_from_nothing`, from what they were ``before``."""
    here = slope(before)
    way = _to_the_top(here, curvature, limits, before)
    there = slope(before + way)
    u, curvature = before + share_of_way(here, there, way) * way, curvature.copy()
    _correct(curvature, way, there - here, limits)
    return u, curvature


def _to_the_top(here: Array, curvature: Array, limits: Array, u: Array) -> Array:
    """From u (q, N) to the argmax of the model with the slope ``here`` and that curvature, (q, N)."""
    top = u.copy()
    _argmax_in_box(here - (curvature * u).sum(axis=1), curvature, limits, top)
    return top - u


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


@entry_point(**OPTIONS)
def _correct(curvature: Array, way: Array, change: Array, limits: Array) -> None:
    """Let the curvature (q, q, N) say how the slope changes (q, N) on a way (q, N): symmetric, of rank one.

    SR1: Nocedal and Wright 2006, doi:10.1007/978-0-387-40065-5, equation 6.24, with the safeguard 6.26.
    """
    q = way.shape[0]
    unforeseen = np.empty(q)
    for b in range(way.shape[1]):
        along = size = length = share = 0.0
        for i in range(q):
            unforeseen[i] = change[i, b]
            for k in range(q):
                unforeseen[i] -= curvature[i, k, b] * way[k, b]
            along += unforeseen[i] * way[i, b]
            size += unforeseen[i] ** 2
            length += way[i, b] ** 2
            share += (way[i, b] / limits[i]) ** 2
        if share > SHORT**2 and abs(along) > CLEAR * np.sqrt(size * length):  # which NaN is not
            for i in range(q):
                for k in range(q):
                    curvature[i, k, b] += unforeseen[i] * unforeseen[k] / along
