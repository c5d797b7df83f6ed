"""The swimmer for a pack of learners: one state in each lane of a SIMD vector.

The equations are those of :mod:`swimmer_mj.learning.problems.swim.batched_equations`, the encoding is that of
:class:`swimmer_mj.learning.problems.swim.swimming.Swimming`.
"""

# pyright: reportCallIssue=false
# numba gives its intrinsics their first argument, the typing context, itself.

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from swimmer_mj.compiled.elementary import cos_sin_of_lanes
from swimmer_mj.compiled.vectors import LANES, OPTIONS, convert, load, nearest, store
from swimmer_mj.learning.problems.forms import LanesForm
from swimmer_mj.learning.problems.swim.batched_equations import derivative_of_lanes, workspace
from swimmer_mj.learning.problems.swim.reduced import reduced_constants
from swimmer_mj.learning.problems.swim.swimming import RATE_SCALE, TURN, Swimming

__all__ = ["make"]

Array = NDArray[np.float64]
Real = NDArray[Any]


def make(problem: Swimming) -> LanesForm | None:
    """The swimmer for a pack; None if it has to be asked for one state at a time."""
    if problem.integrator != "euler" or problem.coordinates != "links" or problem.held:
        return None
    constants = (workspace(problem.parameters.n_links), reduced_constants(problem.parameters))
    return LanesForm(constants, _greedy, *_ENCODINGS[problem.encoding])


@njit(**OPTIONS)
def _greedy(constants: Any, limits: Array, x: Array, dVdx: Array, u: Array, f: Array, r: Array) -> None:
    ws, parameters = constants
    derivative_of_lanes(ws, parameters, limits, x, dVdx, u, f)
    n = parameters.K.shape[0]
    store(r, 0, load(x, 2 * n * LANES))


@njit(**OPTIONS)
def _encode(constants: Any, x: Array, z: Real, start: int) -> None:
    n = constants[1].K.shape[0]
    real = z[0, 0, 0]
    for i in range(n):
        cosine, sine = cos_sin_of_lanes(load(x, i * LANES))
        store(z, start + i * LANES, convert(cosine, real))
        store(z, start + (n + i) * LANES, convert(sine, real))
        store(z, start + (2 * n + i) * LANES, convert(RATE_SCALE * load(x, (n + i) * LANES), real))
    store(z, start + 3 * n * LANES, convert(load(x, 2 * n * LANES), real))
    store(z, start + (3 * n + 1) * LANES, convert(load(x, (2 * n + 1) * LANES), real))


@njit(**OPTIONS)
def _pull_back(constants: Any, z: Real, start: int, dVdz: Real, dVdx: Array) -> None:
    n = constants[1].K.shape[0]
    double = dVdx[0]
    for i in range(n):
        cosine, sine = load(z, start + i * LANES), load(z, start + (n + i) * LANES)
        turn = cosine * load(dVdz, (n + i) * LANES) - sine * load(dVdz, i * LANES)
        store(dVdx, i * LANES, convert(turn, double))
        store(dVdx, (n + i) * LANES, RATE_SCALE * convert(load(dVdz, (2 * n + i) * LANES), double))
    store(dVdx, 2 * n * LANES, convert(load(dVdz, 3 * n * LANES), double))
    store(dVdx, (2 * n + 1) * LANES, convert(load(dVdz, (3 * n + 1) * LANES), double))


@njit(**OPTIONS)
def _encode_unwrapped(constants: Any, x: Array, z: Real, start: int) -> None:
    n = constants[1].K.shape[0]
    real = z[0, 0, 0]
    for i in range(n):
        store(z, start + i * LANES, convert(load(x, i * LANES), real))
        store(z, start + (n + i) * LANES, convert(RATE_SCALE * load(x, (n + i) * LANES), real))
    store(z, start + 2 * n * LANES, convert(load(x, 2 * n * LANES), real))
    store(z, start + (2 * n + 1) * LANES, convert(load(x, (2 * n + 1) * LANES), real))


@njit(**OPTIONS)
def _encode_wrapped(constants: Any, x: Array, z: Real, start: int) -> None:
    _encode_unwrapped(constants, x, z, start)
    for i in range(constants[1].K.shape[0]):
        theta = load(x, i * LANES)
        store(z, start + i * LANES, convert(theta - TURN * nearest(theta / TURN), z[0, 0, 0]))


@njit(**OPTIONS)
def _pull_back_angles(constants: Any, z: Real, start: int, dVdz: Real, dVdx: Array) -> None:
    n = constants[1].K.shape[0]
    double = dVdx[0]
    for i in range(n):
        store(dVdx, i * LANES, convert(load(dVdz, i * LANES), double))
        store(dVdx, (n + i) * LANES, RATE_SCALE * convert(load(dVdz, (n + i) * LANES), double))
    store(dVdx, 2 * n * LANES, convert(load(dVdz, 2 * n * LANES), double))
    store(dVdx, (2 * n + 1) * LANES, convert(load(dVdz, (2 * n + 1) * LANES), double))


_ENCODINGS = {
    "circle": (_encode, _pull_back),
    "angle": (_encode_wrapped, _pull_back_angles),
    "unwrapped": (_encode_unwrapped, _pull_back_angles),
}
