"""How the pictures look, and how they are written to a file."""

from __future__ import annotations

import os
from typing import Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from swimmer_mj.files import replacing

__all__ = ["BLUE", "COLORS", "GREY", "INK", "ORANGE", "log_axis", "plain_axes", "save_figure"]

BLUE, ORANGE, INK, GREY = "#0072b2", "#d55e00", "#1a1a1a", "#8c8c8c"
COLORS = (BLUE, ORANGE, "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#000000", "#6a3d9a")
"""The palette of Okabe and Ito, its yellow replaced: distinct to colour-blind readers and on white paper."""


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
