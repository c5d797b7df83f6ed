"""What matters to value gradients, how fast other swimmers get, and whether speed lasts: drawn from the logs."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.experiments import value_gradients
from swimmer_mj.learning.experiments.summaries import FAST, learners
from swimmer_mj.learning.experiments.tables import LOGS, read_table, rows_where, settings_of
from swimmer_mj.render.figures import BLUE, COLORS, GREY, HANDLE, INK, line, log_axis, nth_line, plain_axes

__all__ = ["draw_ablation", "draw_lasting", "draw_links"]

Array = NDArray[np.float64]
Logs = str | os.PathLike[str]


def _interval(axes: Axes, values: Array, y: float, color: str) -> None:
    """Each value, and their mean with its 95 % interval, along a horizontal line."""
    axes.plot(values, np.full(len(values), y), "|", color=GREY, markersize=8)
    mean, interval = mean_and_interval(values)
    axes.plot(interval, [y, y], color=color, linewidth=2.2, solid_capstyle="butt")
    axes.plot(mean, y, "o", color=color, markersize=5.5)


def draw_ablation(logs: Logs = LOGS) -> Figure:
    """Speed at the end and time to 1.5 m/s with one setting changed: each seed, mean and 95 % interval.

    Of the time only where all seeds got there.
    """
    table = read_table(Path(logs) / value_gradients.ABLATION_LOG)
    settings = settings_of(table)
    figure = Figure(figsize=(9.6, 0.29 * len(settings) + 1.3), layout="constrained")
    speed, time = figure.subplots(1, 2, sharey=True, width_ratios=[1.25, 1])
    for axes in (speed, time):
        plain_axes(axes)
    n_seeds = 0
    for y, (factor, setting) in enumerate(settings):
        seeds = learners(rows_where(table, factor=factor, setting=setting))
        n_seeds = max(n_seeds, len(seeds))
        color = INK if y == 0 else BLUE
        final = np.array([one["speed"][-1] for one in seeds])
        _interval(speed, final, y, color)
        reached = np.array(
            [one["cpu_seconds"][one["speed"] >= FAST][0] for one in seeds if one["speed"].max() >= FAST]
        )
        if len(reached) == len(seeds):
            _interval(time, reached, y, color)
        else:  # a mean of those that did get there would say little
            time.plot(reached, np.full(len(reached), y), "|", color=GREY, markersize=8)
            time.annotate(
                f"{len(reached)} of {len(seeds)}",
                (1, y),
                xycoords=("axes fraction", "data"),
                xytext=(3, 0),
                textcoords="offset points",
                va="center",
                fontsize=8,
                color=INK,
            )
        if y == 0:
            speed.axvline(float(final.mean()), linewidth=0.8, **line(INK))
    speed.set_yticks(
        range(len(settings)),
        [f"{factor}: {setting}" if setting else factor for factor, setting in settings],
    )
    speed.set_ylim(len(settings) - 0.4, -0.6)
    speed.set_xlim(left=min(0.0, speed.get_xlim()[0]))
    steps = float(table["simulation_steps"].max()) / 1e6
    speed.set_xlabel(f"swimming speed after {steps:.0f} million steps  (m/s)")
    log_axis(time, "x")
    time.set_xlabel(f"processor time to {FAST} m/s  (s)")
    figure.suptitle(
        f"{n_seeds} seeds: each, mean and 95 % interval of the mean (of time, where all got there)",
        fontsize=10,
    )
    return figure


def draw_links(logs: Logs = LOGS) -> Figure:
    """Speed against simulation for each number of links, and the best of each seed."""
    table = read_table(Path(logs) / value_gradients.LINKS_LOG)
    numbers = np.unique(table["setting"])
    figure = Figure(figsize=(9.6, 4.2), layout="constrained")
    curves, best = figure.subplots(1, 2, sharey=True, width_ratios=[1.6, 1])
    for axes in (curves, best):
        plain_axes(axes)
    counts = set()
    for k, (color, n) in enumerate(zip(COLORS, numbers, strict=False)):
        seeds = learners(rows_where(table, setting=float(n)))
        for one in seeds:
            curves.plot(one["simulation_steps"], one["speed"], color=color, linewidth=0.5, alpha=0.35)
        length = min(len(one["speed"]) for one in seeds)
        median = np.median([one["speed"][:length] for one in seeds], axis=0)
        counts.add(len(seeds))
        at = seeds[0]["simulation_steps"][:length]
        curves.plot(at, median, linewidth=1.8, label=f"{n:.0f} links", **line(color))
        fastest = np.array([one["speed"].max() for one in seeds])
        best.plot(np.full(len(fastest), k), fastest, "_", color=GREY, markersize=10)
        mean, interval = mean_and_interval(fastest)
        best.plot([k, k], interval, color=color, linewidth=2.4, solid_capstyle="butt")
        best.plot(k, mean, "o", color=color, markersize=6)
    curves.set_xscale("log")
    curves.xaxis.set_major_formatter(EngFormatter(sep=""))
    curves.set_xlabel("simulation steps of 0.01 s")
    curves.set_ylabel("swimming speed  (m/s)")
    curves.set_ylim(bottom=0)
    best.set_xticks(range(len(numbers)), [f"{n:.0f}" for n in numbers])  # side by side: some are left out
    best.margins(x=0.1)
    best.set_xlabel("links")
    curves.set_title(
        f"{' or '.join(map(str, sorted(counts)))} seeds each, and their median (thick)", fontsize=9
    )
    best.set_title("best of each seed, mean and 95 % interval", fontsize=9)
    figure.legend(
        *curves.get_legend_handles_labels(),
        loc="outside upper center",
        ncols=5,
        frameon=False,
        handlelength=HANDLE,
    )
    return figure


def draw_lasting(logs: Logs = LOGS) -> Figure:
    """Speed of each seed over long learning, and as a share of its best so far."""
    table = read_table(Path(logs) / value_gradients.LASTING_LOG)
    figure = Figure(figsize=(8.0, 5.6), layout="constrained")
    speed, share = figure.subplots(2, 1, sharex=True, height_ratios=[1.4, 1])
    for axes in (speed, share):
        plain_axes(axes)
    chosen = value_gradients.LASTING[0]
    for k, one in enumerate(learners(rows_where(table, factor=chosen.factor, setting=chosen.setting))):
        style = nth_line(k)
        at, v = one["simulation_steps"], one["speed"]
        peak = int(np.argmax(v))
        speed.plot(at, v, linewidth=1.1, label=f"seed {one['seed'][0]:.0f}", **style)
        speed.plot(at[peak], v[peak], "o", color=style["color"], markersize=4.5)
        best = np.maximum.accumulate(v)
        share.plot(at, v / np.where(best > 0, best, 1.0), linewidth=1.1, **style)
    share.axhline(0.95, linewidth=0.8, **line(INK))
    share.set_ylim(top=1.01)
    share.set_ylabel("share of the best so far")
    share.set_xlabel("simulation steps of 0.01 s")
    share.xaxis.set_major_formatter(EngFormatter(sep=""))
    speed.set_ylabel("swimming speed  (m/s)")
    speed.set_title("dots: the best of each seed", fontsize=9, loc="right")
    figure.legend(
        *speed.get_legend_handles_labels(),
        loc="outside upper center",
        ncols=5,
        frameon=False,
        handlelength=HANDLE,
    )
    return figure
