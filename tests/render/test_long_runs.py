"""Figure 2 and the sweep, from logs made here."""

import numpy as np
import pytest

from swimmer_mj.learning.experiments import what_decides
from swimmer_mj.learning.experiments.tables import write_table
from swimmer_mj.learning.runs.run import Metrics
from swimmer_mj.render.long_runs import draw_long_runs, draw_what_decides


def test_long_runs_show_medians_and_what_became_of_each_peak(tmp_path, check_whole):
    speeds = {"paper": [[0.2, 0.9, 0.3], [0.4, 0.5, 0.6], [0.3, 0.1, 0.8]], "tuned": [[1.0, 1.5], [0.5, 1.4]]}
    rows = [
        (preset, seed, *Metrics(20_000 * (k + 1), 1.0, 0.1 + k, 0.2, speed))
        for preset, runs in speeds.items()
        for seed, run in enumerate(runs)
        for k, speed in enumerate(run)
    ]
    write_table(tmp_path / "swim5.csv", ("preset", "seed", *Metrics._fields), rows)
    figure = draw_long_runs("swim5", tmp_path)
    value, _, speed, fall = figure.axes
    medians = {line.get_label(): line for line in speed.lines if not line.get_label().startswith("_")}
    labels = [r"$\eta$ = 0.01 (the paper's), 3 seeds", r"$\eta$ = 0.16, 2 seeds"]
    assert list(medians) == labels
    assert medians[labels[0]].get_ydata() == pytest.approx([0.3, 0.5, 0.6])
    assert medians[labels[1]].get_xdata() == pytest.approx([20_000, 40_000])
    assert value.lines[0].get_ydata() == pytest.approx([0.1, 1.1, 2.1])
    falls = [line.get_ydata() for line in fall.lines if len(line.get_xdata()) == 2]
    assert np.array(falls) == pytest.approx(
        np.array([[0.3, 0.9], [0.4, 0.4], [0.1, 0.3], [1.0, 1.0], [0.5, 0.5]])
    )
    check_whole(figure)


def test_what_decides_shows_the_end_of_each_setting(tmp_path, check_whole):
    rows = [
        (factor, setting, seed, seconds, 0.1, 0.2, speed * seconds / 2000 + 0.1 * seed)
        for factor, setting, speed in (("baseline", "as chosen", 1.0), ("eta", "0.16", 0.4))
        for seed in range(3)
        for seconds in (1000, 2000)
    ]
    write_table(tmp_path / what_decides.LOG, what_decides.COLUMNS, rows)
    figure = draw_what_decides(tmp_path)
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["baseline: as chosen", "eta: 0.16"]
    means = [line.get_xdata()[0] for line in axes.lines if line.get_marker() == "o"]
    assert means == pytest.approx([1.1, 0.5])
    check_whole(figure)


def test_a_single_seed_is_drawn_without_an_interval(tmp_path):
    rows = [("baseline", "as chosen", 0, 1000, 0.1, 0.2, 0.7), ("eta", "0.16", 0, 1000, 0.1, 0.2, 0.4)]
    write_table(tmp_path / what_decides.LOG, what_decides.COLUMNS, rows)
    figure = draw_what_decides(tmp_path)
    lines = figure.axes[0].lines
    assert [line.get_xdata()[0] for line in lines if line.get_marker() == "o"] == pytest.approx([0.7, 0.4])
    assert all(np.isnan(line.get_xdata()).all() for line in (lines[1], lines[4]))
