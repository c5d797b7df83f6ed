"""What a problem says of itself that those who learn it should know: ``problem.caution()``, a line, or None.

A learner warns with it when it is made; a command prints it instead. A problem without such a method says nothing.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swimmer_mj.learning.problems.problem import ControlProblem

__all__ = ["CautionWarning", "caution_of", "warn_of"]


class CautionWarning(UserWarning):
    """Of a learner, when it is made for a problem that asks for care."""


def caution_of(problem: ControlProblem) -> str | None:
    """The line, if there is one."""
    caution: Callable[[], str | None] | None = getattr(problem, "caution", None)
    return None if caution is None else caution()


def warn_of(problem: ControlProblem) -> None:
    """Warn with the line, if there is one, where the object is made whose ``__init__`` calls this."""
    if (line := caution_of(problem)) is not None:
        warnings.warn(line, CautionWarning, stacklevel=3)
