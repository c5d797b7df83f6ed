"""The swimmer as a drawing of lines: links with outlines, each above the one before it: crossings can be read."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

from swimmer_mj.render.figures import INK

__all__ = ["POSE", "draw_chain"]

Array = NDArray[np.float64]

POSE = "pose"
"""The gid of what :func:`draw_chain` adds."""
FILLS = ("#a6cbe8", "#fbe0b8")
"""Of the odd and the even links."""
OUTLINE, HALO = 0.32, 0.36
"""How much wider than its filling a link with its outline is, and than that the clear space about it, in widths."""
CLEAR = 0.22
"""The clear space begins this far from either end, in lengths of the link: joints stay whole."""


def draw_chain(axes: Axes, joints: Array, width: float, zorder: float = 2.0) -> LineCollection:
    """Draw the links between A_0 .. A_n.

    Parameters
    ----------
    axes : Axes
        Where; the limits of its axes stay as they are.
    joints : ndarray, shape (n + 1, 2)
        In the units of the axes.
    width : float
        Of a link with its outline, points.
    zorder : float
        What lies on what.

    Returns
    -------
    LineCollection
        Its gid is :data:`POSE`. Three segments a link, in the order of the links: clear space, outline, filling.
    """
    starts, ends = joints[:-1], joints[1:]
    trim = CLEAR * (ends - starts)
    inner, whole = np.stack([starts + trim, ends - trim], axis=1), np.stack([starts, ends], axis=1)
    segments = np.stack([inner, whole, whole], axis=1).reshape(-1, 2, 2)  # link by link
    n = len(starts)
    chain = LineCollection(
        [*segments],
        linewidths=np.tile([(1 + HALO) * width, width, (1 - OUTLINE) * width], n).tolist(),
        colors=[color for i in range(n) for color in ("white", INK, FILLS[i % 2])],
        capstyle="round",
        gid=POSE,
        zorder=zorder,
    )
    axes.add_collection(chain, autolim=False)
    return chain
