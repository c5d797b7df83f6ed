"""What settings must be, said in one line: for the dataclasses of problems and methods."""

from __future__ import annotations

import math
from typing import Literal, get_args, get_origin, get_type_hints

__all__ = ["MOST_UNITS", "require_choices", "require_not_negative", "require_positive", "require_units"]

MOST_UNITS = 4096
"""Of a layer or a cascade; more are taken for a slip: the weights of a cascade are their square."""


def require_choices(settings: object) -> None:
    """Refuse a dataclass one of whose fields of type ``Literal[..]`` has another value."""
    for name, hint in get_type_hints(type(settings)).items():
        if get_origin(hint) is Literal and getattr(settings, name) not in get_args(hint):
            choices = ", ".join(map(repr, get_args(hint)))
            raise ValueError(f"{name} must be one of {choices}; got {getattr(settings, name)!r}")


def require_positive(settings: object, *names: str) -> None:
    """Refuse fields that are not positive and finite."""
    for name in names:
        value = getattr(settings, name)
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be positive and finite, got {value!r}")


def require_not_negative(settings: object, *names: str) -> None:
    """Refuse fields that are negative or not finite."""
    for name in names:
        value = getattr(settings, name)
        if not (math.isfinite(value) and value >= 0):
            raise ValueError(f"{name} must be finite and not negative, got {value!r}")


def require_units(name: str, count: object, least: int) -> None:
    """Refuse a number of units that is no integer between ``least`` and :data:`MOST_UNITS`."""
    if not (type(count) is int and count <= MOST_UNITS):
        raise ValueError(f"{name} must be an integer of at most {MOST_UNITS}, got {count!r}")
    if count < least:
        which = ", one hidden and the output" if least == 2 else ""
        raise ValueError(f"{name} must be at least {least}{which}; got {count}")
