"""The pendulum as numba functions of one state, for the fused kernel."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.learning.problems.forms import CompiledForm
from swimmer_mj.learning.problems.pendulum.pendulum import RATE_SCALE, Constants, Pendulum

__all__ = ["make"]

Array = NDArray[np.float64]


def make(problem: Pendulum) -> CompiledForm | None:
    """The pendulum for the fused kernel."""
    return CompiledForm(problem.constants, *_compiled_functions())


@lru_cache(maxsize=1)
def _compiled_functions() -> tuple[Any, Any, Any, Any]:
    @njit(error_model="numpy")
    def dynamics(constants: Constants, x: Array, a: Array, B: Array) -> None:
        a[0] = x[1]
        a[1] = (constants.weight_moment * math.sin(x[0]) - constants.damping * x[1]) / constants.inertia
        B[1, 0] = 1.0 / constants.inertia

    @njit(error_model="numpy")
    def reward(constants: Constants, x: Array) -> float:
        return math.cos(x[0])

    @njit(error_model="numpy")
    def inputs(x: Array, z: NDArray[Any]) -> None:
        z[0] = math.cos(x[0])
        z[1] = math.sin(x[0])
        z[2] = RATE_SCALE * x[1]

    @njit(error_model="numpy")
    def input_pullback(z: NDArray[Any], dVdz: NDArray[Any], dVdx: Array) -> None:
        dVdx[0] = z[0] * dVdz[1] - z[1] * dVdz[0]
        dVdx[1] = RATE_SCALE * dVdz[2]

    return dynamics, reward, inputs, input_pullback
