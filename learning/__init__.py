"""The learner of sections 2 to 4: control problems, value networks, continuous TD(lambda), runs and their evaluation.

Read :mod:`~swimmer_mj.learning.td.continuous_td` beside equation 2; :mod:`~swimmer_mj.learning.td.fused` is the same
algorithm, compiled. Nothing is imported before it is asked for.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from swimmer_mj.learning.problems.swim.environment import SwimmingPolicy

__all__ = ["load_pretrained"]


def load_pretrained(name: str) -> SwimmingPolicy:
    """A policy that comes with the package, by name, as an agent; see :mod:`swimmer_mj.learning.pretrained`."""
    from swimmer_mj.learning import pretrained

    return pretrained.load_pretrained(name)
