"""The paper's claims as figures, drawn from the logs of :mod:`swimmer_mj.learning.experiments`.

Every function takes the directory of the logs, the committed ones by default. :data:`FIGURES` has them by the name of
the experiment that writes the logs.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, FixedFormatter, FixedLocator, NullLocator
from numpy.typing import NDArray

from swimmer_mj.learning.experiments import (
    figure_1,
    hamiltonians,
    linear_approximators,
    section_3_3,
    value_bias,
)
from swimmer_mj.learning.experiments.tables import LOGS, Path, Table, read_table, rows_where
from swimmer_mj.render.at_length import (
    draw_linear_swimmer,
    draw_noise_at_length,
    draw_rates_at_length,
    draw_raw_angles,
)
from swimmer_mj.render.bands import NAMES, band, end_key, mark_ends, quartiles
from swimmer_mj.render.figures import (
    BLUE,
    COLORS,
    GREEN,
    GREY,
    HANDLE,
    INK,
    ORANGE,
    PINK,
    line,
    plain_axes,
)
from swimmer_mj.render.long_runs import draw_long_runs, draw_what_decides
from swimmer_mj.render.second_order import draw_section_3_4
from swimmer_mj.render.value_gradients import draw_ablation, draw_lasting, draw_links

__all__ = [
    "FIGURES",
    "draw_figure_1",
    "draw_hamiltonian",
    "draw_linear",
    "draw_section_3_3",
    "draw_value_bias",
]

Array = NDArray[np.float64]
Logs = str | os.PathLike[str]
Below = Literal["outside lower center", "outside lower right"]


def _legend_above(axes: Axes, columns: int) -> None:
    axes.legend(
        frameon=False,
        fontsize=9,
        ncols=columns,
        loc="lower left",
        bbox_to_anchor=(0, 1),
        handlelength=HANDLE,
    )


def _legend_below(figure: Figure, axes: Axes, where: Below = "outside lower center") -> None:
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        frameon=False,
        fontsize=9,
        ncols=len(labels),
        loc=where,
        handlelength=HANDLE,
    )


def _ticks_at(axes: Axes, places: Sequence[float], labels: Sequence[str]) -> None:
    axes.xaxis.set_major_locator(FixedLocator(list(places)))
    axes.xaxis.set_major_formatter(FixedFormatter(list(labels)))
    axes.xaxis.set_minor_locator(NullLocator())


# Figure 1 --------------------------------------------------------------------------------------------------------

PALE = "#b0b0b0"
"""Of the many weights beside the few blue ones: grey print tells them apart."""


def extreme_weights(table: Table, method: str = "basic") -> tuple[int, int]:
    """Indices of the weights with the largest and the smallest noise at the end of a run of figure 1.

    The noise of a weight is the mean of sqrt(v) over the second half of the run.
    """
    noise = _weights(rows_where(table, method=method, quantity="noise"))
    mean = noise[len(noise) // 2 :].mean(axis=0)
    return int(mean.argmax()), int(mean.argmin())


def _weights(table: Table) -> Array:
    """The columns w0, w1, ..., shape (rows, weights)."""
    return np.stack([table[name] for name in table if name[0] == "w" and name[1:].isdigit()], axis=1)


def draw_figure_1(logs: Logs = LOGS) -> Figure:
    """Two weights under the basic algorithm and under vario-eta; noise and rates of all 66; mean reward over seeds."""
    table = read_table(Path(logs) / figure_1.WEIGHTS_LOG)
    rewards = read_table(Path(logs) / figure_1.REWARD_LOG)
    fast, slow = extreme_weights(table)
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True)
    for axes in panels.flat:
        plain_axes(axes)
        axes.xaxis.set_major_formatter(EngFormatter(sep=""))

    panels[0, 1].sharey(panels[0, 0])
    panels[1, 1].sharey(panels[1, 0])
    for axes, method in zip(panels[0], figure_1.METHODS, strict=False):
        run = rows_where(table, method=method, quantity="weight")
        weights = _weights(run)
        for k, color, label in (
            (fast, BLUE, "$w_1$, the noisiest of all"),
            (slow, ORANGE, "$w_2$, the least noisy"),
        ):
            axes.plot(run["trial"], weights[:, k], linewidth=1.4, label=label, **line(color))
        axes.set_title("basic algorithm, one rate" if method == "basic" else r"vario-$\eta$", fontsize=10)
    panels[0, 0].set_ylabel("weight")
    panels[0, 0].legend(frameon=False, fontsize=9, handlelength=HANDLE)

    for method, color in zip(figure_1.METHODS, (GREY, BLUE), strict=True):
        label = "basic" if method == "basic" else r"vario-$\eta$"
        band(panels[0, 2], rows_where(rewards, method=method), "trial", "reward", color, label)
    panels[0, 2].set_title(f"{len(np.unique(rewards['seed']))} seeds, median and quartiles", fontsize=10)
    panels[0, 2].set_ylabel(r"mean reward $\cos\,\theta$")
    panels[0, 2].legend(frameon=False, fontsize=9, loc="lower right", handlelength=HANDLE)

    for axes, method, quantity in (
        (panels[1, 0], "basic", "noise"),
        (panels[1, 1], "vario-eta", "noise"),
        (panels[1, 2], "vario-eta", "rate"),
    ):
        run = rows_where(table, method=method, quantity=quantity)
        lines = _weights(run)
        shown = lines > 0  # the noise is 0 before the first trial
        output = lines.shape[1] - (figure_1.N_HIDDEN + 1)
        for k in range(lines.shape[1]):
            color, label = (BLUE, "to the output unit") if k >= output else (PALE, "to hidden units")
            first = k in (0, output)
            axes.plot(
                run["trial"][shown[:, k]],
                lines[shown[:, k], k],
                color=color,
                linewidth=0.7,
                alpha=0.8,
                zorder=2 + (k >= output),
                label=label if first else None,
            )
        axes.set_yscale("log")
        axes.set_ylabel(r"noise $\sqrt{v_i}$" if quantity == "noise" else r"rate $\eta_i$")
        axes.set_xlabel("trials")
    _legend_below(figure, panels[1, 0])
    figure.align_ylabels()
    return figure


# Section 3.3 -----------------------------------------------------------------------------------------------------


def draw_section_3_3(logs: Logs = LOGS) -> Figure:
    """Noise of output connections over that of internal ones against n, and how internal ones spread."""
    table = read_table(Path(logs) / section_3_3.LOG)
    table["ratio"] = table["output"] / table["internal"]
    problems = [name for name in NAMES if name in table["problem"]]
    figure = Figure(figsize=(5.2 * len(problems), 7.4), layout="constrained")
    panels = figure.subplots(2, len(problems), sharex="col", sharey="row", squeeze=False)
    for column, problem in enumerate(problems):
        rows = rows_where(table, problem=problem)
        sizes = np.unique(rows["n"]).tolist()
        top, bottom = panels[:, column]
        for axes in (top, bottom):
            plain_axes(axes)
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.margins(x=0.08)
            _ticks_at(axes, sizes, [f"{size:g}" for size in sizes])
        top.plot(sizes, sizes, linewidth=1.1, label="ratio = n", **line(INK))
        moments = np.unique(rows["trial"])
        for k, trial in enumerate(moments[::-1]):
            marker, color = "osv^D"[k % 5], str(0.42 + 0.3 * k / len(moments)) if k else BLUE
            for scaling, style in ((1, "-"), (0, ":")):
                now = rows_where(rows, trial=trial, output_scaling=scaling)
                if not now["n"].size:
                    continue
                at, low, middle, high = quartiles(now, "n", "ratio")
                last = trial == moments[-1]
                label = f"{trial:,.0f} trials, {'scaled' if scaling else 'one rate'}"
                top.plot(
                    at,
                    middle,
                    style,
                    color=color,
                    marker=marker,
                    markersize=5 if last else 3,
                    linewidth=1.7 if last else 0.9,
                    label=label,
                    zorder=3 if last else 2,
                )
                if last:
                    shift = 1.02 if scaling else 0.98
                    top.vlines(at * shift, low, high, color=color, linewidth=1.0)
        end = rows_where(rows, trial=moments[-1], output_scaling=1)
        seeds = len(np.unique(rows["seed"]))
        over = "1 seed" if seeds == 1 else f"{seeds} seeds: median, quartiles"
        top.set_title(f"{NAMES[problem]} ({over})", fontsize=10)
        handles, _ = top.get_legend_handles_labels()
        top.legend(handles=[handles[0], *handles[:0:-1]], frameon=False, fontsize=7.5, handlelength=HANDLE)
        for name, color, marker, label in (
            ("from_inputs", GREEN, "o", "mean, from inputs and bias"),
            ("from_neurons", PINK, "s", "mean, from hidden neurons"),
            ("internal_p95", GREY, "^", "95th percentile of single connections"),
            ("internal_p05", GREY, "v", "5th percentile"),
        ):
            end[name] = end[name] / end["internal_p50"]
            at, low, middle, high = quartiles(end, "n", name)
            bottom.plot(at, middle, marker=marker, markersize=4, linewidth=1.3, label=label, **line(color))
            bottom.fill_between(at, low, high, color=color, alpha=0.15, linewidth=0)
        bottom.axhline(1, color=INK, linewidth=0.8)
        bottom.set_xlabel("neurons n")
    panels[0, 0].set_ylabel("$v$ of output connections / internal ones  (means)")
    panels[1, 0].set_ylabel("$v$ of internal connections / their median")
    _legend_below(figure, panels[1, 0])
    figure.align_ylabels()
    return figure


# Linear approximators --------------------------------------------------------------------------------------------

SECONDS_PER_TICK = 1e-2
"""Simulated time of one evaluation: beyond this, learning is slower than the swimmer."""


def draw_linear(logs: Logs = LOGS) -> Figure:
    """Learning curves on the pendulum, and what the approximators cost as the number of links grows."""
    learning = read_table(Path(logs) / linear_approximators.LEARNING_LOG)
    cost = read_table(Path(logs) / linear_approximators.COST_LOG)
    figure = Figure(figsize=(12.0, 4.2), layout="constrained")
    curve, weights, seconds = figure.subplots(1, 3)
    for axes in (curve, weights, seconds):
        plain_axes(axes)
    ends = []
    for name, color, marker in zip(linear_approximators.APPROXIMATORS, COLORS, "os^", strict=False):
        look = {"marker": marker, "markersize": 4, **line(color)}
        band(curve, rows_where(learning, approximator=name), "trial", "reward", color, name)
        rows = rows_where(cost, approximator=name)
        links, size, time = rows["links"], rows["weights"], rows["seconds"]
        label = {
            "cascade": "cascade of 12 n neurons",
            "radial basis": "radial basis, 5 a variable",
            "tile coding": "8 tilings, 5 tiles a variable",
        }[name]
        weights.plot(links, size, linewidth=1.5, label=label, **look)
        measured = np.isfinite(time)
        found = seconds.plot(links[measured], time[measured], linewidth=1.5, **look)
        if name == "tile coding":  # it looks up few of its weights: their number says nothing of its time
            ends += found
        elif not measured.all():
            last = np.flatnonzero(measured)[-1]
            beyond = time[last] * (size[last:] / size[last]) * (2 * links[last:] + 2) / (2 * links[last] + 2)
            seconds.plot(
                links[last:],
                beyond,
                linewidth=1.2,
                markerfacecolor="white",
                label="extrapolated",
                **(look | {"linestyle": ":"}),
            )
    mark_ends(seconds, ends)
    for axes in (weights, seconds):
        axes.set_yscale("log")
        axes.set_xlabel("links n  (2n + 2 state variables)")
        axes.margins(x=0.04)
        axes.xaxis.set_major_locator(FixedLocator(np.unique(cost["links"]).tolist()))
    byte = 8
    weights.axhline(24 * 2**30 / byte, linewidth=1.0, **line(INK))
    weights.text(2, 1.5 * 24 * 2**30 / byte, "24 GiB", color=INK, fontsize=8, va="bottom")
    seconds.axhline(SECONDS_PER_TICK, linewidth=1.0, **line(INK))
    seconds.text(10, 1.5 * SECONDS_PER_TICK, "real time, dt = 0.01 s", color=INK, fontsize=8, ha="right")
    curve.set_xlabel("trials")
    curve.set_ylabel(r"mean reward $\cos\,\theta$")
    curve.set_title(f"pendulum, {len(np.unique(learning['seed']))} seeds", fontsize=10)
    curve.legend(frameon=False, fontsize=9, loc="lower right", handlelength=HANDLE)
    weights.set_ylabel("weights")
    weights.set_title("swimmer of n links", fontsize=10)
    weights.legend(frameon=False, fontsize=8, loc="upper left", handlelength=HANDLE)
    seconds.set_ylabel("time of V, dV/dx and control  (s)")
    seconds.set_title("swimmer of n links", fontsize=10)
    handles, _ = seconds.get_legend_handles_labels()
    handles.append(end_key("larger tables were not built"))
    seconds.legend(handles=handles, frameon=False, fontsize=8, loc="upper left", handlelength=HANDLE)
    return figure


# H both ways -----------------------------------------------------------------------------------------------------


def draw_hamiltonian(logs: Logs = LOGS) -> Figure:
    """Both forms of H along one episode; their difference against dt; learning with either on the pendulum."""
    episode = read_table(Path(logs) / hamiltonians.EPISODE_LOG)
    table = read_table(Path(logs) / hamiltonians.DT_LOG)
    learning = read_table(Path(logs) / hamiltonians.LEARNING_LOG)
    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=[1, 1.05])[:, 0]
    left, right = below.subfigures(1, 2, squeeze=False, width_ratios=[1.05, 1])[0]
    top, by_dt = above.subplots(), left.subplots()
    reward, bias = right.subplots(1, 2)
    for axes in (top, by_dt, reward, bias):
        plain_axes(axes)

    time = episode["time"]
    top.plot(
        time,
        episode["gradient"],
        linewidth=1.6,
        zorder=3,  # its dashes let the other be seen
        label=r"$r - s_\gamma V + \partial V/\partial x\cdot f$",
        **line(ORANGE),
    )
    top.plot(
        time,
        episode["difference"],
        linewidth=1.2,
        label=r"$r - s_\gamma V + \Delta V/dt$",
        **line(BLUE),
    )
    switching = episode["switched"] > 0
    top.plot(
        time[switching],
        np.full(switching.sum(), 0.02),
        "|",
        color=INK,
        markersize=7,
        transform=top.get_xaxis_transform(),
        label="a control switches",
    )
    top.set_xlabel("time  (s)")
    top.set_ylabel("$H$  (m/s)")
    top.set_title("swimmer, one episode, dt = 0.01 s", fontsize=10, loc="right")
    _legend_above(top, 3)

    by_dt.plot(table["dt"], table["rms_gradient"], linewidth=1.0, label="rms of $H$ itself", **line(INK))
    for name, color, style, marker, label in (
        ("rms_excess_switching", ORANGE, ":", "o", "rms, a control switches"),
        ("rms_excess_other", BLUE, ":", "s", "rms, other steps"),
        ("mean_excess_switching", ORANGE, "-", "o", "mean, a control switches"),
        ("mean_excess_other", BLUE, "-", "s", "mean, other steps"),
        ("rms_unexplained", GREY, "-", "D", "rms of what the second-\norder term leaves"),
    ):
        by_dt.plot(
            table["dt"],
            table[name],
            style,
            color=color,
            marker=marker,
            markersize=4,
            linewidth=1.3,
            label=label,
        )
    by_dt.set_xscale("log")
    by_dt.set_yscale("log")
    by_dt.set_xlabel("dt  (s)")
    by_dt.set_ylabel(r"$H$ by $\partial V/\partial x\cdot f$ less $H$ by $\Delta V/dt$  (m/s)")
    left.legend(
        *by_dt.get_legend_handles_labels(),
        frameon=False,
        fontsize=8,
        loc="outside center right",
        handlelength=HANDLE,
    )

    for form, color in (("gradient", ORANGE), ("difference", BLUE)):
        rows = rows_where(learning, form=form)
        band(
            reward,
            rows,
            "trial",
            "reward",
            color,
            r"$\partial V/\partial x\cdot f$" if form == "gradient" else r"$\Delta V/dt$",
        )
        band(bias, rows, "trial", "bias", color, form)
    seeds = len(np.unique(learning["seed"]))
    for axes, label in ((reward, r"mean reward $\cos\,\theta$"), (bias, "bias of V  (s)")):
        axes.set_xlabel("trials")
        axes.set_ylabel(label)
    right.suptitle(f"pendulum, radial basis, {seeds} seeds: median and quartiles", fontsize=10)
    bias.axhline(0, color=INK, linewidth=0.8)
    reward.legend(frameon=False, fontsize=9, loc="lower right", handlelength=HANDLE)
    return figure


# V against the return --------------------------------------------------------------------------------------------


def draw_value_bias(logs: Logs = LOGS) -> Figure:
    """V against the Monte Carlo return at several moments of training, and its bias and rmse over seeds."""
    states = read_table(Path(logs) / value_bias.STATES_LOG)
    table = read_table(Path(logs) / value_bias.TABLE_LOG)
    problems = [name for name in NAMES if name in table["problem"]]
    units = {"pendulum": "s", "swim5": "m"}
    count = max(len(np.unique(rows_where(states, problem=name)["trial"])) for name in problems)
    figure = Figure(figsize=(2.5 * (count + 1.3), 2.9 * len(problems) + 0.3), layout="constrained")
    panels = figure.subplots(len(problems), count + 1, squeeze=False, width_ratios=[1] * count + [1.3])
    for row, problem in enumerate(problems):
        unit = units[problem]
        points, errors = rows_where(states, problem=problem), rows_where(table, problem=problem)
        both = np.concatenate([points["value"], points["return"]])
        low, high = both.min(), both.max()
        margin = 0.04 * (high - low)
        first_seed = errors["seed"][0]
        for axes, trial in zip(panels[row], np.unique(points["trial"]), strict=False):
            plain_axes(axes)
            now = rows_where(points, trial=trial)
            axes.plot([low, high], [low, high], color=INK, linewidth=0.8)
            axes.plot(
                now["return"], now["value"], ".", color=BLUE, markersize=4, alpha=0.7, markeredgewidth=0
            )
            axes.set(xlim=(low - margin, high + margin), ylim=(low - margin, high + margin))
            axes.set_aspect("equal")
            error = rows_where(errors, trial=trial, seed=first_seed)
            axes.set_title(
                f"{trial:,.0f} trials\nbias {error['bias'][0]:+.2f}, r = {error['correlation'][0]:.2f}",
                fontsize=9,
            )
            axes.set_xlabel(f"return  ({unit})")
        panels[row, 0].set_ylabel(f"{NAMES[problem]}\n$V$  ({unit})")
        summary = panels[row, -1]
        plain_axes(summary)
        for name, color, label in (("bias", ORANGE, "bias"), ("deviation", BLUE, "deviation")):
            band(summary, errors, "trial", name, color, label)
        summary.axhline(0, color=INK, linewidth=0.8)
        summary.set_xscale("log")
        trials = np.unique(errors["trial"]).tolist()
        _ticks_at(summary, trials, [f"{trial / 1000:g}k" for trial in trials])
        for axes in panels[row, len(trials) : -1]:
            axes.set_visible(False)
        summary.set_xlabel("trials")
        summary.set_ylabel(f"$V$ - return  ({unit})")
        seeds = len(np.unique(errors["seed"]))
        summary.set_title(f"{seeds} seeds" + (": median, quartiles" if seeds > 2 else ""), fontsize=9)
    _legend_below(figure, panels[0, -1], "outside lower right")
    return figure


FIGURES: dict[str, Callable[[Logs], Figure]] = {
    "figure-1": draw_figure_1,
    "figure-2": partial(draw_long_runs, "swim5"),
    "figure-2-3-links": partial(draw_long_runs, "swim3"),
    "figure-2-4-links": partial(draw_long_runs, "swim4"),
    "raw-angles": draw_raw_angles,
    "section-3.3": draw_section_3_3,
    "noise-at-length": draw_noise_at_length,
    "section-3.4": draw_section_3_4,
    "rates-at-length": draw_rates_at_length,
    "linear": draw_linear,
    "linear-swimmer": draw_linear_swimmer,
    "hamiltonian": draw_hamiltonian,
    "value-bias": draw_value_bias,
    "what-decides": draw_what_decides,
    "value-gradient-ablation": draw_ablation,
    "value-gradient-links": draw_links,
    "value-gradient-lasting": draw_lasting,
}
"""What draws the logs of each experiment."""
