"""The swimmer as numba functions of one state, for the fused kernel."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.elementary import cos_sin
from swimmer_mj.learning.problems.forms import CompiledForm
from swimmer_mj.learning.problems.swim.reduced import compile_reduced_dynamics, reduced_constants
from swimmer_mj.learning.problems.swim.swimming import RATE_SCALE, TURN, Swimming

__all__ = ["make"]

Array = NDArray[np.float64]


def make(problem: Swimming) -> CompiledForm | None:
    """The swimmer, stepped by the reduced equations; None with V of joints, or with torques chosen to be held."""
    if problem.coordinates != "links" or problem.held:
        return None
    n = problem.parameters.n_links
    functions = _compiled_functions(n, problem.encoding)
    return CompiledForm(reduced_constants(problem.parameters), compile_reduced_dynamics(n), *functions)


@lru_cache(maxsize=16)
def _compiled_functions(n: int, encoding: str) -> tuple[Any, Any, Any]:
    @njit(error_model="numpy")
    def reward(constants: Any, x: Array) -> float:
        return x[2 * n]

    @njit(error_model="numpy")
    def inputs(x: Array, z: NDArray[Any]) -> None:
        for i in range(n):
            z[i], z[n + i] = cos_sin(x[i])
            z[2 * n + i] = RATE_SCALE * x[n + i]
        z[3 * n] = x[2 * n]
        z[3 * n + 1] = x[2 * n + 1]

    @njit(error_model="numpy")
    def input_pullback(z: NDArray[Any], dVdz: NDArray[Any], dVdx: Array) -> None:
        for i in range(n):
            dVdx[i] = z[i] * dVdz[n + i] - z[n + i] * dVdz[i]
            dVdx[n + i] = RATE_SCALE * dVdz[2 * n + i]
        dVdx[2 * n] = dVdz[3 * n]
        dVdx[2 * n + 1] = dVdz[3 * n + 1]

    wraps = encoding == "angle"

    @njit(error_model="numpy")
    def angle_inputs(x: Array, z: NDArray[Any]) -> None:
        for i in range(n):
            z[i] = x[i] - TURN * np.rint(x[i] / TURN) if wraps else x[i]
            z[n + i] = RATE_SCALE * x[n + i]
        z[2 * n] = x[2 * n]
        z[2 * n + 1] = x[2 * n + 1]

    @njit(error_model="numpy")
    def angle_pullback(z: NDArray[Any], dVdz: NDArray[Any], dVdx: Array) -> None:
        for i in range(n):
            dVdx[i] = dVdz[i]
            dVdx[n + i] = RATE_SCALE * dVdz[n + i]
        dVdx[2 * n] = dVdz[2 * n]
        dVdx[2 * n + 1] = dVdz[2 * n + 1]

    return (
        (reward, inputs, input_pullback) if encoding == "circle" else (reward, angle_inputs, angle_pullback)
    )
