"""MuJoCo's C functions by their addresses, to be called from compiled code."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings carry no types.)
from __future__ import annotations

import ctypes
import functools
from pathlib import Path
from typing import NamedTuple

import mujoco

__all__ = ["Functions", "functions"]


class Functions(NamedTuple):
    """Addresses; all functions take the model and the data first."""

    forward_skip: int
    """mj_forwardSkip(m, d, skipstage, skipsensor)."""
    integrate: int
    """mj_Euler(m, d), mj_implicit(m, d) or mj_RungeKutta(m, d, stages)."""
    stages: int
    """4 for the last, 0 for the others."""
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
    """The functions that step ``model``."""
    kinds = mujoco.mjtIntegrator
    name = {kinds.mjINT_EULER: "mj_Euler", kinds.mjINT_RK4: "mj_RungeKutta"}.get(
        kinds(int(model.opt.integrator)), "mj_implicit"
    )
    return Functions(
        _address("mj_forwardSkip"),
        _address(name),
        4 if name == "mj_RungeKutta" else 0,
        _address("mj_step"),
        _address("mj_solveM"),
    )
