"""Vario-eta (section 3.2; Neuneier and Zimmermann 1998): a learning rate for each weight from the noise of its changes.

Written for anything that multiplies like an array: NumPy arrays, torch tensors, numbers in compiled code.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeVar

from swimmer_mj.learning.problems.settings import require_positive

__all__ = ["VarioEta", "learning_rate", "variance"]

T = TypeVar("T")


@dataclass(frozen=True)
class VarioEta:
    """Constants of the recursion."""

    beta: float = 0.01
    """Variance decay per trial (paper: "a typical choice is 1/100")."""
    epsilon: float = 0.0003
    """Bounds the rate at eta / epsilon (the best of a sweep on the swimmer; sqrt(v) as seen is 0.001 to 0.1)."""
    initial_variance: float = 10_000.0
    """v_i(0), "a large enough value" (of the same sweep, where 1 and 100 did as well)."""

    def __post_init__(self) -> None:
        if not 0 < self.beta <= 1:
            raise ValueError(f"beta must be in (0, 1], got {self.beta!r}")
        require_positive(self, "epsilon", "initial_variance")


def variance(v: T, change: T, rate: T, beta: float) -> T:
    """v_i(k+1) = (1 - beta) v_i(k) + beta ((w_i(k+1) - w_i(k)) / eta_i(k))^2, with ``change`` the difference."""
    return (1 - beta) * v + beta * (change / rate) ** 2  # type: ignore[operator, return-value]


def learning_rate(v: T, eta: float | T, epsilon: float | T) -> T:
    """eta_i(k) = eta / (sqrt(v_i(k)) + epsilon)."""
    return eta / (v**0.5 + epsilon)  # type: ignore[operator, return-value]
