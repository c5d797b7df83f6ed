"""The Hamiltonian as a finite difference along the trajectory, beside dV/dx . f of equation 2.

:func:`swimmer_mj.learning.td.continuous_td.hamiltonian` is the form that the paper prints. Along a smooth piece of a
trajectory both agree to first order in dt. They part where V bends within a step, as it does on a ridge of V that
the greedy control switches across: dV/dx . f is the slope of the side where the step begins, the difference is what
the step really did to V.
"""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

__all__ = ["hamiltonian_by_difference", "second_order_term", "switches"]

Array = NDArray[np.float64]
T = TypeVar("T", float, Array)


def hamiltonian_by_difference(r: T, V: T, V_next: T, s_gamma: float, dt: float) -> T:
    """H = r - s_gamma V + (V(x(t + dt)) - V(x(t))) / dt.

    The discrete TD error over dt (Doya 2000, section 3, doi:10.1162/089976600300015961), here by the forward
    difference.
    """
    return r - s_gamma * V + (V_next - V) / dt


def second_order_term(dVdx_before: Array, dVdx_after: Array, f: Array) -> Array:
    """1/2 (dV/dx(x + f dt) - dV/dx(x)) . f, shape (...), of gradients and f of shape (..., p).

    What the difference form adds to dV/dx . f over an Euler step x + f dt, by the trapezoidal rule: the mean slope
    along the step less the slope at its start. Its error is O(dt^2) where V is smooth.
    """
    return 0.5 * ((dVdx_after - dVdx_before) * f).sum(axis=-1)


def switches(u: Array, u_next: Array) -> Array:
    """Number of components of the control that change from one step to the next, shape (...), of u (..., q)."""
    return (u != u_next).sum(axis=-1)
