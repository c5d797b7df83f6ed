"""What a check finds, and what of it is kept."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

__all__ = ["Check", "Curve", "Section", "Worst"]


def _or_none(value: float) -> float | None:
    return value if math.isfinite(value) else None


@dataclass(frozen=True)
class Check:
    """One comparison, of two statements of the physics or of one with what must hold."""

    name: str
    """What is compared."""
    error: float
    """What was measured."""
    tolerance: float
    """The largest error that passes."""
    reason: str
    """Where the tolerance comes from."""
    worst: str = ""
    """Where among the cases of this check the error was measured."""

    @property
    def passed(self) -> bool:
        """Whether the error is within tolerance, and both are finite."""
        return bool(self.error <= self.tolerance < math.inf) and math.isfinite(self.error)

    def to_json(self) -> dict[str, Any]:
        """All of it; an error or tolerance that is no finite number is None."""
        numbers = {"error": _or_none(self.error), "tolerance": _or_none(self.tolerance)}
        return {**asdict(self), **numbers, "passed": self.passed}


@dataclass(frozen=True)
class Curve:
    """Numbers to draw."""

    label: str
    x: list[float]
    y: list[float]
    guide: bool = False
    """Whether it is there to compare the others with."""

    def to_json(self) -> dict[str, Any]:
        """All of it; what is no finite number is None."""
        return {**asdict(self), "x": [_or_none(v) for v in self.x], "y": [_or_none(v) for v in self.y]}


@dataclass(frozen=True)
class Section:
    """Checks that belong together, and what to draw beside them."""

    title: str
    checks: list[Check]
    axes: tuple[str, str] = ("", "")
    """Labels of the plot's axes; both are logarithmic where ``loglog``, else the vertical one."""
    curves: list[Curve] = field(default_factory=list)
    loglog: bool = False

    @property
    def passed(self) -> bool:
        """Whether all checks passed."""
        return all(check.passed for check in self.checks)


@dataclass
class Worst:
    """The case of a check with the largest error; or of those that fail, the one that exceeds most."""

    name: str
    reason: str
    case: Check | None = None
    _rank: tuple[float, float] = (0.0, 0.0)

    def add(self, error: float, tolerance: float, where: str) -> None:
        """Note a case, measured at ``where``."""
        new = Check(self.name, float(error), float(tolerance), self.reason, where)
        if np.isfinite([new.error, new.tolerance]).all():
            excess = new.error / new.tolerance if new.tolerance > 0 else float(new.error > 0) * np.inf
            rank = (0.0 if new.passed else float(excess), new.error)
        else:
            rank = (np.inf, np.inf)
        if self.case is None or rank > self._rank:
            self.case, self._rank = new, rank

    def check(self) -> Check:
        """The worst case, once there is one."""
        if self.case is None:
            raise ValueError(f"nothing was measured for the check {self.name!r}")
        return self.case
