"""The statements of the motion, and the random swimmers and states they are compared at."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.analytic import AnalyticSwimmer
from swimmer_mj.dynamics import MujocoSwimmer
from swimmer_mj.mjcf import Friction
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.validation.arbiter import LagrangianSwimmer

__all__ = [
    "ARBITER",
    "EPS",
    "FRICTIONS",
    "STATEMENTS",
    "random_parameters",
    "random_states",
    "random_torques",
    "relative_error",
    "statements",
]

Array = NDArray[np.float64]

FRICTIONS: dict[str, Friction] = {"MuJoCo + callback": "callback", "MuJoCo + actuators": "actuators"}
"""How the statements by MuJoCo have their friction."""
STATEMENTS = ("A.3", *FRICTIONS)
ARBITER = "Lagrange"

EPS = float(np.finfo(np.float64).eps)
"""Precision of float64."""


def statements(parameters: SwimmerParameters) -> dict[str, Any]:
    """The three statements of a swimmer's dynamics and their arbiter, by name."""
    return {
        "A.3": AnalyticSwimmer(parameters),
        **{name: MujocoSwimmer(parameters, friction) for name, friction in FRICTIONS.items()},
        ARBITER: LagrangianSwimmer(parameters),
    }


def relative_error(actual: Array, expected: Array, n_axes: int = 1) -> Array:
    """|actual - expected| / |expected| in the Euclidean norm over the last ``n_axes`` axes."""
    axes = tuple(range(-n_axes, 0))
    difference = np.sqrt(((actual - expected) ** 2).sum(axis=axes))
    return difference / np.sqrt((expected**2).sum(axis=axes))


def random_parameters(
    rng: np.random.Generator, n_links: int, viscous_friction: float | None = None
) -> SwimmerParameters:
    """Draw a swimmer: m_i, l_i in [0.5, 2], k in [0, 20] unless given, U_i in [1, 10], SI units."""
    return SwimmerParameters(
        n_links=n_links,
        mass=rng.uniform(0.5, 2, n_links).tolist(),
        length=rng.uniform(0.5, 2, n_links).tolist(),
        viscous_friction=rng.uniform(0, 20) if viscous_friction is None else viscous_friction,
        torque_limit=rng.uniform(1, 10, n_links - 1).tolist(),
    )


def random_states(rng: np.random.Generator, n_links: int, size: int) -> Array:
    """Full states with angles in [-pi, pi], everything else in [-3, 3] SI units; shape (size, 2n + 4)."""
    x = rng.uniform(-3, 3, (size, st.full_size(n_links)))
    st.split(x, n_links).angles[:] = rng.uniform(-np.pi, np.pi, (size, n_links))
    return x


def random_torques(rng: np.random.Generator, parameters: SwimmerParameters, size: int) -> Array:
    """Torques within their limits, shape (size, n - 1)."""
    return rng.uniform(-1, 1, (size, parameters.n_links - 1)) * parameters.torque_limits
