"""V over two coordinates of the state, about a state of an episode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, MultipleLocator
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.parameters import SwimmerParameters
from swimmer_mj.render.figures import INK, plain_axes
from swimmer_mj.trajectory import Trajectory

if TYPE_CHECKING:
    from swimmer_mj.learning.problems.forms import Policy

__all__ = ["check_coordinates", "coordinate_names", "default_coordinates", "target_frame_states", "value_map"]

Array = NDArray[np.float64]

GRID = 121
"""Points along each axis."""
NEAR = 0.5
"""How much of the episode before the state is drawn, s."""


def coordinate_names(n_links: int) -> tuple[str, ...]:
    """The names of the reduced state's coordinates: theta1 .., omega1 .., vx, vy."""
    numbers = range(1, n_links + 1)
    return (*(f"theta{i}" for i in numbers), *(f"omega{i}" for i in numbers), "vx", "vy")


def check_coordinates(over: Sequence[str], n_links: int) -> tuple[int, int]:
    """Where two coordinates stand in the reduced state; ValueError unless they are two of :func:`coordinate_names`."""
    names = coordinate_names(n_links)
    for name in over:
        if name not in names:
            raise ValueError(
                f"there is no coordinate {name!r} of {n_links} links; there are {', '.join(names)}"
            )
    if len(over) != 2 or over[0] == over[1]:
        raise ValueError(f"V is drawn over two different coordinates, got {' and '.join(over) or 'none'}")
    return names.index(over[0]), names.index(over[1])


def target_frame_states(trajectory: Trajectory) -> Array:
    """The reduced states as a policy for the direction +x is given them, shape (T + 1, 2n + 2)."""
    n = trajectory.parameters.n_links
    z = st.split_reduced(st.reduce(trajectory.parameters, trajectory.states), n)
    direction = trajectory.target_directions
    return st.join_reduced(
        z.angles - direction[:, None], z.angular_velocities, st.rotate(z.velocity, -direction)
    )


def value_map(
    policy: Policy, trajectory: Trajectory, over: Sequence[str], time: float | None = None
) -> Figure:
    """V where two coordinates vary and the others are those of one state of the episode.

    Parameters
    ----------
    policy : Policy
        Whose V.
    trajectory : Trajectory
        An episode of its swimmer.
    over : (str, str)
        Two of :func:`coordinate_names`, for the horizontal and the vertical axis. Angles and velocities are those of
        the frame in which the target direction is +x.
    time : float, optional
        Of the state, s; the last one by default.

    Returns
    -------
    matplotlib.figure.Figure
        With the state as a dot, and the 0.5 s before it as a line: it shows those two coordinates of it, while the
        others were different then.
    """
    names = coordinate_names(trajectory.parameters.n_links)
    i, j = check_coordinates(over, trajectory.parameters.n_links)
    at = trajectory.index_at(float(trajectory.times[-1]) if time is None else time)
    states = target_frame_states(trajectory)
    x, y = (_axis(states[:, k], states[at, k], names[k]) for k in (i, j))
    columns, rows = np.meshgrid(x, y)
    z = np.broadcast_to(states[at], (GRID, GRID, states.shape[1])).copy()
    z[..., i], z[..., j] = columns, rows
    V = policy.judge(z).value

    figure = Figure(figsize=(6.6, 5.2), layout="constrained")
    axes = figure.subplots()
    plain_axes(axes)
    axes.grid(visible=False)
    units = [_unit(names[k]) for k in (i, j)]
    filled = axes.contourf(x * units[0][1], y * units[1][1], V, 24, cmap="viridis")
    filled.set_edgecolor("face")  # no white seams between the bands of a PDF
    axes.contour(x * units[0][1], y * units[1][1], V, 12, colors="white", linewidths=0.4, alpha=0.6)
    first = trajectory.index_at(trajectory.times[at] - NEAR)
    before = states[first : at + 1][:, [i, j]] - states[at, [i, j]]
    path = (before + _place(states[at], (i, j), names)) * [units[0][1], units[1][1]]
    axes.plot(*path.T, color="white", linewidth=2.6, zorder=3)
    axes.plot(*path.T, color=INK, linewidth=1.3, zorder=3)
    axes.plot(*path[-1], "o", color=INK, markersize=7, markeredgecolor="white", zorder=4)
    axes.set_xlim(x[0] * units[0][1], x[-1] * units[0][1])
    axes.set_ylim(y[0] * units[1][1], y[-1] * units[1][1])
    axes.set_xlabel(f"{_symbol(names[i])}  ({units[0][0]})")
    axes.set_ylabel(f"{_symbol(names[j])}  ({units[1][0]})")
    for axis, name in ((axes.xaxis, names[i]), (axes.yaxis, names[j])):
        if name.startswith("theta"):
            axis.set_major_locator(MultipleLocator(90))
    bar = figure.colorbar(filled, ax=axes, ticks=MaxNLocator(7))
    bar.set_label("$V$  (m)")
    axes.set_title(f"the state at t = {trajectory.times[at]:.2f} s, and {NEAR:g} s before it", fontsize=10)
    return figure


def _axis(values: Array, now: float, name: str) -> Array:
    """A turn for an angle, about the quarter next to ``now``; else somewhat more than the episode has, about 0."""
    if name.startswith("theta"):
        return _near(now) + np.linspace(-np.pi, np.pi, GRID)
    reach = 1.15 * max(float(np.abs(values).max()), 1e-3)
    return np.linspace(-reach, reach, GRID)


def _near(angle: float) -> float:
    """The multiple of a quarter turn next to ``angle``, in -pi to pi."""
    quarter = np.round(angle / (np.pi / 2)) * (np.pi / 2)
    return float((quarter + np.pi) % (2 * np.pi) - np.pi)


def _place(state: Array, where: tuple[int, int], names: Sequence[str]) -> Array:
    """Two coordinates of a state, angles as :func:`_axis` has them."""
    place = state[list(where)].copy()
    for k, name in enumerate(names[i] for i in where):
        if name.startswith("theta"):
            place[k] = _near(place[k]) + (place[k] + np.pi / 4) % (np.pi / 2) - np.pi / 4
    return place


def _unit(name: str) -> tuple[str, float]:
    """Unit, and how many of it are one SI unit."""
    if name.startswith("theta"):
        return "degrees", 180 / np.pi
    return ("rad/s", 1.0) if name.startswith("omega") else ("m/s", 1.0)


def _symbol(name: str) -> str:
    if name in ("vx", "vy"):
        return rf"$\dot G_{name[1]}$"
    letter = r"\theta" if name.startswith("theta") else r"\dot\theta"
    return f"${letter}_{{{name[5:]}}}$"


def default_coordinates(parameters: SwimmerParameters) -> tuple[str, str]:
    """The angles of the link in the middle and of the next one."""
    middle = max(1, parameters.n_links // 2)
    return f"theta{middle}", f"theta{middle + 1}"
