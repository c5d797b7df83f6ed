"""Medians and quartiles over seeds, as lines with bands; where lines end."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from swimmer_mj.learning.experiments.tables import Table, rows_where
from swimmer_mj.render.figures import INK, line

__all__ = ["NAMES", "band", "end_key", "mark_ends", "quartiles"]

Array = NDArray[np.float64]

NAMES = {"pendulum": "pendulum", "swim5": "swimmer, 5 links"}
"""What to call the problems of the logs."""


def quartiles(table: Table, x: str, y: str) -> tuple[Array, Array, Array, Array]:
    """``x`` and the quartiles of ``y`` over the rows that share it."""
    at = np.unique(table[x])
    low, middle, high = np.array(
        [np.quantile(table[y][table[x] == value], [0.25, 0.5, 0.75]) for value in at]
    ).T
    return at, low, middle, high


def band(axes: Axes, table: Table, x: str, y: str, color: str, label: str) -> Line2D:
    """Median and interquartile band of ``y`` over seeds, each seed faint behind; returns the median."""
    for seed in np.unique(table["seed"]):
        one = rows_where(table, seed=seed)
        axes.plot(one[x], one[y], color=color, linewidth=0.5, alpha=0.3)
    at, low, middle, high = quartiles(table, x, y)
    axes.fill_between(at, low, high, color=color, alpha=0.18, linewidth=0)
    (median,) = axes.plot(at, middle, linewidth=1.8, label=label, **line(color))
    return median


END: dict[str, Any] = {"marker": "|", "markersize": 12, "markeredgewidth": 1.6, "linestyle": ""}
"""A tick."""


def mark_ends(axes: Axes, lines: Iterable[Line2D]) -> None:
    """A tick at the end of each line beyond which others of the axes go on."""
    for one in lines:
        x, y = np.asarray(one.get_xydata())[-1]
        if x < 0.99 * axes.dataLim.x1:
            axes.plot(x, y, color=one.get_color(), zorder=one.get_zorder(), **END)


def end_key(label: str) -> Line2D:
    """What stands in a legend for the ticks of :func:`mark_ends`."""
    return Line2D([], [], color=INK, label=label, **END)
