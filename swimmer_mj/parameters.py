"""What a swimmer is made of: the problem parameters of A.1, in SI units."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["PAPER", "SwimmerParameters"]


def _one_per(value: float | Sequence[float], n_links: int, name: str, of: str) -> tuple[float, ...]:
    """``value`` as positive floats, one per link or joint; a scalar is repeated."""
    count = n_links - 1 if of == "joint" else n_links
    try:
        values = np.asarray(value)
    except ValueError:  # sequences within it, of unequal lengths
        values = np.array(None)
    if values.dtype.kind not in "iuf" and values.size:
        raise TypeError(f"{name} must be a number or one number per {of}, got {value!r}")
    if values.ndim == 0:
        values = np.full(count, values)
    if values.shape != (count,):
        got = len(values) if values.ndim == 1 else f"shape {values.shape}"
        raise ValueError(
            f"{name} must be a scalar or have {count} values, one per {of}; got {got}: {value!r} "
            f"(SwimmerParameters(n_links={n_links}) has the paper's)"
        )
    if not (np.isfinite(values).all() and (values > 0).all()):
        raise ValueError(f"{name} must be positive and finite, got {value!r}")
    return tuple(float(v) for v in values)


MOST_LINKS = 1000
"""More are taken for a slip."""


@dataclass(frozen=True)
class SwimmerParameters:
    """A chain of ``n_links`` rigid rods in a viscous fluid (Coulom 2002, A.1 and A.2).

    The defaults are the values of A.5. Scalars stand for the same value on every link or joint and are
    stored as one value each, so that parameters that mean the same swimmer are equal. So another number of links
    needs masses, lengths and torque limits of its own: for the paper's, it is ``SwimmerParameters(n_links=3)`` and not
    ``dataclasses.replace(PAPER, n_links=3)``.

    Parameters
    ----------
    n_links : int
        Number of body parts n, at least 1.
    mass : float or sequence of n floats
        m_i, kg, positive.
    length : float or sequence of n floats
        l_i, m, positive.
    viscous_friction : float
        k, N·s/m² (force per length and per normal velocity), not negative. 0 is a swimmer in a vacuum.
    torque_limit : float or sequence of n - 1 floats
        U_i, N·m, positive: the torque of joint i lies in [-U_i, U_i].
    """

    n_links: int = 5
    mass: float | Sequence[float] = 1.0
    length: float | Sequence[float] = 1.0
    viscous_friction: float = 10.0
    torque_limit: float | Sequence[float] = 5.0

    def __post_init__(self) -> None:
        try:
            n = operator.index(self.n_links)
        except TypeError:
            raise TypeError(f"n_links must be an integer, got {self.n_links!r}") from None
        if n < 1:
            raise ValueError(f"n_links must be at least 1, got {n}")
        if n > MOST_LINKS:
            raise ValueError(f"n_links must be at most {MOST_LINKS}, got {n}")
        try:
            k = float(self.viscous_friction)
        except (TypeError, ValueError):
            raise TypeError(f"viscous_friction must be a number, got {self.viscous_friction!r}") from None
        if not (math.isfinite(k) and k >= 0):
            raise ValueError(f"viscous_friction must be finite and not negative, got {k!r}")
        set_field = object.__setattr__  # the one place where a frozen object is filled in
        set_field(self, "n_links", n)
        set_field(self, "viscous_friction", k)
        set_field(self, "mass", _one_per(self.mass, n, "mass", "link"))
        set_field(self, "length", _one_per(self.length, n, "length", "link"))
        set_field(self, "torque_limit", _one_per(self.torque_limit, n, "torque_limit", "joint"))

    @property
    def masses(self) -> NDArray[np.float64]:
        """m, shape (n,), kg."""
        return np.array(self.mass, dtype=np.float64)

    @property
    def lengths(self) -> NDArray[np.float64]:
        """l, shape (n,), m."""
        return np.array(self.length, dtype=np.float64)

    @property
    def torque_limits(self) -> NDArray[np.float64]:
        """U, shape (n - 1,), N·m."""
        return np.array(self.torque_limit, dtype=np.float64)


PAPER = SwimmerParameters()
"""The 5-link swimmer of section 4 with the numerical values of A.5."""
