"""The gait diagram: one stroke, its poses, which motor turns which way when, and what comes of it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.render.chain import draw_chain
from swimmer_mj.render.curves import control_lanes
from swimmer_mj.render.figures import BLUE, HANDLE, INK, ORANGE, line, nth_line, plain_axes
from swimmer_mj.render.strokes import Stroke, joint_angles, last_stroke
from swimmer_mj.trajectory import Trajectory

__all__ = ["gait_diagram"]

Array = NDArray[np.float64]

POSES = 9
WIDTH = 9.6
"""Inches."""


def gait_diagram(trajectory: Trajectory) -> Figure:
    """The last stroke of ``trajectory``: poses, and torques, joint angles and speed over one time axis.

    Poses are turned so that the target direction points to the right. Torques upwards turn link i + 1 anticlockwise
    against link i. Joint angles start within -180 to 180 degrees and go on from there.

    Raises
    ------
    NoStrokeError
        No stroke repeats (see :func:`swimmer_mj.render.strokes.last_stroke`).
    """
    stroke = last_stroke(trajectory)
    part = slice(stroke.first, stroke.last + 1)
    times = trajectory.times[part] - trajectory.times[stroke.first]
    n = trajectory.parameters.n_links
    places = _standing(trajectory, stroke)
    tall = WIDTH * float(np.ptp(places[..., 1]) / np.ptp(places[..., 0])) + 0.7
    heights = [tall, 0.7 + 0.28 * (n - 1), 2.1, 1.5]
    figure = Figure(figsize=(WIDTH, sum(heights) + 1.1), layout="constrained")
    poses, torque, angle, speed = figure.subplots(4, 1, height_ratios=heights)
    for axes in (torque, angle, speed):
        plain_axes(axes)
        axes.margins(x=0)
    for axes in (torque, angle):
        axes.sharex(speed)
        axes.tick_params(labelbottom=False)
    _draw_poses(poses, places, np.linspace(0, stroke.duration, POSES))
    alike = f"it differs from the one before by {100 * stroke.mismatch:.0f} % of what unrelated poses do"
    poses.set_title(f"one stroke, {stroke.duration:.2f} s; {alike}", fontsize=10, loc="left", pad=10)

    limits = trajectory.parameters.torque_limits
    scale = control_lanes(torque, times, trajectory.controls[stroke.first : stroke.last], limits, " N·m")
    torque.set_ylabel(f"torque\n(lane: {scale})")

    angles = joint_angles(trajectory)[0][part]
    angles = np.degrees(angles - 2 * np.pi * np.round(angles[0] / (2 * np.pi)))
    for i in range(n - 1):
        angle.plot(times, angles[:, i], linewidth=1.5, label=f"joint {i + 1}", **nth_line(i))
    angle.set_ylabel("joint angle  (degrees)")
    angle.legend(
        frameon=False,
        fontsize=9,
        ncols=min(n - 1, 8),
        loc="lower left",
        bbox_to_anchor=(0, 1),
        handlelength=HANDLE,
    )

    speeds = trajectory.speeds()[part]
    speed.plot(times, speeds, color=BLUE, linewidth=1.5)
    mean = float(np.trapezoid(speeds, times) / times[-1])
    speed.axhline(mean, linewidth=1.1, label=f"mean {mean:.2f} m/s", **line(INK))
    speed.legend(frameon=False, fontsize=9, loc="lower left", bbox_to_anchor=(0, 1))
    speed.set_ylabel("speed along\ntarget  (m/s)")
    speed.set_xlabel("time in the stroke  (s)")
    speed.set_xlim(0, times[-1])
    figure.align_ylabels([torque, angle, speed])
    return figure


def _standing(trajectory: Trajectory, stroke: Stroke) -> Array:
    """Joints of poses at equal times side by side, shape (POSES, n + 1, 2), m."""
    parameters = trajectory.parameters
    chosen = np.linspace(stroke.first, stroke.last, POSES).round().astype(int)
    states = trajectory.states[chosen]
    joints = st.joint_positions(parameters, states) - st.center_of_mass(parameters, states)[:, None]
    joints = st.rotate(joints, -trajectory.target_directions[chosen][:, None])
    joints -= (joints.max(axis=1, keepdims=True) + joints.min(axis=1, keepdims=True)) / 2
    cell = 1.12 * float(np.ptp(joints[..., 0], axis=1).max())
    return joints + np.stack([cell * np.arange(POSES), np.zeros(POSES)], axis=-1)[:, None]


def _draw_poses(axes: Axes, places: Array, times: Array) -> None:
    """Poses in a row, each with its time below."""
    bottom, top = float(places[..., 1].min()), float(places[..., 1].max())
    margin = max(0.12 * (top - bottom), 0.008 * float(np.ptp(places[..., 0])))  # a stretched chain is flat
    axes.set(
        xlim=(places[..., 0].min() - margin, places[..., 0].max() + margin),
        ylim=(bottom - 2 * margin, top + margin),
    )
    axes.set_aspect("equal")
    axes.axis("off")
    for place, time in zip(places, times, strict=True):
        draw_chain(axes, place, 4.0)
        axes.plot(*place[0], "o", color=ORANGE, markersize=5.5, markeredgewidth=0, zorder=3)
        middle = (place[:, 0].min() + place[:, 0].max()) / 2
        axes.text(middle, bottom - margin, f"{time:.2f} s", ha="center", va="top", fontsize=9, color=INK)
