"""What compiled code knows of a law, and what it notes when an evaluation of the law fails.

Any number of threads may fail at once: failures are counted, and one thread writes down where and how. What is
written stays until somebody asks for the next (:meth:`State.watch`).
"""

# pyright: reportAttributeAccessIssue=false, reportPrivateImportUsage=false, reportCallIssue=false
# (numba carries no types.)
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from swimmer_mj.compiled.pointers import fetch_add, load, store
from swimmer_mj.passive.site import N_NUMBERS, Site, site_of

__all__ = [
    "LENGTH",
    "NOT_A_SITE",
    "NOT_FINITE",
    "NO_PARAMETERS",
    "RAISED",
    "STATE",
    "WRONG_SHAPE",
    "Failure",
    "State",
    "note",
]

RAISED, LENGTH, NOT_FINITE, NOT_A_SITE, WRONG_SHAPE, NO_PARAMETERS = range(1, 7)
"""Kinds of failures: the first three of the law, the others of a model's declaration of it."""

STATE = np.dtype(
    [
        ("address", np.int64),  # of this record
        ("law", np.int64),  # the address of the law's code
        ("name", np.int64),  # the address of the law's name
        ("n_name", np.int64),
        ("n_parameters", np.int64),
        ("shape", np.int64),  # the type that sites must have; -1 for any
        ("count", np.int64),  # of failures so far
        ("since", np.int64),  # a failure with a number below this may be written over
        ("writing", np.int64),  # threads that write a failure down, or would
        ("number", np.int64),  # of the failure written down; -1 for none
        ("kind", np.int64),
        ("element", np.int64),  # of the tuple
        ("texts", np.int64),  # the address of three names of TEXT bytes each: model, tuple, site
        ("inputs", np.int64),  # the address of the numbers that the law was called with: site, parameters
    ]
)
_OFFSETS = {name: field[1] for name, field in (STATE.fields or {}).items()}
_COUNT, _WRITING = _OFFSETS["count"], _OFFSETS["writing"]

_TEXT = 64


class Failure(NamedTuple):
    """One failed evaluation."""

    kind: int
    element: int
    """Of the tuple, from 0."""
    model: str
    tuple: str
    site: str
    """Empty if the element is none."""
    inputs: tuple[Site, list[float]]
    """What the law was called with, if it was."""


class State:
    """The memory of one law that compiled code reads and writes; it must outlive all evaluations.

    Parameters
    ----------
    law : int
        Address of the law's code (:func:`~swimmer_mj.passive.compilation.address`).
    name : str
        The law's name.
    n_parameters : int
    shape : int
        Type that the law's sites must have, of ``mujoco.mjtGeom``; -1 for any.
    """

    def __init__(self, law: int, name: str, n_parameters: int, shape: int) -> None:
        self._name = np.frombuffer(name.encode(), dtype=np.uint8)
        self._texts = np.zeros((3, _TEXT), dtype=np.uint8)
        self._inputs = np.zeros(N_NUMBERS + n_parameters)
        self._state = state = np.zeros(1, dtype=STATE)
        self.address: int = state.ctypes.data
        """Where the record of type :data:`STATE` is."""
        state["address"], state["law"] = self.address, law
        state["name"], state["n_name"] = self._name.ctypes.data, self._name.size
        state["n_parameters"], state["shape"], state["number"] = n_parameters, shape, -1
        state["texts"], state["inputs"] = self._texts.ctypes.data, self._inputs.ctypes.data
        self._count, self._since = (state[name] for name in ("count", "since"))  # views, quick to read

    @property
    def count(self) -> int:
        """Number of evaluations that have failed."""
        return int(self._count[0])

    def watch(self) -> int:
        """Have the next failure written down, whichever was before; :attr:`count`."""
        count = self.count
        self._since[0] = count
        return count

    def failure(self, since: int) -> Failure | None:
        """The failure that was written down; None if none was whose number is at least ``since``."""
        state = self._state[0]
        if state["number"] < since or state["writing"] != 0:
            return None
        names = (bytes(text).split(b"\0")[0].decode(errors="replace") for text in self._texts)
        numbers = self._inputs.tolist()
        inputs = site_of(numbers[:N_NUMBERS]), numbers[N_NUMBERS:]
        return Failure(int(state["kind"]), int(state["element"]), *names, inputs)


@njit
def _copy_name(m: Any, start: int, to: int) -> None:
    for c in range(_TEXT):
        letter = load(np.uint8, m.names, start + c, m.nnames)
        store(np.uint8, to, c, _TEXT, letter)
        if letter == 0:
            return


@njit
def _copy_numbers(source: int, n: int, to: int) -> None:
    for i in range(n):
        store(np.float64, to, i, n, load(np.float64, source, i, n))


@njit
def note(s: Any, kind: int, element: int, m: Any, names: tuple[int, int], site: int, parameters: int) -> None:
    """Count a failure, and write it down if none has been since :meth:`State.watch`.

    Parameters
    ----------
    s, m
        Records of the law (:data:`STATE`) and of mjModel.
    kind, element : int
        As in :class:`Failure`.
    names : tuple of int
        Where the names of the tuple and of the site start among the model's, whose own comes first.
    site, parameters : int
        Addresses of what the law was called with; 0 if it was not.
    """
    number = fetch_add(s.address + _COUNT, 1)
    if fetch_add(s.address + _WRITING, 1) == 0 and s.number < s.since:
        s.kind, s.element = kind, element
        _copy_name(m, 0, s.texts)
        _copy_name(m, names[0], s.texts + _TEXT)
        _copy_name(m, names[1], s.texts + 2 * _TEXT)
        if site != 0:
            _copy_numbers(site, N_NUMBERS, s.inputs)
            _copy_numbers(parameters, s.n_parameters, s.inputs + 8 * N_NUMBERS)
        s.number = number
    fetch_add(s.address + _WRITING, -1)
