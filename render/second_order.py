"""Section 3.4 as a figure: the methods' learning curves, and the noise of weights beside their curvature."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from swimmer_mj.learning.experiments import section_3_4
from swimmer_mj.learning.experiments.tables import LOGS, Path, Table, read_table, rows_where
from swimmer_mj.render.bands import NAMES, band, quartiles
from swimmer_mj.render.figures import BLUE, COLORS, GREY, HANDLE, INK, line, plain_axes

__all__ = ["draw_section_3_4"]

Logs = str | os.PathLike[str]

METHOD_COLORS = dict(zip(section_3_4.METHODS, (GREY, *COLORS[:3]), strict=True))
METHOD_LABELS = {
    "plain": "plain gradient descent",
    "output scaled": "output unit's rate scaled",
    "vario-eta": r"vario-$\eta$",
    "Levenberg-Marquardt": "diagonal Levenberg-Marquardt",
}
MEDIAN: dict[str, Any] = {"linewidth": 1.6}
LOW: dict[str, Any] = {"linewidth": 1.0, "marker": "o", "markersize": 4, "markerfacecolor": "white"}
"""Of weights: how their median and their 5th percentile are drawn."""
REWARDS = {"pendulum": r"mean reward $\cos\,\theta$", "swim5": "swimming speed  (m/s)"}


def _draw_noise(axes: Axes, table: Table) -> None:
    """Median weight and 5th percentile of v against trials; medians over seeds."""
    for method, color in METHOD_COLORS.items():
        rows = rows_where(table, method=method)
        for column, look in (("noise_p50", MEDIAN), ("noise_p05", LOW)):
            at, low, middle, high = quartiles(rows, "trial", column)
            axes.plot(at, middle, **look, **line(color))
            if look is MEDIAN:
                axes.fill_between(at, low, high, color=color, alpha=0.15, linewidth=0)
    axes.plot([], [], color=INK, label="median over weights", **MEDIAN)
    axes.plot([], [], color=INK, label="5th percentile", **LOW)
    axes.set_yscale("log")
    axes.set_ylabel("noise $v$")


def _draw_weights(axes: Axes, table: Table) -> None:
    """v against h of each weight of one run, at its end."""
    for output, color, marker, label in (
        (0, GREY, ".", "to hidden units"),
        (1, BLUE, "+", "to the output unit"),
    ):
        points = rows_where(table, output=output)
        seen = (points["curvature"] > 0) & (points["noise"] > 0)
        axes.plot(
            points["curvature"][seen],
            points["noise"][seen],
            marker,
            color=color,
            markersize=5,
            alpha=0.7,
            markeredgewidth=float(marker == "+"),
            label=label,
        )
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_ylabel("noise $v$ of a weight")
    axes.margins(x=0.05)


def draw_section_3_4(logs: Logs = LOGS) -> Figure:
    """Learning curves of four methods; noise over training; noise against curvature; their rank correlation."""
    learning = read_table(Path(logs) / section_3_4.LEARNING_LOG)
    noise = read_table(Path(logs) / section_3_4.NOISE_LOG)
    weights = read_table(Path(logs) / section_3_4.WEIGHTS_LOG)
    problems = [name for name in NAMES if name in learning["problem"]]
    figure = Figure(figsize=(15.0, 3.6 * len(problems) + 0.6), layout="constrained")
    panels = figure.subplots(len(problems), 4, squeeze=False)
    for (curve, over_time, scatter, rank), problem in zip(panels, problems, strict=True):
        runs, measured = rows_where(learning, problem=problem), rows_where(noise, problem=problem)
        for axes in (curve, over_time, scatter, rank):
            plain_axes(axes)
        for method, color in METHOD_COLORS.items():
            band(curve, rows_where(runs, method=method), "trial", "reward", color, METHOD_LABELS[method])
            one = rows_where(measured, method=method)
            at, low, middle, high = quartiles(one, "trial", "rank_correlation")
            rank.fill_between(at, low, high, color=color, alpha=0.15, linewidth=0)
            rank.plot(at, middle, linewidth=1.6, **line(color))
        seeds = len(np.unique(runs["seed"]))
        lost = int(np.sum(rows_where(runs, trial=runs["trial"].max())["diverged"]))
        curve.set_title(
            f"{NAMES[problem]}: {seeds} seeds, median and quartiles" + (f", {lost} diverged" if lost else ""),
            fontsize=10,
        )
        curve.set_ylabel(REWARDS[problem])
        _draw_noise(over_time, measured)
        _draw_weights(scatter, rows_where(weights, problem=problem))
        rank.set_ylabel("rank correlation of $v$ and $h$")
        for axes in (curve, over_time, rank):
            axes.xaxis.set_major_formatter(EngFormatter(sep=""))
            axes.set_xlabel("trials")
        scatter.set_xlabel("Gauss-Newton curvature $h$")
        scatter.set_title(f"{METHOD_LABELS[section_3_4.SHOWN]}, one run, at its end", fontsize=10)
    for axes in panels[1:, 3]:
        axes.sharey(panels[0, 3])
    panels[0, 1].legend(frameon=False, fontsize=9)
    panels[0, 2].legend(frameon=False, fontsize=9)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=4, frameon=False, handlelength=HANDLE)
    figure.align_ylabels()
    return figure
