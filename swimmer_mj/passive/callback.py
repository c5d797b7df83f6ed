"""MuJoCo's passive callback, shared by all laws in force and by a callback that was installed before them.

MuJoCo has one for the whole process. It is installed for the first holder of a law and restored after the last. What
it runs stands in a table that is never changed: another holder makes another table, and one aligned store puts it in
the other's place, so that threads that are stepping need no lock. Laws run in the order of their names, so that
their sum does not depend on which came first.
"""

# pyright: reportAttributeAccessIssue=false, reportCallIssue=false
# (MuJoCo's bindings and numba carry no types.)
from __future__ import annotations

import ctypes
import functools
import os
import threading
from collections.abc import Callable
from typing import Any, Protocol

import llvmlite.binding
import mujoco
import numpy as np
from numba import types

from swimmer_mj.compiled.cache import entry_point
from swimmer_mj.compiled.pointers import call, load, load_symbol
from swimmer_mj.passive import evaluation
from swimmer_mj.passive.failures import State

__all__ = ["SharedCallback", "table"]

_SYMBOL = "swimmer_mj_passive_table"

_Table = np.ndarray[Any, np.dtype[np.int64]]
_CFunction = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)


@functools.cache
def _place() -> _Table:
    """The number at the symbol, shape (1,): the table's address."""
    place = np.zeros(1, dtype=np.int64)
    llvmlite.binding.add_symbol(_SYMBOL, place.ctypes.data)
    return place


@entry_point()
def _evaluate_table(model: Any, data: Any) -> None:
    """Call :func:`~swimmer_mj.passive.evaluation.evaluate`, the first entry of the table, with the table."""
    table = load_symbol(_SYMBOL)
    call(None, load(np.int64, table, 0, 1), (model, data, table))


def table(before: int, *states: int) -> _Table:
    """A table for :func:`~swimmer_mj.passive.evaluation.evaluate`."""
    return np.array([evaluation.address(), before, len(states), *states], dtype=np.int64)


class Holdable(Protocol):
    """What the callback asks of a law."""

    name: str
    holders: int
    """To be changed by the callback alone."""

    @property
    def state(self) -> State:
        """What its compiled code reads and writes."""
        ...


class SharedCallback:
    """The laws in force and their holders: the callback is installed for the first, restored after the last."""

    def __init__(self) -> None:
        # Re-entrant, because a garbage collection inside acquire() may run a holder's release().
        self.lock = threading.RLock()
        self._laws: list[Holdable] = []  # that have ever been in force
        self._changes = 0  # of the laws in force, so far
        self._settling = False
        self._tables: dict[
            tuple[int, ...], tuple[_Table, int]
        ] = {}  # all there ever were, with their addresses
        self._installed: Callable[..., None] | None = None
        self._previous: Callable[..., None] | None = None
        self._before = 0  # the address of what was installed before, if it is compiled
        # A process forked by another thread inside acquire() would find the lock taken for ever.
        os.register_at_fork(
            before=self.lock.acquire, after_in_parent=self.lock.release, after_in_child=self.lock.release
        )

    @functools.cached_property
    def _compiled(self) -> Any:
        self._put([])  # which gives the symbol an address
        return _CFunction(_evaluate_table.address(types.voidptr, types.voidptr))

    def acquire(self, law: Holdable) -> None:
        """Put a law in force until :meth:`release`.

        Raises
        ------
        RuntimeError
            Another callback has taken the place of this one, or a law in force claims tuples of this one's name.
        """
        with self.lock:
            _ = law.state, self._compiled  # before anything changes: they may raise
            if law.holders == 0:
                self._enter(law)
            law.holders += 1  # first: no release() in a garbage collection from here on is the last one
            current = mujoco.get_mjcb_passive()
            if self._installed is not None and current is not self._installed:
                error = self._replaced()
                self.release(law)
                raise error
            if law.holders == 1:
                self._changes += 1
                self._settle()

    def release(self, law: Holdable) -> None:
        """Undo one :meth:`acquire`."""
        with self.lock:
            if law.holders == 0:
                raise RuntimeError(f"the law {law.name!r} was released more often than acquired")
            law.holders -= 1
            if law.holders == 0:
                self._changes += 1
                self._settle()

    def require(self) -> None:
        """Raise RuntimeError if another callback has taken the place of this one while laws are in force."""
        if mujoco.get_mjcb_passive() is self._installed:
            return
        with self.lock:  # for another thread may just be about to change both
            if self._installed is not None and mujoco.get_mjcb_passive() is not self._installed:
                raise self._replaced()

    def _replaced(self) -> RuntimeError:
        names = ", ".join(repr(law.name) for law in self._in_force())
        return RuntimeError(
            f"MuJoCo's passive callback was replaced while laws were in force ({names}); "
            "set your own callback first, and it will be called before them"
        )

    def _in_force(self) -> list[Holdable]:
        return sorted([law for law in self._laws if law.holders > 0], key=lambda law: law.name)

    def _enter(self, law: Holdable) -> None:
        """Add a law to those known, unless one is in force whose tuples it would claim."""
        if law not in self._laws:
            self._laws.append(law)
        for other in self._in_force():
            if other is not law and (other.name.endswith(law.name) or law.name.endswith(other.name)):
                raise RuntimeError(
                    f"the law {law.name!r} cannot be in force together with another law {other.name!r}: "
                    "one tuple would declare both"
                )

    def _settle(self) -> None:
        """Make MuJoCo's callback what the holders ask for; again if a garbage collection meanwhile changed them."""
        if self._settling:
            return
        self._settling = True
        try:
            settled = -1
            while settled != self._changes:
                settled = self._changes
                laws = self._in_force()
                if laws and self._installed is None:
                    self._install(laws)
                elif laws:
                    self._put(laws)
                elif self._installed is not None:
                    self._restore()
        finally:
            self._settling = False

    def _put(self, laws: list[Holdable]) -> None:
        """Have the callback run these laws, after the one that was there before."""
        row = (self._before, *[law.state.address for law in laws])
        if row not in self._tables:
            new = table(*row)
            self._tables[row] = new, new.ctypes.data
        _place()[0] = self._tables[row][1]

    def _install(self, laws: list[Holdable]) -> None:
        current: Any = mujoco.get_mjcb_passive()
        self._previous, self._installed, self._before = current, self._compiled, 0
        if isinstance(current, ctypes._CFuncPtr):
            self._before = ctypes.cast(current, ctypes.c_void_p).value or 0
        elif current is not None:
            self._installed = _after(current, self._compiled)
        self._put(laws)
        mujoco.set_mjcb_passive(self._installed)

    def _restore(self) -> None:
        if mujoco.get_mjcb_passive() is self._installed:  # else it is no longer ours to restore
            mujoco.set_mjcb_passive(self._previous)
        self._installed = self._previous = None
        self._before = 0
        self._put([])


def _after(callback: Callable[..., None], compiled: Any) -> Callable[[Any, Any], None]:
    """A callback that calls one from Python and then the compiled one; as slow as any from Python."""

    def both(model: Any, data: Any) -> None:
        callback(model, data)
        compiled(model._address, data._address)

    return both
