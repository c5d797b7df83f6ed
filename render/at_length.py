"""The paper's choices followed further than its figures go: inputs, rates and noise, drawn from the logs."""

from __future__ import annotations

import os

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter

from swimmer_mj.intervals import mean_and_interval
from swimmer_mj.learning.experiments import linear_swimmer, long_runs, noise_at_length, rates_at_length
from swimmer_mj.learning.experiments.section_3_3 import power_of_n
from swimmer_mj.learning.experiments.section_3_4 import METHODS
from swimmer_mj.learning.experiments.tables import LOGS, Path, last_look, read_table, rows_where
from swimmer_mj.render.bands import band, end_key, mark_ends, quartiles
from swimmer_mj.render.figures import (
    BLUE,
    COLORS,
    GREY,
    HANDLE,
    INK,
    ORANGE,
    line,
    log_axis,
    plain_axes,
)
from swimmer_mj.render.second_order import METHOD_COLORS, METHOD_LABELS

__all__ = ["draw_linear_swimmer", "draw_noise_at_length", "draw_rates_at_length", "draw_raw_angles"]

Logs = str | os.PathLike[str]

TITLES = {
    "swim5": "cosines and sines of the angles",
    "swim5-angle": "angles within a turn",
    "swim5-unwrapped": "angles, turns counted",
}
PRESETS = {
    "paper": (BLUE, r"$\eta$ = 0.01 (the paper's)"),
    "quarter": (ORANGE, r"$\eta$ = 0.0025"),
}


def draw_raw_angles(logs: Logs = LOGS) -> Figure:
    """Mean value and speed against trials by what the network hears; runs that diverged end where they did."""
    logs = Path(logs)
    tables = {name: read_table(logs / f"{name}.csv") for name in long_runs.ANGLES}
    end = max(float(table["trial"].max()) for table in tables.values())
    tables = {"swim5": long_runs.paper_runs(logs, end), **tables}
    figure = Figure(figsize=(10.5, 6.0), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey="row")
    for (speed, value), (name, table) in zip(panels.T, tables.items(), strict=True):
        for axes in (speed, value):
            plain_axes(axes)
        for preset, (color, label) in PRESETS.items():
            rows = rows_where(table, preset=preset)
            if rows["seed"].size:
                for axes, quantity in ((speed, "speed"), (value, "mean_value")):
                    band(axes, rows, "trial", quantity, color, label)
        for axes in (speed, value):
            mark_ends(axes, list(axes.lines))
        speed.set_title(TITLES[name], fontsize=10)
        value.set_xlabel("trials")
        value.xaxis.set_major_formatter(EngFormatter(sep=""))
    value = panels[1, 0]
    value.set_yscale("symlog", linthresh=1.0)
    panels[0, 0].set_ylabel("swimming speed  (m/s)")
    value.set_ylabel(r"$\langle V \rangle_S$  (m)")
    handles, _ = panels[0, 1].get_legend_handles_labels()
    handles.append(end_key("weights no longer finite"))
    figure.legend(handles=handles, loc="outside upper left", ncols=3, frameon=False, handlelength=HANDLE)
    figure.align_ylabels()
    return figure


def draw_rates_at_length(logs: Logs = LOGS) -> Figure:
    """Swimming speed by the four ways to set rates, against trials, and of each seed at the end."""
    table = read_table(Path(logs) / rates_at_length.LEARNING_LOG)
    figure = Figure(figsize=(9.6, 4.2), layout="constrained")
    curve, at_end = figure.subplots(1, 2, sharey=True, width_ratios=[2.2, 1])
    for axes in (curve, at_end):
        plain_axes(axes)
    for k, method in enumerate(METHODS):
        color = METHOD_COLORS[method]
        rows = rows_where(table, method=method)
        band(curve, rows, "trial", "reward", color, METHOD_LABELS[method])
        speeds = last_look(rows)["reward"]
        mean, interval = mean_and_interval(speeds)
        at_end.plot(np.full(len(speeds), k), speeds, "_", color=GREY, markersize=11)
        at_end.plot([k, k], interval, color=color, linewidth=2.2, solid_capstyle="butt")
        at_end.plot(k, mean, "o", color=color, markersize=6)
    curve.xaxis.set_major_formatter(EngFormatter(sep=""))
    curve.set_xlabel("trials")
    curve.set_ylabel("swimming speed  (m/s)")
    curve.set_title(f"{len(np.unique(table['seed']))} seeds: median and quartiles", fontsize=10)
    at_end.set_title("at the end: mean, 95 % interval", fontsize=10)
    at_end.set_xticks(range(len(METHODS)), ["plain", "scaled", r"vario-$\eta$", "L.-M."])
    at_end.set_xlim(-0.6, len(METHODS) - 0.4)
    handles, labels = curve.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper left", ncols=4, frameon=False, handlelength=HANDLE)
    return figure


def draw_noise_at_length(logs: Logs = LOGS) -> Figure:
    """The ratio of variances divided by n along training; and the ratio against n at the last moment, with a power."""
    table = read_table(Path(logs) / noise_at_length.LOG)
    table["per_n"] = table["output"] / table["internal"] / table["n"]
    etas, sizes = np.unique(table["eta"]).tolist(), np.unique(table["n"]).tolist()
    figure = Figure(figsize=(10.5, 4.2), layout="constrained")
    panels = figure.subplots(1, len(etas) + 1)
    for axes, eta in zip(panels, etas, strict=False):
        plain_axes(axes)
        if axes is not panels[0]:
            axes.sharey(panels[0])
        for n, color in zip(sizes, COLORS, strict=False):
            band(axes, rows_where(table, eta=eta, n=n), "trial", "per_n", color, f"n = {n:g}")
        axes.axhline(1, linewidth=1.1, **line(INK))
        log_axis(axes, "x")
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))
        log_axis(axes, "y")
        axes.set_xlabel("trials")
        axes.set_title(rf"$\eta$ = {eta:g}", fontsize=10)
    panels[0].set_ylabel("ratio of variances / n")
    panels[0].legend(frameon=False, fontsize=8, handlelength=HANDLE)
    last = panels[-1]
    plain_axes(last)
    moment = float(table["trial"].max())
    table["ratio"] = table["per_n"] * table["n"]
    for eta, color, marker in zip(etas, (BLUE, ORANGE), "os", strict=False):
        rows = rows_where(table, eta=eta, trial=moment)
        at, low, middle, high = quartiles(rows, "n", "ratio")
        last.vlines(at, low, high, color=color, linewidth=1.2)
        power, error, _ = power_of_n(rows["n"], rows["ratio"])
        label = rf"$\eta$ = {eta:g}: $n^{{{power:.2f} \pm {error:.2f}}}$"
        last.plot(at, middle, marker, color=color, markersize=5, label=label)
        factor = np.exp(np.mean(np.log(rows["ratio"]) - power * np.log(rows["n"])))
        last.plot(at, factor * at**power, linewidth=1.1, **line(color))
    last.plot(sizes, sizes, linewidth=1.1, label="ratio = n", **line(INK))
    log_axis(last, "x")
    log_axis(last, "y")
    last.set_xticks(sizes, [f"{size:g}" for size in sizes])
    last.margins(x=0.08)
    last.set_xlabel("neurons n")
    last.set_ylabel("ratio of variances")
    last.set_title(f"after {moment:,.0f} trials", fontsize=10)
    last.legend(frameon=False, fontsize=8, handlelength=HANDLE)
    return figure


def draw_linear_swimmer(logs: Logs = LOGS) -> Figure:
    """Speed of 3 links by tile coding and by the cascade, against trials and against processor time."""
    table = rows_where(read_table(Path(logs) / linear_swimmer.LOG), stage="final")
    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    by_trial, by_time = figure.subplots(1, 2, sharey=True)
    for axes in (by_trial, by_time):
        plain_axes(axes)
    medians = []
    for name, color in (("cascade", BLUE), ("tile coding", ORANGE)):
        rows = rows_where(table, approximator=name)
        label = f"{name}, {rows['weights'][0]:,.0f} weights"
        band(by_trial, rows, "trial", "speed", color, label)
        for seed in np.unique(rows["seed"]):
            one = rows_where(rows, seed=seed)
            by_time.plot(one["seconds"], one["speed"], color=color, linewidth=0.5, alpha=0.5)
        _, _, middle, _ = quartiles(rows, "trial", "speed")
        _, _, seconds, _ = quartiles(rows, "trial", "seconds")
        medians += by_time.plot(seconds, middle, linewidth=1.8, **line(color))
    mark_ends(by_time, medians)
    log_axis(by_time, "x")
    by_trial.xaxis.set_major_formatter(EngFormatter(sep=""))
    by_trial.set_xlabel("trials")
    by_time.set_xlabel("seconds of a core")
    by_trial.set_ylabel("swimming speed  (m/s)")
    handles, _ = by_trial.get_legend_handles_labels()
    handles.append(end_key(f"its {table['trial'].max():,.0f} trials are over"))
    figure.legend(handles=handles, loc="outside upper left", ncols=3, frameon=False, handlelength=HANDLE)
    return figure
