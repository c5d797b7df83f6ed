"""One step of dx/dt = f(x) with a fixed step size; x is an array, of NumPy or of torch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

__all__ = ["euler_step", "rk4_step"]

Array = TypeVar("Array", bound=Any)


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
