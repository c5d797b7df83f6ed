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

__all__ = ["Slope", "held_control"]

Array = NDArray[np.float64]

Slope = Callable[[Array], Array]
"""dV/dx (p, N) at x (p, N)."""


def held_control(slope_at: Slope, coast: Array, gain: Array, limits: Array, price: Array) -> Array:
    """argmax over abs(u_i) <= limits_i of V(coast + gain u) - sum_i price_i u_i^2, by one secant step from u = 0.

    The first guess is greedy for the slope at the end of coasting. Where the slope that it leads to says that a control
    was too much, the share is taken at which the slope in it, were V quadratic, is 0: exact for one control and a
    quadratic V.

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
    U = limits[:, None]
    worth = (gain * slope_at(coast)).sum(axis=1)
    u = U * np.sign(worth)
    np.divide(worth, 2 * price, out=u, where=price > 0)
    u = np.clip(u, -U, U)
    left = (gain * slope_at(coast + (gain * u[:, None]).sum(axis=0))).sum(axis=1) - 2 * price * u
    share = np.ones_like(u)
    np.divide(worth, worth - left, out=share, where=worth * left < 0)
    return share * u
