"""How the pictures look, and how they are written to a file."""

from __future__ import annotations

import os
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from swimmer_mj.files import replacing

__all__ = [
    "AMBER",
    "BLACK",
    "BLUE",
    "COLORS",
    "DASHES",
    "GREEN",
    "GREY",
    "HANDLE",
    "INK",
    "ORANGE",
    "PINK",
    "SKY",
    "VIOLET",
    "line",
    "log_axis",
    "nth_line",
    "plain_axes",
    "save_figure",
]

BLUE, ORANGE, INK, GREY = "#0072b2", "#d55e00", "#1a1a1a", "#8c8c8c"
GREEN, PINK, SKY, AMBER, BLACK, VIOLET = "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#6a3d9a"
COLORS = (BLUE, ORANGE, GREEN, PINK, SKY, AMBER, BLACK, VIOLET)
"""The palette of Okabe and Ito, its yellow replaced: distinct to colour-blind readers and on white paper."""

Dashes = str | tuple[float, tuple[float, ...]]
DASHES: Mapping[str, Dashes] = MappingProxyType(
    {
        BLUE: "-",
        ORANGE: (0, (4.5, 1.8)),
        GREEN: (0, (6.4, 1.6, 1.2, 1.6)),
        PINK: (0, (1.4, 1.3)),
        SKY: (0, (9, 2)),
        AMBER: (0, (4.5, 1.3, 1.2, 1.3, 1.2, 1.3)),
        BLACK: (0, (3, 0.7)),
        VIOLET: (0, (4.5, 1.3, 4.5, 1.3, 1.2, 1.3)),
        GREY: (0, (2.2, 1.1)),
        INK: (0, (5, 3)),
    }
)
"""Of each colour, as most are alike in grey: dashes and gaps, in widths of the line."""
HANDLE = 3.4
"""Length of a legend's handles, in letters: more than a period of the longest dashes."""


def line(color: str) -> dict[str, Any]:
    """A colour of the palette and its dashes, as ``Axes.plot`` takes them."""
    return {"color": color, "linestyle": DASHES[color]}


def nth_line(k: int) -> dict[str, Any]:
    """The ``k``-th of many lines: after the palette its colours again, with dashes of lighter or darker ones."""
    n = len(COLORS)
    return {"color": COLORS[k % n], "linestyle": DASHES[COLORS[(k + k // n * (n // 2)) % n]]}


def plain_axes(axes: Axes) -> None:
    """Left and bottom spines and a faint grid."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(color="0.9", linewidth=0.6)
    axes.set_axisbelow(True)
    axes.margins(x=0.01)


def log_axis(axes: Axes, which: Literal["x", "y"]) -> None:
    """A logarithmic axis that is labelled at 1, 2 and 5 times the powers of ten, in plain numbers."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())


def save_figure(figure: Figure, path: str | os.PathLike[str], dpi: float = 150.0) -> None:
    """Write ``figure`` to ``path`` in the format of its suffix; ``dpi`` matters to raster formats."""
    with replacing(path) as partial:
        figure.savefig(partial, dpi=dpi, facecolor="white")
