"""One step of dx/dt = f(x) with a fixed step size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__all__ = ["euler_step", "rk4_step"]

Array = NDArray[np.float64]


def euler_step(f: Callable[[Array], Array], x: Array, dt: float) -> Array:
    """x(t + dt) to first order: the integrator of section 4."""
    return x + dt * f(x)


def rk4_step(f: Callable[[Array], Array], x: Array, dt: float) -> Array:
    """x(t + dt) to fourth order, by the classical Runge-Kutta method."""
    k1 = f(x)
    k2 = f(x + dt / 2 * k1)
    k3 = f(x + dt / 2 * k2)
    k4 = f(x + dt * k3)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
