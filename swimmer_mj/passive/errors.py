"""What is said of a law that failed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from swimmer_mj.passive.failures import (
    LENGTH,
    NO_PARAMETERS,
    NOT_A_SITE,
    NOT_FINITE,
    RAISED,
    WRONG_SHAPE,
    Failure,
)
from swimmer_mj.passive.site import Site

__all__ = ["LawError", "error_of"]


class LawError(RuntimeError):
    """A law that raised, returned what is no force, or does not compile; or a model that declares it wrongly."""


def error_of(
    failure: Failure | None,
    function: Callable[..., Any],
    name: str,
    parameters: Sequence[str],
    shape: str | None,
) -> LawError:
    """What to raise because of a failure, in one line; its cause is the exception that the law raised, if it did.

    Parameters
    ----------
    failure : Failure or None
        None if it is not known where the law failed.
    function : callable
        The law, in Python.
    name, parameters, shape
        As in :class:`~swimmer_mj.passive.Law`.
    """
    if failure is None:
        return LawError(f"the law {name!r} failed; another failure at the same time hid where")
    must = {
        NOT_A_SITE: "must be a site",
        WRONG_SHAPE: f"must be a site of type {shape}",
        NO_PARAMETERS: f"must be followed by a numeric of {len(parameters)} numbers ({', '.join(parameters)})",
    }
    if failure.kind in must:
        return LawError(
            f"the law {name!r} cannot act on the model {failure.model!r}: "
            f"element {failure.element} of its tuple {failure.tuple!r} {must[failure.kind]}"
        )
    site, values = failure.inputs
    cause = _exception(function, site, values) if failure.kind == RAISED else None
    how = {
        RAISED: f"raised {type(cause).__name__}: {' '.join(str(cause).split())},"
        if cause
        else "raised an exception",
        NOT_FINITE: "returned a force or a moment that is not finite",
        LENGTH: "returned a force or a moment that has not three components",
    }
    error = LawError(
        f"the law {name!r} {how[failure.kind]} at the site {failure.site!r} of the model {failure.model!r}, "
        f"time {site.time:g} s"
    )
    error.__cause__ = cause
    return error


def _exception(function: Callable[..., Any], site: Site, values: Sequence[float]) -> Exception | None:
    """What a law raises when called so in Python, where the exception can be seen."""
    try:
        function(site, *values)
    except Exception as exception:
        return exception
    return None
