"""A picture of a sweep: a line of dots for each combination of settings, a dot a seed, the best at the top."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from swimmer_mj.render.figures import BLUE, GREY, INK, ORANGE, plain_axes, save_figure

__all__ = ["draw_sweep", "sweep_plot"]

MOST = 40
"""Combinations in the picture: the best ones."""
LETTER = 0.065
"""Of a label, inches."""
NO_SETTINGS = ("job", "seed", "trials", "seconds", "speed", "last_speed", "state")


def sweep_plot(rows: Sequence[Mapping[str, Any]], measure: str = "swimming speed  (m/s)") -> Figure:
    """The figure of rows of a sweep.csv (:func:`swimmer_mj.learning.runs.sweep.rows_of`)."""
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        settings = {name: value for name, value in row.items() if name not in NO_SETTINGS}
        label = ", ".join(f"{name} {_text(value)}" for name, value in settings.items()) or "all"
        groups.setdefault(label, []).append(row)
    speeds = {
        label: np.array([row["speed"] for row in group if row["speed"] is not None], dtype=np.float64)
        for label, group in groups.items()
    }
    order = sorted(groups, key=lambda label: -speeds[label].mean() if speeds[label].size else np.inf)
    shown = order[:MOST]
    labels = LETTER * max(map(len, shown))
    figure = Figure(figsize=(max(7.2, 5.9 + labels), 1.4 + 0.26 * len(shown)), layout="constrained")
    axes = figure.subplots()
    plain_axes(axes)
    axes.margins(x=0.04)
    for y, label in enumerate(shown):
        if speeds[label].size:
            axes.plot(
                speeds[label], np.full(speeds[label].size, y), "o", color=BLUE, alpha=0.6, markersize=5, mew=0
            )
            axes.plot(speeds[label].mean(), y, "|", color=INK, markersize=13, markeredgewidth=2)
        lost = sum(row["state"] == "diverged" for row in groups[label])
        if lost:
            axes.annotate(
                f"{lost} diverged",
                (1.01, y),
                xycoords=("axes fraction", "data"),
                ha="left",
                va="center",
                color=ORANGE,
                fontsize=8,
            )
    axes.set_yticks(range(len(shown)), shown, fontsize=8)
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.grid(axis="y", color=GREY, alpha=0.25, linewidth=0.6)
    axes.set_xlabel(f"{measure} in the best evaluation: a dot a seed, a bar their mean")
    if len(order) > MOST:
        axes.set_title(f"the best {MOST} of {len(order)} combinations", fontsize=9, loc="left")
    return figure


def draw_sweep(rows: Sequence[Mapping[str, Any]], path: Path, measure: str = "swimming speed  (m/s)") -> None:
    """Write :func:`sweep_plot` as PNG."""
    save_figure(sweep_plot(rows, measure), path)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value)
