"""MuJoCo's C functions by their addresses, to be called from compiled code."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import Any, NamedTuple

import mujoco

__all__ = ["OPTIONS", "Functions", "functions"]

OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
"""Of numba, for code that calls them."""


class Functions(NamedTuple):
    """Addresses; all functions take the model and the data first."""

    forward_skip: int
    """mj_forwardSkip(m, d, skipstage, skipsensor)."""
    integrate: int
    """mj_EulerSkip(m, d, skipfactor) or mj_implicitSkip(m, d, skipfactor)."""
    step: int
    """mj_step(m, d)."""
    solve_m: int
    """mj_solveM(m, d, x, y, n)."""


@functools.cache
def _library() -> ctypes.CDLL:
    """The shared library that the bindings have loaded already."""
    folder = Path(mujoco.__file__).parent
    found = [*folder.glob("libmujoco.so*"), *folder.glob("libmujoco*.dylib"), *folder.glob("mujoco.dll")]
    if not found:
        raise RuntimeError(f"MuJoCo {mujoco.__version__}: there is no shared library in {folder}")
    return ctypes.CDLL(str(found[0]))


def _address(name: str) -> int:
    return ctypes.cast(getattr(_library(), name), ctypes.c_void_p).value or 0


def functions(model: mujoco.MjModel) -> Functions:
    """The functions that step ``model``, which is not integrated by RK4."""
    kinds = mujoco.mjtIntegrator
    implicit = kinds(int(model.opt.integrator)) in (kinds.mjINT_IMPLICIT, kinds.mjINT_IMPLICITFAST)
    return Functions(
        _address("mj_forwardSkip"),
        _address("mj_implicitSkip" if implicit else "mj_EulerSkip"),
        _address("mj_step"),
        _address("mj_solveM"),
    )
