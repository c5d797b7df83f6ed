"""A law, compiled: a C function that reads a site and parameters from memory and writes a force and a moment."""

# pyright: reportAttributeAccessIssue=false, reportPrivateImportUsage=false, reportCallIssue=false
# (numba carries no types.)
from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit, typeof, types
from numba.core.errors import NumbaError, UnsupportedBytecodeError

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.pointers import attempt, load, load_vector, store_vector
from swimmer_mj.compiled.static import Static
from swimmer_mj.passive.failures import LENGTH, RAISED
from swimmer_mj.passive.site import N_NUMBERS, Site, site_of

__all__ = ["COMPILE_ERRORS", "address", "complaint"]

OPTIONS: dict[str, Any] = {"error_model": "numpy"}
"""How laws are compiled: a division by zero is infinite or no number, which is noticed, and raises nothing."""

COMPILE_ERRORS = (NumbaError, UnsupportedBytecodeError, AssertionError)
"""What numba raises of a function that it cannot compile."""


@entry_point(**OPTIONS, no_cpython_wrapper=True)
def act(form: Any, site: int, parameters: int, force_and_moment: int) -> int:
    """Evaluate the law ``form.function``.

    Parameters
    ----------
    form : Static
        Its ``function`` is the law.
    site, parameters : int
        Addresses of the law's arguments, :data:`~swimmer_mj.passive.site.N_NUMBERS` doubles and as many as it takes.
    force_and_moment : int
        Address of six doubles to be set.

    Returns
    -------
    int
        The kind of failure, of :mod:`~swimmer_mj.passive.failures`; 0 for none.
    """
    at = Site(
        load(np.float64, site, N_NUMBERS - 1, N_NUMBERS),
        load_vector(site, 0, 7),
        (load_vector(site, 1, 7), load_vector(site, 2, 7), load_vector(site, 3, 7)),
        load_vector(site, 4, 7),
        load_vector(site, 5, 7),
        load_vector(site, 6, 7),
    )
    raised, (force, moment) = attempt(form, at, parameters)
    if raised:
        return RAISED
    if len(force) != 3 or len(moment) != 3:
        return LENGTH
    store_vector(force_and_moment, 0, 2, (float(force[0]), float(force[1]), float(force[2])))
    store_vector(force_and_moment, 1, 2, (float(moment[0]), float(moment[1]), float(moment[2])))
    return 0


def address(function: Callable[..., Any]) -> int:
    """The address of :func:`act` for a law, as a C function of four pointers, the first of which is not looked at.

    It is there until the process ends.

    Raises
    ------
    COMPILE_ERRORS
        The law does not compile, or does not return a force and a moment; :func:`complaint` says it shortly.
    """
    form = Static(function=njit(**OPTIONS)(function))
    return act.address(typeof(form), types.int64, types.int64, types.int64)


def complaint(function: Callable[..., Any]) -> str:
    """What is wrong with a law that does not compile: numba's many lines in one, to follow the law's name."""
    law = njit(**OPTIONS)(function)
    n = len(inspect.signature(function).parameters) - 1
    arguments = (typeof(site_of([0.0] * N_NUMBERS)), *[types.float64] * n)
    try:
        law.compile(arguments)
    except COMPILE_ERRORS as error:
        lines = [line.strip() for line in re.sub(r"\x1b\[\d*m", "", str(error)).splitlines() if line.strip()]
        lines = lines or [f"{type(error).__name__} of numba"]
        reason, *rest = [line for line in lines if not line.startswith("Failed in ")]
        if reason.endswith(":") and rest:
            reason = f"{reason} {rest[0]}"
        where = re.search(r'File "(.*)", line (\d+)', str(error))
        place = f" ({Path(where[1]).name}, line {where[2]})" if where else ""
        return f"does not compile: {reason}{place}"
    returned = law.overloads[arguments].signature.return_type
    return f"must return a force and a moment, each of three numbers, but returns {returned}"
