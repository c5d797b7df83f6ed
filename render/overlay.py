"""What is drawn over and below the frames of a video: torques at the joints; V, H and others against time."""

from __future__ import annotations

import functools
import io
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw, ImageFont

from swimmer_mj.render.curves import control_lanes
from swimmer_mj.render.encoding import Frame
from swimmer_mj.render.figures import BLUE, GREY, INK, ORANGE, plain_axes
from swimmer_mj.trajectory import Trajectory

__all__ = ["SERIES_COLORS", "Panel", "draw_arcs", "draw_moment", "make_panel", "signed", "write"]

Array = NDArray[np.float64]

SERIES_COLORS = (BLUE, ORANGE)
"""Of the first and the second swimmer, where there are two."""
TORQUE = "#7a3fae"
PAPER = "#f5f8fa"
"""About letters that stand in the water."""
SWEEP = 1.25
"""Half the arc of a full torque, rad."""
STEP = 5
"""Arcs are turned by multiples of so many degrees: few pictures of them serve all."""
FINER = 3
"""Arcs are drawn so many times larger, and shrunk, which smooths them."""


@functools.lru_cache
def _font(size: int) -> ImageFont.FreeTypeFont:
    """DejaVu Sans, which comes with matplotlib and whose figures are all of one width."""
    return ImageFont.truetype(os.path.join(matplotlib.get_data_path(), "fonts/ttf/DejaVuSans.ttf"), size)


def signed(value: float) -> str:
    """With two decimals and a sign; U+2212 is as wide as a plus sign."""
    return f"{value:+.2f}".replace("-", "\N{MINUS SIGN}")


# What is drawn -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Stamp:
    """A small picture to be laid into frames again and again: a pixel becomes ``keep`` times what it was, plus ``add``.

    That is several times faster than to draw into each frame.
    """

    keep: NDArray[np.float32]
    """(rows, columns, 1), in [0, 1]."""
    add: NDArray[np.float32]
    """(rows, columns, 3), with the half that rounds."""

    @classmethod
    def of(cls, *layers: tuple[Image.Image, str]) -> _Stamp:
        """Of colours and how much of each pixel they cover, the lowest first; all of one size."""
        width, height = layers[0][0].size
        keep, add = np.ones((height, width, 1), np.float32), np.zeros((height, width, 3), np.float32)
        for mask, color in layers:
            cover = np.asarray(mask, np.float32)[..., None] / np.float32(255)
            keep *= 1 - cover
            add += cover * (np.array(_rgb(color), np.float32) - add)
        return cls(keep, add + np.float32(0.5))

    def lay(self, frame: Frame, left: int, top: int) -> None:
        """Into ``frame``; what does not fit into it is cut off."""
        (height, width), (rows, columns) = frame.shape[:2], self.add.shape[:2]
        low, high = max(top, 0), min(top + rows, height)
        first, last = max(left, 0), min(left + columns, width)
        if low < high and first < last:
            here = slice(low - top, high - top), slice(first - left, last - left)
            part = frame[low:high, first:last]
            part[...] = part * self.keep[here] + self.add[here]


@functools.lru_cache
def _rgb(color: str) -> tuple[int, ...]:
    return ImageColor.getrgb(color)


@functools.lru_cache(maxsize=2048)
def _word(text: str, color: str, size: int, halo: int) -> _Stamp:
    """A word, with ``halo`` + 1 pixels or more around it; its base line is in row 1.5 ``size``."""
    letters = _font(size)
    layers = []
    for edge, ink in ((halo, PAPER), (0, color)) if halo else ((0, color),):
        mask = Image.new("L", (math.ceil(letters.getlength(text)) + 2 * halo + 2, 2 * size))
        place = halo + 1, 1.5 * size
        ImageDraw.Draw(mask).text(place, text, 255, letters, anchor="ls", stroke_width=edge, stroke_fill=255)
        layers.append((mask, ink))
    return _Stamp.of(*layers)


def write(frame: Frame, place: tuple[float, float], text: str, color: str, size: int, halo: int = 0) -> None:
    """Write ``text`` into ``frame`` from ``place`` on its base line, pixels, with a light edge of ``halo`` pixels."""
    x, space = place[0], text_width(" ", size)
    for word in text.split(" "):
        if word:
            _word(word, color, size, halo).lay(frame, round(x) - halo - 1, round(place[1] - 1.5 * size))
            x += text_width(word, size)
        x += space


@functools.lru_cache(maxsize=2048)
def text_width(word: str, size: int) -> float:
    """Pixels."""
    return _font(size).getlength(word)


# Torques ----------------------------------------------------------------------------------------------------------


def draw_arcs(frame: Frame, joints: Array, angles: Array, levels: Array, radius: float) -> None:
    """Draw the torques u_i into ``frame``, as arcs around the joints in the sense in which they turn link i + 1.

    Parameters
    ----------
    frame : ndarray of uint8, shape (height, width, 3)
        It is changed.
    joints : ndarray, shape (n - 1, 2)
        Pixels, column and row.
    angles : ndarray, shape (n - 1,)
        Of the links i + 1, rad; each arc opens towards its link.
    levels : ndarray, shape (n - 1,)
        u_i / U_i in [-1, 1]: an arc is as long as its torque is strong, and none is drawn for 0.
    radius : float
        Pixels.
    """
    for (x, y), angle, level in zip(joints, angles, levels, strict=True):
        if round(20 * abs(level)) == 0:
            continue
        arc = _arc(round(radius), round(20 * level), round(math.degrees(angle) / STEP) % (360 // STEP))
        middle = len(arc.add) // 2
        arc.lay(frame, round(float(x)) - middle, round(float(y)) - middle)


@functools.lru_cache(maxsize=4096)
def _arc(radius: int, twentieths: int, steps: int) -> _Stamp:
    """An arc in a square about the joint; its torque in 1/20 of the limit."""
    head = 0.45 * radius
    size = 2 * math.ceil(radius + head) + 1
    mask = Image.new("L", (FINER * size, FINER * size))
    draw, r, middle = ImageDraw.Draw(mask), FINER * radius, FINER * size / 2
    width = max(2 * FINER, round(0.17 * r))
    direction, sweep = math.radians(STEP * steps), SWEEP * twentieths / 20
    first, last = direction - sweep, direction + sweep  # anticlockwise seen from above; rows count downwards
    low, high = sorted((-math.degrees(first), -math.degrees(last)))
    outer = r + width / 2
    draw.arc((middle - outer, middle - outer, middle + outer, middle + outer), low, high, 255, width)
    tip = np.array([math.cos(last), -math.sin(last)]) * r + middle
    ahead = np.sign(sweep) * np.array([-math.sin(last), -math.cos(last)])
    across = np.array([ahead[1], -ahead[0]])
    corners = (
        tip + FINER * head * (f * ahead + s * across) for f, s in ((0.9, 0), (-0.3, 0.75), (-0.3, -0.75))
    )
    draw.polygon([tuple(map(float, corner)) for corner in corners], fill=255)
    return _Stamp.of((mask.reduce(FINER), TORQUE))


# Curves -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Panel:
    """Curves of whole episodes as a picture, and where in it a moment stands."""

    picture: Frame
    boxes: tuple[tuple[float, float, float, float], ...]
    """Of each graph: left, top, right and bottom of its axes, pixels."""
    times: tuple[float, float]
    """At its left and right, s."""
    size: int
    """Of the letters, pixels."""


def make_panel(trajectories: Sequence[Trajectory], width: int, height: int) -> Panel:
    """Torques, V and H of an episode side by side, or of two the speeds, V and H.

    V and H that are not known leave their graph empty.
    """
    size = max(9, height // 10)
    points = size * 72 / 100
    width_and_height = ((width + 1e-6) / 100, (height + 1e-6) / 100)  # or matplotlib may round down
    figure = Figure(figsize=width_and_height, dpi=100, facecolor="white")
    with matplotlib.rc_context({"font.size": points, "axes.titlesize": points, "axes.linewidth": 0.6}):
        graphs = figure.subplots(1, 3)
        left, right, gap = (share * size / width for share in (3.4, 1.4, 4.2))
        figure.subplots_adjust(
            left,
            2.0 * size / height,
            1 - right,
            1 - 1.9 * size / height,
            3 * gap / (1 - left - right - 2 * gap),
        )
        _first_graph(graphs[0], trajectories)
        _series(graphs[1], trajectories, "$V$  (m)", [one.values for one in trajectories])
        _series(graphs[2], trajectories, "$H$  (m/s)", [one.hamiltonians for one in trajectories])
        start, end = trajectories[0].times[0], max(one.times[-1] for one in trajectories)
        for axes in graphs:
            axes.tick_params(length=2, pad=2, width=0.6)
            axes.set_xlim(start, end if end > start else start + 1.0)
            axes.xaxis.set_major_locator(MaxNLocator(6, integer=True))
            axes.text(1.01, -0.03, "s", transform=axes.transAxes, va="top", fontsize=points)
        data = io.BytesIO()
        figure.savefig(data, format="png")
    boxes = tuple(
        (box.x0, height - box.y1, box.x1, height - box.y0)
        for box in (axes.get_window_extent() for axes in graphs)
    )
    first, last = graphs[0].get_xlim()
    return Panel(np.array(Image.open(data).convert("RGB")), boxes, (float(first), float(last)), size)


def _first_graph(axes: Axes, trajectories: Sequence[Trajectory]) -> None:
    """Of one episode the torques, of two the speeds."""
    if len(trajectories) > 1:
        _series(axes, trajectories, "speed  (m/s)", [one.speeds() for one in trajectories])
        return
    (one,) = trajectories
    plain_axes(axes)
    scale = control_lanes(axes, one.times, one.controls, one.parameters.torque_limits, " N·m")
    _entitle(axes, f"torques  (lane: {scale})")


def _series(axes: Axes, trajectories: Sequence[Trajectory], title: str, series: Sequence[Array]) -> None:
    """Lines against time; the rare extremes after a turn may leave the graph."""
    plain_axes(axes)
    _entitle(axes, title)
    for one, values, color in zip(trajectories, series, SERIES_COLORS, strict=False):
        axes.plot(one.times, values, color=color, linewidth=1.0)
    known = np.concatenate([values[np.isfinite(values)] for values in series])
    if known.size:
        low, high = np.quantile(known, [0.005, 0.995])
        margin = 0.08 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)
    axes.yaxis.set_major_locator(MaxNLocator(4))


def _entitle(axes: Axes, title: str) -> None:
    """At the upper left; at the upper right stand the numbers of a moment."""
    axes.set_title(title, loc="left", pad=0.35 * matplotlib.rcParams["font.size"])


def draw_moment(frame: Frame, panel: Panel, time: float, numbers: Sequence[Sequence[float]]) -> None:
    """Mark ``time`` (s) in a copy of the panel that stands at the bottom of ``frame``, and write what is there.

    ``numbers``: of each graph, the values of each swimmer at that time, or none.
    """
    above = len(frame) - len(panel.picture)
    first, last = panel.times
    share = min(max((time - first) / (last - first), 0.0), 1.0)
    thick = max(1, panel.size // 12)
    for (left, top, right, bottom), values in zip(panel.boxes, numbers, strict=True):
        x = round(left + share * (right - left)) - thick // 2
        over = round(top - panel.size / 4)  # so that it is seen on the axis too
        frame[above + over : above + round(bottom) + 1, x : x + thick] = _rgb(INK)
        end = right
        colors = SERIES_COLORS if len(values) > 1 else (INK,)
        for value, color in reversed([*zip(values, colors, strict=False)]):
            text = signed(value) if math.isfinite(value) else ""
            end -= text_width(text, panel.size)
            write(frame, (end, above + top - 0.35 * panel.size), text, color, panel.size)
            end -= 0.6 * panel.size
    frame[above] = _rgb(GREY)
