"""Laws: what a user writes, and how it is put in force."""

# pyright: reportAttributeAccessIssue=false
# (MuJoCo's bindings and numba carry no types.)
from __future__ import annotations

import copy
import ctypes
import inspect
import math
import re
import types
import weakref
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import mujoco

from swimmer_mj.passive import compilation, evaluation
from swimmer_mj.passive.callback import SharedCallback, table
from swimmer_mj.passive.errors import LawError, error_of
from swimmer_mj.passive.failures import Failure, State
from swimmer_mj.passive.site import Site

__all__ = ["Law", "law"]

_SHAPES = ("sphere", "capsule", "ellipsoid", "cylinder", "box")

_shared = SharedCallback()  # one, as MuJoCo's callback is


class Law:
    """A passive force on the sites that a model declares; made by :func:`law`.

    Called as a function, it is evaluated in Python.
    """

    def __init__(self, function: Callable[..., Any], name: str, shape: str | None = None) -> None:
        if not isinstance(function, types.FunctionType):
            raise TypeError(
                f"a law is made of a function in Python, which it compiles itself, got {function!r}"
            )
        taken = list(inspect.signature(function).parameters.values())
        plain = inspect.Parameter.POSITIONAL_OR_KEYWORD
        if not taken or any(p.kind != plain or p.default is not p.empty for p in taken):
            raise TypeError(
                f"a law takes the site and its parameters, without defaults or stars, got {function.__name__}"
                f"{inspect.signature(function)}"
            )
        self.name = name
        self.function = function
        self.parameters = tuple(p.name for p in taken[1:])
        self.shape = shape
        self.holders = 0
        self._state: State | None = None
        self._told = 0  # failures that an exception has told of

    def __repr__(self) -> str:
        return f"<law {self.name!r} of {', '.join(self.parameters) or 'no parameters'}>"

    def __call__(self, site: Site, *parameters: float) -> Any:
        """The force (N) and the moment (N·m) at one site, evaluated in Python."""
        return self.function(site, *parameters)

    @cached_property
    def _address(self) -> int:
        try:
            return compilation.address(self.function)
        except compilation.COMPILE_ERRORS as error:
            raise LawError(f"the law {self.name!r} {compilation.complaint(self.function)}") from error

    def _new_state(self) -> State:
        shape = -1 if self.shape is None else _geom_type(self.shape)
        return State(self._address, self.name, len(self.parameters), shape)

    @property
    def state(self) -> State:
        """What compiled code knows of the law."""
        if self._state is None:
            self._state = self._new_state()
        return self._state

    def acquire(self) -> None:
        """Put the law in force until :meth:`release`; calls may nest and come from any thread.

        A passive callback found installed keeps running, before all laws. If it is compiled (a ctypes function), they
        are joined in C. If it is Python's, they are joined in Python: as slow as it was before, and as before
        ``mujoco.batch`` refuses it and no model compiles meanwhile.

        Raises
        ------
        LawError
            The law does not compile.
        RuntimeError
            The installed MuJoCo's structs are not as its tables say, another callback has meanwhile taken the place of
            the laws', or a law is in force whose name ends as this one's.
        """
        _shared.acquire(self)

    def release(self) -> None:
        """Undo one :meth:`acquire`; the last one of all laws restores the callback that was found at the first."""
        _shared.release(self)

    @contextmanager
    def in_force(self) -> Iterator[None]:
        """The law in force inside a ``with`` block, also when it is left by an exception.

        Raises
        ------
        LawError
            At the end of the block: the law failed in it. If the block is left by an exception, that one goes on,
            with a note.
        """
        with _shared.lock:
            self.acquire()
            since = self.state.watch()
        try:
            yield
        except BaseException as exception:
            if (error := self._error(since)) is not None:
                exception.add_note(str(error))
            raise
        finally:
            self.release()
        if (error := self._error(since)) is not None:
            raise error from error.__cause__

    def hold(self, owner: object) -> weakref.finalize:
        """Keep the law in force while ``owner`` lives; :meth:`raise_failure` says whether it failed.

        Returns
        -------
        weakref.finalize
            Call it to release sooner; further calls do nothing.
        """
        self.acquire()
        return weakref.finalize(owner, self.release)

    def require(self) -> None:
        """Raise RuntimeError if another callback has taken the place of the laws' since one was put in force."""
        _shared.require()

    def raise_failure(self) -> None:
        """Raise LawError if the law has failed and no exception has told of it yet."""
        if (error := self._error(self._told)) is not None:
            raise error from error.__cause__

    def declare(self, spec: Any, site: str, **parameters: float) -> None:
        """Declare in a model that is being built that the law acts on a site.

        Parameters
        ----------
        spec : mujoco.MjSpec
            A tuple of the law's name is added to, and a numeric if the law has several parameters.
        site : str
            Its name.
        **parameters : float
            All parameters of the law, finite.

        Raises
        ------
        LawError
            There is no such site, it is not of the law's shape, or the parameters are not the law's.
        """
        found = spec.site(site)
        if found is None:
            sites = [s.name for s in spec.sites]
            raise LawError(
                f"the law {self.name!r} needs a site named {site!r}: the model's sites are {sites}"
            )
        if self.shape is not None and found.type != _geom_type(self.shape):
            raise LawError(f"the law {self.name!r} needs a site of type {self.shape}, which {site!r} is not")
        if parameters.keys() != {*self.parameters} or not all(map(_is_finite, parameters.values())):
            raise LawError(
                f"the law {self.name!r} takes finite numbers {', '.join(self.parameters) or '(none)'}, got {parameters}"
            )
        data = [float(parameters[name]) for name in self.parameters]
        elements = [(mujoco.mjtObj.mjOBJ_SITE, site, data[0] if len(data) == 1 else 0.0)]
        if len(data) > 1:
            numeric = spec.add_numeric(name=f"{self.name}.{site}", size=len(data), data=data)
            elements.append((mujoco.mjtObj.mjOBJ_NUMERIC, numeric.name, 0.0))
        declared = spec.tuple(self.name) or spec.add_tuple(name=self.name)
        for kind, name, prm in elements:
            declared.objtype = [*declared.objtype, int(kind)]
            declared.objname = [*declared.objname, name]
            declared.objprm = [*declared.objprm, prm]

    def check(self, model: Any, data: Any = None) -> None:
        """Evaluate the law once on a model, whether or not it is in force.

        Parameters
        ----------
        model : mujoco.MjModel
        data : mujoco.MjData, optional
            Its state is taken, and left as it is; by default the model's first.

        Raises
        ------
        LawError
            The model does not declare the law, declares it wrongly, or the law fails on it.
        """
        tuples = [model.tuple(i).name for i in range(model.ntuple)]
        if not any(name.endswith(self.name) for name in tuples):
            raise LawError(
                f"the model {_model_name(model)!r} declares no law {self.name!r}: its tuples are {tuples}"
            )
        data = mujoco.MjData(model) if data is None else copy.copy(data)
        for compute in (mujoco.mj_kinematics, mujoco.mj_comPos, mujoco.mj_comVel):
            compute(model, data)
        state = self._new_state()
        only = table(0, state.address)
        evaluate = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3)(evaluation.address())
        evaluate(model._address, data._address, only.ctypes.data)
        if state.count > 0:
            raise self._describe(state.failure(0))

    def _error(self, since: int) -> LawError | None:
        """What to raise if there are more failures than ``since``."""
        if self.state.count == since:
            return None
        with _shared.lock:
            failure = self.state.failure(since)
            self._told = self.state.watch()
        return self._describe(failure)

    def _describe(self, failure: Failure | None) -> LawError:
        return error_of(failure, self.function, self.name, self.parameters, self.shape)


def _is_finite(value: Any) -> bool:
    try:
        return math.isfinite(value)
    except (TypeError, OverflowError):
        return False


def _geom_type(shape: str) -> int:
    return int(getattr(mujoco.mjtGeom, f"mjGEOM_{shape.upper()}"))


def _model_name(model: Any) -> str:
    return bytes(model.names).split(b"\0")[0].decode(errors="replace")


def law(name: str, shape: str | None = None) -> Callable[[Callable[..., Any]], Law]:
    """Make a law of a function.

    Parameters
    ----------
    name : str
        A model declares the law by a tuple whose name ends with this one.
    shape : str, optional
        The type that the law's sites must have, as MJCF names it.

    Returns
    -------
    callable
        Makes a :class:`Law` of a function of a :class:`~swimmer_mj.passive.Site` and any number of parameters that
        returns a force (N) at the site's centre and a moment (N·m).
    """
    if not isinstance(name, str) or not re.fullmatch(r"[^\0\s]+\.[^\0\s]+", name):
        raise ValueError(f"a law's name must have a dot inside and no space, as 'lab.drag', got {name!r}")
    if shape is not None and shape not in _SHAPES:
        raise ValueError(f"a law's shape must be one of {', '.join(_SHAPES)} or None, got {shape!r}")
    return lambda function: Law(function, name, shape)
