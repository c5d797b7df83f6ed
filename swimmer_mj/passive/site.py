"""What a law is told of a site."""

# pyright: reportAttributeAccessIssue=false
# (numba carries no types.)
from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

__all__ = ["N_NUMBERS", "Site", "Vector", "site_of"]

Vector = tuple[float, float, float]


class Site(NamedTuple):
    """A site at one moment. All vectors are in the world's frame; SI units."""

    time: float
    """s, of the simulation."""
    position: Vector
    axes: tuple[Vector, Vector, Vector]
    """Unit vectors along the site's x, y and z axes: the columns of its orientation matrix."""
    size: Vector
    """The site's three sizes, as MJCF has them for its type."""
    velocity: Vector
    """Of the site's centre."""
    angular_velocity: Vector


N_NUMBERS = 22
"""Numbers in a site. In memory they stand in the order of the fields, the time after the vectors."""


def site_of(numbers: Sequence[float]) -> Site:
    """The site whose numbers stand in memory so."""
    vectors: Any = [tuple(numbers[i : i + 3]) for i in range(0, N_NUMBERS - 1, 3)]
    return Site(numbers[N_NUMBERS - 1], vectors[0], tuple(vectors[1:4]), *vectors[4:])
