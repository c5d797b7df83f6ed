import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from swimmer_mj.render.chain import draw_chain

SIDE = 200  # pixels for [-1, 1]


def drawn(joints, width=12.0):
    """RGB of the chain on white, rows upwards, shape (SIDE, SIDE, 3)."""
    figure = Figure(figsize=(2, 2), dpi=SIDE / 2)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-1, 1), ylim=(-1, 1))
    axes.axis("off")
    draw_chain(axes, np.array(joints, dtype=float), width)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[::-1, :, :3].astype(int)


def along(picture, x0, y0, x1, y1):
    """The colours from one place to another."""
    at = np.linspace(0, 1, 400)
    column, row = ((a + at * (b - a) + 1) / 2 * SIDE for a, b in ((x0, x1), (y0, y1)))
    return picture[row.astype(int), column.astype(int)]


def runs(dark):
    """How often a line goes into the dark."""
    return int((np.diff(dark.astype(int)) == 1).sum())


CROSSING = [(-0.6, 0.0), (0.6, 0.0), (0.0, 0.8), (0.0, -0.8)]  # link 3 crosses link 1 at the origin


def test_a_link_has_two_dark_edges_and_is_light_within():
    dark = along(drawn([(-0.6, 0.0), (0.6, 0.0)]), 0, -0.5, 0, 0.5).max(axis=-1) < 60
    assert runs(dark) == 2


def test_of_two_links_that_cross_the_later_one_is_whole_and_the_other_one_is_interrupted():
    picture = drawn(CROSSING)
    across_the_upper = along(picture, 0, 0.3, 0, -0.3)
    assert runs(across_the_upper.max(axis=-1) < 60) == 0  # within link 3, nothing of link 1 is seen
    edge = along(picture, -0.5, 0.055, 0.5, 0.055)  # the upper edge of link 1
    white = edge.min(axis=-1) > 250
    assert runs(white) >= 2, "clear space on both sides of the crossing link"


def test_neighbours_differ_and_joints_are_whole():
    picture = drawn([(-0.8, 0.0), (0.0, 0.0), (0.8, 0.0)])
    left, right = (along(picture, x, 0, x + 0.1, 0).mean(axis=0) for x in (-0.5, 0.4))
    assert np.abs(left - right).max() > 40
    assert (along(picture, -0.7, 0, 0.7, 0).min(axis=-1) < 253).all()  # no gap between them
