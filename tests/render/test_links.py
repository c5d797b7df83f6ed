import numpy as np

from swimmer_mj.learning.experiments import LOGS
from swimmer_mj.learning.experiments.tables import read_table, rows_where
from swimmer_mj.render.curves import OPEN_LOOP_SPEED
from swimmer_mj.render.links import Known, best_speeds, speed_by_links


def test_the_best_speeds_of_the_logs():
    found = best_speeds()
    table = read_table(LOGS / "value-gradient-links.csv")
    assert set(found["value gradients"]) == {3, 4, 5, 6, 10}
    assert found["value gradients"][6].max() == rows_where(table, setting=6.0)["speed"].max()
    assert {name: set(by_links) for name, by_links in found.items() if name.startswith("TD")} == {
        "TD(λ), η = 0.16": {3, 4, 5},
        "TD(λ), η = 0.01, the paper's": {3, 4, 5},
    }


def test_means_intervals_and_the_swimmer_that_is_compared(check_whole, check_apart):
    speeds = {"one": {3: np.array([1.0, 1.2]), 5: np.array([2.0])}, "two": {4: np.array([0.5, 0.7, 0.9])}}
    figure = speed_by_links(speeds, Known("mine", 6, 1.7))
    axes = figure.axes[0]
    lines = {line.get_label(): line for line in axes.lines}
    np.testing.assert_allclose(lines["one"].get_ydata(), [1.1, np.nan, 2.0])  # there is none of 4 links
    np.testing.assert_allclose(lines["one"].get_xdata().round(), [0, np.nan, 2])
    np.testing.assert_allclose(lines["two"].get_ydata(), [0.7])
    np.testing.assert_array_equal(lines["mine"].get_xydata(), [[3, 1.7]])
    np.testing.assert_array_equal(lines["open-loop wave"].get_ydata(), list(OPEN_LOOP_SPEED.values()))
    assert axes.get_xticks().tolist() == [0, 1, 2, 3]
    assert [label.get_text() for label in axes.get_xticklabels()] == ["3", "4", "5", "6"]
    intervals = [line.get_ydata() for line in axes.lines if line.get_linewidth() == 2.2]
    assert len(intervals) == 2, "of a single seed none"
    assert [np.mean(ends) for ends in intervals] == [np.mean([1.0, 1.2]), 0.7] or np.allclose(
        [np.mean(ends) for ends in intervals], [1.1, 0.7]
    )
    check_whole(figure)
    check_apart(figure)
