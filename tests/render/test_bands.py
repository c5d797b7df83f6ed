import numpy as np
from matplotlib.figure import Figure

from swimmer_mj.render.bands import band, end_key, mark_ends
from swimmer_mj.render.figures import BLUE, DASHES, ORANGE, line


def test_the_median_has_the_dashes_of_its_colour():
    table = {"seed": np.repeat([0.0, 1.0, 2.0], 2), "x": np.tile([1.0, 2.0], 3), "y": np.arange(6.0)}
    axes = Figure().subplots()
    median = band(axes, table, "x", "y", ORANGE, "label")
    np.testing.assert_array_equal(median.get_xydata(), [[1, 2], [2, 3]])
    assert median._unscaled_dash_pattern == DASHES[ORANGE]
    assert [one.get_linestyle() for one in axes.lines] == ["-", "-", "-", "--"]


def test_a_tick_is_where_a_line_ends_before_others():
    axes = Figure().subplots()
    lines = [axes.plot([0, end], [1, 2], **line(color))[0] for end, color in ((10, BLUE), (4, ORANGE))]
    mark_ends(axes, lines)
    (tick,) = axes.lines[2:]
    np.testing.assert_array_equal(tick.get_xydata(), [[4, 2]])
    assert (tick.get_color(), tick.get_marker()) == (ORANGE, end_key("ends").get_marker())
    assert tick.get_label().startswith("_")
