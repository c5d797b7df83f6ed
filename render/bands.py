"""Medians and quartiles over seeds, as lines with bands."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from swimmer_mj.learning.experiments.tables import Table, rows_where

__all__ = ["NAMES", "band", "quartiles"]

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


def band(axes: Axes, table: Table, x: str, y: str, color: str, label: str) -> None:
    """Median and interquartile band of ``y`` over seeds, each seed faint behind."""
    for seed in np.unique(table["seed"]):
        one = rows_where(table, seed=seed)
        axes.plot(one[x], one[y], color=color, linewidth=0.5, alpha=0.3)
    at, low, middle, high = quartiles(table, x, y)
    axes.fill_between(at, low, high, color=color, alpha=0.18, linewidth=0)
    axes.plot(at, middle, color=color, linewidth=1.8, label=label)
