"""The palette: lines that are told apart in grey print."""

import itertools

import pytest
from matplotlib.figure import Figure

from swimmer_mj.render.figures import BLUE, COLORS, DASHES, GREY, INK, line, nth_line

APART = 15.0


def test_lightness_is_that_of_the_standard(lightness):
    assert [lightness(color) for color in ("black", "white")] == pytest.approx([0, 100], abs=1e-4)
    assert lightness("red") == pytest.approx(53.24, abs=0.01)
    assert lightness("#777777") == pytest.approx(50.03, abs=0.01)


def test_any_two_colours_differ_in_dashes_or_lightness(lightness):
    assert set(DASHES) == {*COLORS, GREY, INK}
    for one, other in itertools.combinations(DASHES, 2):
        assert DASHES[one] != DASHES[other] or abs(lightness(one) - lightness(other)) >= APART


def test_two_palettes_of_lines_are_told_apart(lightness):
    styles = [nth_line(k) for k in range(2 * len(COLORS))]
    assert styles[: len(COLORS)] == [line(color) for color in COLORS]
    for one, other in itertools.combinations(styles, 2):
        apart = abs(lightness(one["color"]) - lightness(other["color"])) >= APART
        assert one["linestyle"] != other["linestyle"] or apart
    assert nth_line(1000)["color"] in COLORS


@pytest.mark.parametrize(
    ("color", "marker", "apart"), [(BLUE, "", False), (BLUE, "s", True), (INK, "", True)]
)
def test_lines_that_are_not_apart_are_noticed(check_apart, color, marker, apart):
    figure = Figure()
    axes = figure.subplots()
    axes.plot([0, 1], [0, 1], label="one", **line(BLUE))
    axes.plot([0, 1], [1, 0], label="other", marker=marker, color=color)
    axes.plot([0, 1], [1, 1], color=BLUE)  # which has no name
    if apart:
        check_apart(figure)
    else:
        with pytest.raises(AssertionError, match="other"):
            check_apart(figure)
