"""The film strip of figure 3: the swimmer's poses side by side."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from swimmer_mj import state as st
from swimmer_mj.render.chain import draw_chain
from swimmer_mj.render.figures import BLUE, GREY, INK, ORANGE
from swimmer_mj.trajectory import Trajectory

__all__ = ["film_strip"]

Array = NDArray[np.float64]

WIDTH = 12.0
"""Of the figure, inches. Its height follows from the poses."""


def film_strip(
    trajectory: Trajectory,
    *,
    interval: float = 0.1,
    per_row: int = 10,
    start: float | None = None,
    stop: float | None = None,
) -> Figure:
    """Poses of ``trajectory``, read from left to right and from top to bottom, after figure 3.

    Every pose stands in a cell of its own. All cells have one scale. The ticks of a row mark one and the same
    place in the fluid, where the centre of mass was at the beginning of the row, and each pose is drawn where
    it truly is relative to that place; so the path covered shows as the trace that grows from the tick. An
    arrow gives the target direction at the beginning of each row, and in each cell where it has changed. Links are
    outlined, and each lies on those before it, so that one sees where they cross.

    Parameters
    ----------
    trajectory : Trajectory
        What to draw.
    interval : float
        Between two poses, s. The nearest recorded state is drawn.
    per_row : int
        Poses in a row.
    start, stop : float
        Poses lie in start <= t < stop, s; by default the whole trajectory.

    Returns
    -------
    matplotlib.figure.Figure
        The line with the gid ``"scale"`` is 1 m long; poses are as :func:`swimmer_mj.render.chain.draw_chain` draws
        them.
    """
    chosen = _pose_indices(trajectory, interval, start, stop)
    if per_row < 1:
        raise ValueError(f"per_row must be at least 1, got {per_row!r}")
    times, directions = trajectory.times, trajectory.target_directions
    joints = st.joint_positions(trajectory.parameters, trajectory.states)
    centers = trajectory.centers_of_mass()
    rows = [chosen[k : k + per_row] for k in range(0, len(chosen), per_row)]

    # Outlines (m) about the place of the centre of mass as the row begins. Ticks are one cell apart,
    # just enough to part each pose from the next; a pose may lean out of its cell.
    outlines = [joints[row] - centers[row[0]] for row in rows]
    lefts, rights = ([edge(o[..., 0], axis=-1) for o in outlines] for edge in (np.min, np.max))
    link = float(trajectory.parameters.lengths.mean())
    overlaps = [right[:-1] - left[1:] for left, right in zip(lefts, rights, strict=True)]
    cell = float(np.concatenate([*overlaps, rights[0][:1] - lefts[0][:1]]).max()) + 0.5 * link
    columns = cell * np.arange(per_row)
    starts = [float((left + columns[: len(left)]).min()) for left in lefts]
    ends = [float((right + columns[: len(right)]).max()) for right in rights]
    edge = max(0.25 * link, 0.003 * per_row * cell)  # clear, on either side of the longest row
    content = max(per_row * cell, float(np.subtract(ends, starts).max()) + 2 * edge)
    total = content / 0.9  # the rest is the margin that holds times and arrows
    inch = total / WIDTH  # m of the drawing to an inch of paper
    tick = 0.09 * inch

    # Row by row, downwards: y of the row's origin, and of the line below the row.
    origins, borders = [], []
    y = -0.08 * inch
    for row, outline in zip(rows, outlines, strict=True):
        turns = np.ptp(directions[row]) > 0  # leaves room for arrows below the poses
        above = max(float(outline[..., 1].max()), 0.16 * inch) + 0.09 * inch
        below = max(-float(outline[..., 1].min()), 0.16 * inch) + (0.3 if turns else 0.09) * inch
        origins.append(y - above)
        y -= above + below
        borders.append(y)
    foot = 0.68 * inch

    figure = Figure(figsize=(WIDTH, (foot - y) / inch))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set(xlim=(0.0, total), ylim=(y - foot, 0.0), aspect="equal")
    axes.axis("off")

    thick = 4.4 * min(1.0, link / inch / 0.17)
    margin = total - content
    for row, origin, border, left in zip(rows, origins, borders, starts, strict=True):
        axes.plot([0.06 * inch, total - 0.06 * inch], [border, border], color="0.88", linewidth=0.6)
        axes.text(0.12 * inch, origin, f"{times[row[0]]:.1f} s", va="center", fontsize=9, color=INK)
        _arrow(axes, margin - 0.58 * inch, origin, directions[row[0]], 0.42 * inch)
        for column, k in enumerate(row):
            place = np.array([margin + edge - left + columns[column], origin])
            shift = place - centers[row[0]]
            trace = centers[row[0] : k + 1] + shift
            pose = joints[k] + shift
            axes.plot([place[0]] * 2, [origin - tick, origin + tick], color=GREY, linewidth=0.8, zorder=1)
            draw_chain(axes, pose, thick, zorder=2)
            axes.plot(*pose[0], "o", color=ORANGE, markersize=1.4 * thick, markeredgewidth=0, zorder=4)
            axes.plot(*trace.T, color=BLUE, linewidth=1.3, zorder=5)
            axes.plot(
                *trace[-1],
                "o",
                color=BLUE,
                markersize=3.2,
                markeredgecolor="white",
                markeredgewidth=0.5,
                zorder=6,
            )
            if k != row[0] and directions[k] != directions[row[column - 1]]:
                _arrow(axes, place[0] - 0.21 * inch, border + 0.12 * inch, directions[k], 0.42 * inch)
    _legend(axes, interval, y - 0.24 * inch, inch, thick)
    return figure


def _pose_indices(
    trajectory: Trajectory, interval: float, start: float | None, stop: float | None
) -> list[int]:
    """Return indices of the states nearest to start, start + interval and so on."""
    times = trajectory.times
    start = float(times[0]) if start is None else start
    stop = float(times[-1]) if stop is None else stop
    if not 0 < interval < math.inf:
        raise ValueError(f"interval must be positive and finite, got {interval!r}")
    if not times[0] <= start <= stop <= times[-1] + 1e-9:
        raise ValueError(
            f"start and stop must lie in the trajectory's {times[0]:g} to {times[-1]:g} s, "
            f"got {start!r} and {stop!r}"
        )
    wanted = start + interval * np.arange(max(1, math.ceil((stop - start) / interval - 1e-9)))
    return [trajectory.index_at(time) for time in wanted]


def _arrow(axes: Axes, x: float, y: float, direction: float, length: float) -> None:
    """Draw an arrow of ``length`` whose middle is ``length / 2`` right of (x, y)."""
    half = length / 2 * np.array([math.cos(direction), math.sin(direction)])
    middle = np.array([x + length / 2, y])
    axes.annotate(
        "",
        xy=tuple(middle + half),
        xytext=tuple(middle - half),
        arrowprops={"arrowstyle": "-|>,head_width=0.28,head_length=0.5", "color": BLUE, "linewidth": 1.8},
    )


def _legend(axes: Axes, interval: float, y: float, inch: float, thick: float) -> None:
    """Write the two lines below the last row: what the marks mean, and how to read them."""
    text = {"va": "center", "fontsize": 9, "color": INK}
    x = 0.12 * inch
    axes.plot([x, x + 1.0], [y, y], color=INK, linewidth=1.2, solid_capstyle="butt", gid="scale")
    for end in (x, x + 1.0):
        axes.plot([end, end], [y - 0.05 * inch, y + 0.05 * inch], color=INK, linewidth=1.2)
    axes.text(x + 1.0 + 0.1 * inch, y, "1 m", **text)
    x += 1.0 + 0.75 * inch
    axes.plot(x, y, "o", color=ORANGE, markersize=1.4 * thick, markeredgewidth=0)
    axes.text(x + 0.12 * inch, y, "head: free end $A_0$ of the first link", **text)
    x += 3.0 * inch
    axes.plot([x - 0.2 * inch, x], [y, y], color=BLUE, linewidth=1.3)
    axes.plot(x, y, "o", color=BLUE, markersize=3.2)
    axes.text(x + 0.12 * inch, y, "centre of mass and its path since the row began", **text)
    x += 3.55 * inch
    axes.plot([x, x], [y - 0.09 * inch, y + 0.09 * inch], color=GREY, linewidth=0.8)
    axes.text(x + 0.12 * inch, y, "where it began", **text)
    x += 1.35 * inch
    _arrow(axes, x, y, 0.0, 0.36 * inch)
    axes.text(x + 0.46 * inch, y, "target direction", **text)
    axes.text(
        0.12 * inch,
        y - 0.24 * inch,
        f"A pose every {interval:g} s, from left to right and from top to bottom. "
        "All ticks of a row are one place in the fluid; each pose stands "
        "where it truly is relative to its tick.",
        **text,
    )
