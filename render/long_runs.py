"""Figure 2 over many seeds, and what decides whether the swimmer learns: drawn from the logs of the experiments."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.experiments import what_decides
from swimmer_mj.learning.experiments.long_runs import ETAS
from swimmer_mj.learning.experiments.summaries import peaks
from swimmer_mj.learning.experiments.tables import LOGS, Table, read_table, rows_where, settings_of
from swimmer_mj.render.bands import end_key, mark_ends
from swimmer_mj.render.figures import BLUE, GREY, HANDLE, INK, ORANGE, line, log_axis, plain_axes

__all__ = ["draw_long_runs", "draw_what_decides"]

Array = NDArray[np.float64]
Logs = str | os.PathLike[str]

PRESETS = {
    "paper": (BLUE, rf"$\eta$ = {ETAS['paper']:g} (the paper's)"),
    "tuned": (ORANGE, rf"$\eta$ = {ETAS['tuned']:g}"),
}


def _runs(axes: Axes, table: Table, quantity: str, color: str, label: str) -> Line2D:
    """Median, which is returned, and interquartile band over seeds, as far as all have come; each seed faint behind."""
    seeds = np.unique(table["seed"])
    runs = [rows_where(table, seed=float(seed)) for seed in seeds]
    for run in runs:
        axes.plot(run["trial"], run[quantity], color=color, linewidth=0.5, alpha=0.35)
    length = min(len(run["trial"]) for run in runs)
    low, middle, high = np.quantile([run[quantity][:length] for run in runs], [0.25, 0.5, 0.75], axis=0)
    at = runs[0]["trial"][:length]
    axes.fill_between(at, low, high, color=color, alpha=0.18, linewidth=0)
    (median,) = axes.plot(at, middle, linewidth=1.8, label=f"{label}, {len(seeds)} seeds", **line(color))
    return median


def draw_long_runs(name: str, logs: Logs = LOGS) -> Figure:
    """Mean value, mean squared Hamiltonian and speed against trials; below, the peak and fall of each seed."""
    table = read_table(Path(logs) / f"{name}.csv")
    present = [preset for preset in PRESETS if preset in table["preset"]]
    figure = Figure(figsize=(8.0, 9.6), layout="constrained")
    value, hamiltonian, speed, fall = figure.subplots(4, 1, height_ratios=[1, 1, 1.3, 1])
    for axes in (value, hamiltonian, speed, fall):
        plain_axes(axes)
    for axes, quantity in (
        (value, "mean_value"),
        (hamiltonian, "mean_squared_hamiltonian"),
        (speed, "speed"),
    ):
        medians = [_runs(axes, rows_where(table, preset=one), quantity, *PRESETS[one]) for one in present]
        mark_ends(axes, medians)
    for axes in (hamiltonian, speed):
        axes.sharex(value)
    for axes in (value, hamiltonian, speed):
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
    log_axis(hamiltonian, "y")
    speed.set_ylim(bottom=min(0.0, speed.get_ylim()[0]))
    value.set_ylabel(r"$\langle V \rangle_S$  (m)")
    hamiltonian.set_ylabel(r"$\langle H^2 \rangle_S$  (m$^2$/s$^2$)")
    speed.set_ylabel("swimming speed  (m/s)")
    speed.set_xlabel("trials")
    handles, _ = value.get_legend_handles_labels()
    if len({rows_where(table, preset=one)["trial"].max() for one in present}) > 1:
        handles.append(end_key("its runs end"))
    value.legend(
        handles=handles,
        frameon=False,
        fontsize=9,
        ncols=3,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        handlelength=HANDLE,
    )

    ticks, names = [], []
    x = 0
    for preset in present:
        color, label = PRESETS[preset]
        first = x
        for run in peaks(table, preset):
            fall.plot([x, x], [run.fell_to, run.fell_from], color=color, linewidth=1.0, alpha=0.6)
            fall.plot(x, run.peak, "o", color=color, markersize=5, label="peak" if x == 0 else None)
            fall.plot(
                x,
                run.fell_to,
                "_",
                color=color,
                markersize=9,
                label="deepest fall from the best until then" if x == 0 else None,
            )
            fall.plot(
                x,
                run.last,
                "D",
                color=color,
                markersize=4,
                markerfacecolor="white",
                label="last" if x == 0 else None,
            )
            ticks.append(x)
            names.append(str(run.seed))
            x += 1
        fall.text(
            (first + x - 1) / 2, -0.2, f"seed, {label}", transform=fall.get_xaxis_transform(), ha="center",
            va="top",
        )  # fmt: skip
        x += 1
    fall.set_xticks(ticks, names)
    fall.margins(x=0.03)
    fall.set_ylabel("swimming speed  (m/s)")
    fall.set_ylim(bottom=min(0.0, fall.get_ylim()[0]))
    fall.legend(frameon=False, fontsize=9, ncols=3, loc="lower left", bbox_to_anchor=(0, 1))
    return figure


def draw_what_decides(logs: Logs = LOGS) -> Figure:
    """Speed at the end of learning with one choice changed: each seed, and the mean with its 95 % interval."""
    table = read_table(Path(logs) / what_decides.LOG)
    settings = settings_of(table)
    figure = Figure(figsize=(7.6, 0.3 * len(settings) + 1.4), layout="constrained")
    axes = figure.subplots()
    plain_axes(axes)
    final = []
    for factor, setting in settings:
        rows = rows_where(table, factor=factor, setting=setting)
        final.append(rows["speed"][rows["simulated_seconds"] == rows["simulated_seconds"].max()])
    for y, speeds in enumerate(final):
        mean, interval = mean_and_interval(speeds)
        color = INK if y == 0 else BLUE
        axes.plot(speeds, np.full(len(speeds), y), "|", color=GREY, markersize=9)
        axes.plot(interval, [y, y], color=color, linewidth=2.2, solid_capstyle="butt")
        axes.plot(mean, y, "o", color=color, markersize=6)
    axes.axvline(float(np.mean(final[0])), linewidth=0.8, **line(INK))
    axes.set_yticks(range(len(settings)), [f"{factor}: {setting}" for factor, setting in settings])
    axes.set_ylim(len(settings) - 0.4, -0.6)
    seconds = float(table["simulated_seconds"].max())
    axes.set_xlabel(f"swimming speed after {seconds:,.0f} s of simulated time  (m/s)")
    figure.suptitle(f"{len(final[0])} seeds: each, mean and 95 % interval of the mean", fontsize=10)
    return figure
