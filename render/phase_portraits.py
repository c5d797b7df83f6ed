"""Phase portraits of the joints: angle and angular velocity, and which way the motor turns."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from swimmer_mj.render.figures import AMBER, BLUE, GREY, INK, plain_axes
from swimmer_mj.render.strokes import NoStrokeError, joint_angles, last_stroke, steady_part
from swimmer_mj.trajectory import Trajectory

__all__ = ["phase_portraits"]

Array = NDArray[np.float64]

COLUMNS = 4
PANEL = 2.75
"""Width of a portrait, inches."""


def phase_portraits(trajectory: Trajectory) -> Figure:
    """A panel a joint: its angle against its angular velocity, coloured by the sign of its torque: dark and light.

    The steady part of the longest swim in one direction is thin, its last stroke, if one repeats, thick; a dot is where
    both end. Joint i is that between the links i and i + 1; its angle is theta_{i+1} - theta_i, and near 180 degrees
    the links are folded. Scales differ from joint to joint.

    Raises
    ------
    ValueError
        A swimmer of one link has no joints.
    """
    n = trajectory.parameters.n_links
    if n < 2:
        raise ValueError("phase portraits need at least 2 links: one has no joint")
    angles, rates = joint_angles(trajectory)
    steady = steady_part(trajectory)
    try:
        stroke = last_stroke(trajectory)
    except NoStrokeError:
        stroke = None
    columns = min(COLUMNS, n - 1)
    rows = -(-(n - 1) // columns)
    figure = Figure(figsize=(PANEL * columns + 0.5, 2.6 * rows + 0.75), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False)
    last = steady.stop - 1
    for i, axes in enumerate(panels.flat):
        if i >= n - 1:
            axes.set_visible(False)
            continue
        plain_axes(axes)
        axes.axhline(0, color=GREY, linewidth=0.6)
        points = np.stack([_shown(angles[:, i], steady), rates[:, i]], axis=-1)
        signs = np.sign(trajectory.controls[:, i])
        _portrait(axes, points, signs, slice(steady.start, last), 0.6, 0.5)
        if stroke is not None:
            _portrait(axes, points, signs, slice(stroke.first, stroke.last), 1.9, 1.0)
        axes.plot(*points[last], "o", color=INK, markersize=4, zorder=4)
        axes.set_title(f"joint {i + 1}: links {i + 1} and {i + 2}", fontsize=10)
        axes.margins(0.06)
        axes.autoscale_view()
        if i + columns >= n - 1:
            axes.set_xlabel("angle  (degrees)")
    for axes in panels[:, 0]:
        axes.set_ylabel("angular velocity  (rad/s)")
    key = _key(stroke is not None)
    figure.legend(
        handles=key, loc="outside upper center", ncols=min(4, 2 * columns), frameon=False, fontsize=9
    )
    return figure


def _shown(angles: Array, steady: slice) -> Array:
    """``angles`` (T + 1,) in degrees, about a mean in -180 to 180; if the joint goes round and round, all of them."""
    part = angles[steady]
    if np.ptp(part) > 2 * np.pi:
        return (np.degrees(angles) + 180) % 360 - 180
    turns = np.round(part.mean() / (2 * np.pi))
    return np.degrees(angles - 2 * np.pi * turns)


def _portrait(axes: Axes, points: Array, signs: Array, steps: slice, width: float, alpha: float) -> None:
    """The way of the control steps ``steps``, each in the colour of the torque that was held."""
    pieces = np.stack([points[:-1], points[1:]], axis=1)[steps]
    whole = np.abs(np.diff(pieces[..., 0], axis=1))[:, 0] < 180  # none from one edge to the other
    colors = np.select([signs[steps] > 0, signs[steps] < 0], [BLUE, AMBER], GREY)[whole]
    axes.add_collection(
        LineCollection(
            [*pieces[whole]], colors=colors.tolist(), linewidths=width, alpha=alpha, capstyle="round"
        )
    )


def _key(stroke: bool) -> list[Line2D]:
    """What the colours and marks mean."""
    lines = [
        Line2D([], [], color=BLUE, linewidth=1.9, label="torque $u_i > 0$"),
        Line2D([], [], color=AMBER, linewidth=1.9, label="torque $u_i < 0$"),
        Line2D([], [], color=INK, marker="o", markersize=4, linestyle="", label="last state"),
    ]
    thick = Line2D([], [], color=GREY, linewidth=1.9, label="thick: last stroke")
    return [*lines[:2], thick, lines[2]] if stroke else lines
