"""Curves: the progress of learning (figure 2), and what happens in one episode."""

from __future__ import annotations

import csv
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.render.figures import BLUE, GREY, HANDLE, INK, ORANGE, line, log_axis, nth_line, plain_axes
from swimmer_mj.trajectory import Trajectory

if TYPE_CHECKING:
    from swimmer_mj.learning.runs.evaluation import Episode

__all__ = [
    "METRICS",
    "OPEN_LOOP_SPEED",
    "control_lanes",
    "episode_plot",
    "learning_curve",
    "read_metrics",
    "rollout_plot",
]

Array = NDArray[np.float64]

METRICS = ("trial", "seconds", "mean_value", "mean_squared_hamiltonian", "speed")
"""Columns of a run's metrics.csv: -, s, m, m^2/s^2, m/s."""

OPEN_LOOP_SPEED = {3: 0.75, 4: 0.48, 5: 0.61}
"""Of the best open-loop wave of bang-bang torques, by number of links, m/s: benchmarks/open_loop_wave.py."""


def read_metrics(path: str | os.PathLike[str]) -> dict[str, Array]:
    """Read the columns of a metrics.csv by name, each of shape (evaluations,).

    Columns besides :data:`METRICS` are ignored, and so is a last line that is still being written.
    """
    with open(path, newline="", encoding="utf-8") as file:
        text = file.read()
    lines = text[: text.rfind("\n") + 1].splitlines()
    reader = csv.DictReader(lines)
    if missing := [name for name in METRICS if name not in (reader.fieldnames or [])]:
        raise ValueError(f"{os.fspath(path)} lacks the column {missing[0]!r}")
    try:
        rows = [[float(row[name]) for name in METRICS] for row in reader]
    except (TypeError, ValueError) as error:
        raise ValueError(f"{os.fspath(path)}, line {reader.line_num}: {error}") from None
    if not rows:
        raise ValueError(f"{os.fspath(path)} has no rows")
    return dict(zip(METRICS, np.array(rows).T, strict=True))


def learning_curve(
    runs: Sequence[tuple[str, str | os.PathLike[str]]],
    *,
    reference_speed: float | None = None,
    measure: str = "swimming speed",
    units: tuple[str, str, str] | None = ("m", "m$^2$/s$^2$", "m/s"),
    against: Literal["trial", "seconds"] = "trial",
) -> Figure:
    """Mean value, mean squared Hamiltonian and speed against trials or time, after figure 2.

    Parameters
    ----------
    runs : sequence of (label, path of a metrics.csv)
        A run is one line in each panel. A star marks its fastest evaluation, the best checkpoint.
    reference_speed : float, optional
        A speed to compare with, m/s: a dashed line, such as :data:`OPEN_LOOP_SPEED` [5].
    measure : str
        What the column ``speed`` has: of a problem that is no swimmer, the mean reward rate.
    units : (str, str, str), optional
        Of V, of H^2 and of the speed; None where they are not known.
    against : {"trial", "seconds"}
        Trials, or seconds of learning: trials of two methods are hardly alike.
    """
    if not runs:
        raise ValueError("a learning curve needs at least one run")
    metrics = [(label, read_metrics(path)) for label, path in runs]
    figure = Figure(figsize=(7.2, 7.4), layout="constrained")
    value, hamiltonian, speed = figure.subplots(3, 1, sharex=True)
    for axes in (value, hamiltonian, speed):
        plain_axes(axes)

    for i, (label, run) in enumerate(metrics):
        few = "o" if run["trial"].size < 3 else None  # a line through one or two points shows nothing
        style = {"linewidth": 1.5, "marker": few, "markersize": 3.5, **nth_line(i)}
        value.plot(run[against], run["mean_value"], label=label, **style)
        hamiltonian.plot(run[against], run["mean_squared_hamiltonian"], **style)
        speed.plot(run[against], run["speed"], **style)
        if np.isfinite(run["speed"]).any():
            best = int(np.nanargmax(run["speed"]))
            speed.plot(
                run[against][best],
                run["speed"][best],
                "*",
                color=style["color"],
                markersize=13,
                markeredgecolor="white",
                label="best",
                zorder=3,
            )
    if reference_speed is not None:
        speed.axhline(
            reference_speed,
            linewidth=1.1,
            label=f"open-loop wave, {reference_speed:g} m/s",
            **line(INK),
        )
    names = (r"$\langle V \rangle_S$", r"$\langle H^2 \rangle_S$", measure)
    for i, (axes, name) in enumerate(zip((value, hamiltonian, speed), names, strict=True)):
        axes.set_ylabel(name if units is None else f"{name}  ({units[i]})")
    speed.set_xlabel({"trial": "trials", "seconds": "learning  (s)"}[against])
    speed.xaxis.set_major_formatter(EngFormatter(sep=""))
    if all((run["mean_squared_hamiltonian"] > 0).any() for _, run in metrics):
        log_axis(hamiltonian, "y")
    if len(metrics) > 1:
        columns = min(len(metrics), 4)
        value.legend(**_above(columns))
    handles, labels = speed.get_legend_handles_labels()
    if labels:
        unique = dict(zip(labels, handles, strict=True))  # one star stands for all
        speed.legend(unique.values(), unique.keys(), **_above(2))
    figure.align_ylabels()
    return figure


def _above(columns: int) -> dict[str, Any]:
    """Where a legend stands: above its axes, so that it covers nothing."""
    return {
        "frameon": False,
        "fontsize": 9,
        "ncols": columns,
        "loc": "lower left",
        "bbox_to_anchor": (0, 1),
        "handlelength": HANDLE,
    }


def rollout_plot(trajectory: Trajectory) -> Figure:
    """Angles, torques, speed, and V and H along one episode, in four panels over one time axis.

    V and H are left out of their panel where the trajectory does not know them.
    """
    n, times = trajectory.parameters.n_links, trajectory.times
    figure = Figure(figsize=(8.4, 8.8), layout="constrained")
    angle, torque, speed, value = figure.subplots(4, 1, sharex=True, height_ratios=[1.2, 1.0, 1.0, 1.0])
    for axes in (angle, torque, speed, value):
        plain_axes(axes)

    angles = np.degrees(st.split(trajectory.states, n).angles)
    for i in range(n):
        angle.plot(times, angles[:, i], linewidth=1.3, label=rf"$\theta_{{{i + 1}}}$", **nth_line(i))
    angle.set_ylabel("angle  (degrees)")
    angle.legend(**_above(min(n, 8)))

    limits = trajectory.parameters.torque_limits
    scale = control_lanes(torque, times, trajectory.controls, limits, " N·m")
    torque.set_ylabel(f"torque\n(lane: {scale})" if limits.size else "no joints")

    speed.plot(times, trajectory.speeds(), color=BLUE, linewidth=1.3)
    if trajectory.n_steps:
        mean = trajectory.speed(times[0])
        speed.axhline(mean, linewidth=1.1, label=f"mean {mean:.2f} m/s", **line(INK))
        speed.legend(**_above(1))
    speed.set_ylabel("speed along\ntarget  (m/s)")

    _value_and_hamiltonian(value, times, trajectory.values, trajectory.hamiltonians, ("  (m)", "  (m/s)"))
    figure.align_ylabels([angle, torque, speed, value])
    return figure


def episode_plot(episode: Episode) -> Figure:
    """States, controls, reward rate, and V and H along an episode of any problem, in panels over one time axis."""
    times, p = episode.times, episode.states.shape[1]
    figure = Figure(figsize=(8.4, 8.8), layout="constrained")
    state, control, reward, value = figure.subplots(4, 1, sharex=True, height_ratios=[1.2, 1.0, 1.0, 1.0])
    for axes in (state, control, reward, value):
        plain_axes(axes)
    for i in range(p):
        state.plot(times, episode.states[:, i], linewidth=1.3, label=f"$x_{{{i + 1}}}$", **nth_line(i))
    state.legend(**_above(min(p, 8)))
    state.set_ylabel("state")
    scale = control_lanes(control, times, episode.controls, episode.problem.control_limits)
    control.set_ylabel(f"control\n(lane: {scale})")
    reward.set_ylabel("reward rate")
    reward.plot(times, episode.rewards, color=BLUE, linewidth=1.3)
    _value_and_hamiltonian(value, times, episode.values, episode.hamiltonians, ("", ""))
    figure.suptitle(episode.problem.name, x=0.99, ha="right", fontsize=10)
    figure.align_ylabels([state, control, reward, value])
    return figure


def _value_and_hamiltonian(axes: Axes, times: Array, V: Array, H: Array, units: tuple[str, str]) -> None:
    """Draw V and, on an axis of its own, H; what is not known is left out."""
    twin = axes.twinx()
    twin.spines["top"].set_visible(False)
    for panel, series, name, unit, color, width in (
        (axes, V, "$V$", units[0], BLUE, 1.3),
        (twin, H, "$H$, dashed", units[1], ORANGE, 1.0),
    ):
        panel.plot(times, series, linewidth=width, **line(color))
        panel.set_ylabel(name + unit, color=color)
        if not np.isfinite(series).any():
            panel.set_yticks([])
            panel.set_ylabel("")
    axes.set_xlabel("time  (s)")


def control_lanes(axes: Axes, times: Array, controls: Array, limits: Array, unit: str = "") -> str:
    """Draw a lane a control, u_1 on top: filled upwards where it is positive, else downwards; returns their height."""
    for i, limit in enumerate(limits):
        lane, u = -float(i), controls[:, i] / limit
        axes.axhline(lane, color=GREY, linewidth=0.5)
        if u.size:
            for part, color in ((u.clip(min=0), BLUE), (u.clip(max=0), ORANGE)):
                axes.stairs(lane + 0.42 * part, times, baseline=lane, fill=True, color=color)
    axes.grid(visible=False, axis="y")
    axes.set_yticks(-np.arange(len(limits)), [f"$u_{{{i + 1}}}$" for i in range(len(limits))])
    axes.set_ylim(-len(limits) + 0.4, 0.6)
    same = np.unique(limits)
    return f"$\\pm${same[0]:g}{unit}" if same.size == 1 else "$\\pm U_i$"
