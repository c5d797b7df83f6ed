"""The best known gaits: what they pull at which speed, and how one looks."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.learning.experiments.gaits.gait import Gait
from swimmer_mj.render.chain import draw_chain
from swimmer_mj.render.figures import COLORS, INK, log_axis, plain_axes

__all__ = ["draw_gaits"]

Array = NDArray[np.float64]

POSES = 7
SHOWN = 3
"""Speeds whose strokes are drawn, at most."""


def draw_gaits(gaits: Mapping[int, Mapping[float, Gait]], links: int = 5) -> Figure:
    """Pull against speed for each number of links; below, strokes of the swimmer of ``links`` links.

    Parameters
    ----------
    gaits : mapping
        By number of links and mean speed, m/s.
    links : int
        Whose strokes are drawn.
    """
    shown = dict(sorted(gaits[links].items())[:SHOWN])
    figure = Figure(figsize=(9.6, 3.6 + 0.9 * len(shown)), layout="constrained")
    panels = figure.subplots(1 + len(shown), 1, height_ratios=[3.6, *[0.8] * len(shown)])
    pull, *strokes = np.atleast_1d(panels).tolist()
    _draw_pulls(pull, gaits)
    for axes, (speed, gait) in zip(strokes, shown.items(), strict=True):
        _draw_stroke(axes, gait)
        axes.set_title(
            f"{links} links at {speed:g} m/s against {gait.pull:.2f} m/s²: a stroke of {gait.duration:.2f} s",
            fontsize=9, loc="left",
        )  # fmt: skip
    return figure


def _draw_pulls(axes: Axes, gaits: Mapping[int, Mapping[float, Gait]]) -> None:
    plain_axes(axes)
    for (n, by_speed), color, marker in zip(sorted(gaits.items()), COLORS, "os^Dvp*h", strict=False):
        speeds = sorted(by_speed)
        pulls = [by_speed[speed].pull for speed in speeds]
        axes.plot(speeds, pulls, color=color, marker=marker, markersize=5, linewidth=1.4, label=f"{n} links")
    log_axis(axes, "y")
    axes.margins(x=0.05)
    axes.set_xticks(sorted({speed for by_speed in gaits.values() for speed in by_speed}))
    axes.set_xlabel("mean speed  (m/s)")
    axes.set_ylabel("largest pull found  (m/s²)")
    axes.legend(frameon=False, fontsize=9, loc="center left", bbox_to_anchor=(1, 0.5))


def _draw_stroke(axes: Axes, gait: Gait) -> None:
    """Poses at equal times of one stroke, side by side; they swim to the right."""
    chosen = (np.arange(POSES) * gait.n_intervals / POSES).astype(int)
    joints = st.joint_positions(gait.parameters, st.expand(gait.parameters, gait.states[chosen]))
    cell = 1.1 * float(np.ptp(joints[..., 0], axis=1).max())
    joints = joints + np.stack([cell * np.arange(POSES), np.zeros(POSES)], axis=-1)[:, None]
    for pose, k in zip(joints, chosen.tolist(), strict=True):
        draw_chain(axes, pose, 4.0)
        time = gait.duration * k / gait.n_intervals
        axes.text(
            pose[:, 0].mean(), joints[..., 1].min() - 0.3, f"{time:.2f} s", ha="center", va="top", fontsize=8,
            color=INK,
        )  # fmt: skip
    axes.set(
        xlim=(joints[..., 0].min() - 0.3, joints[..., 0].max() + 0.3),
        ylim=(joints[..., 1].min() - 0.8, joints[..., 1].max() + 0.3),
    )
    axes.set_aspect("equal")
    axes.axis("off")
