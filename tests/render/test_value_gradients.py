"""The figures of the studies of value gradients, from logs made here."""

import numpy as np
import pytest

from swimmer_mj.learning.experiments import value_gradients as studies
from swimmer_mj.learning.experiments.tables import write_table
from swimmer_mj.render.value_gradients import draw_ablation, draw_lasting, draw_links

MILLION = 1_000_000


def write_log(path, settings, speeds):
    """Learners (setting, seed) with a speed at each of a few looks, 10 s of processor time apart."""
    rows = [
        (*setting, seed, 5377, (k + 1) * MILLION, 10.0 * (k + 1), speed, speed - 0.1)
        for setting, of_seeds in zip(settings, speeds, strict=True)
        for seed, of_seed in enumerate(of_seeds)
        for k, speed in enumerate(of_seed)
    ]
    write_table(path, studies.COLUMNS, rows)


def test_ablation_shows_speed_and_time_of_each_setting(tmp_path, check_whole):
    settings = [("as chosen", ""), ("lookahead", "none (l = 0)")]
    speeds = [[[1.6, 2.0], [1.7, 2.2], [1.4, 2.1]], [[0.5, 1.0], [0.6, 1.6], [0.7, 1.1]]]
    write_log(tmp_path / studies.ABLATION_LOG, settings, speeds)
    figure = draw_ablation(tmp_path)
    speed, time = figure.axes
    assert [label.get_text() for label in speed.get_yticklabels()] == ["as chosen", "lookahead: none (l = 0)"]
    means = [line.get_xdata()[0] for line in speed.lines if line.get_marker() == "o"]
    assert means == pytest.approx([2.1, 1.2333333])
    means = [line.get_xdata()[0] for line in time.lines if line.get_marker() == "o"]
    assert means == pytest.approx([40 / 3])  # no mean of a setting with which some do not get there
    ticks = [line.get_xdata().tolist() for line in time.lines if line.get_marker() == "|"]
    assert ticks == [[10.0, 10.0, 20.0], [20.0]]
    assert [text.get_text() for text in time.texts] == ["1 of 3"]
    check_whole(figure)


def test_a_learner_that_diverged_never_reached_anything(tmp_path, check_whole):
    """It counts as one that lies still from then on."""
    nan = float("nan")
    setting, speeds = [("as chosen", "")], [[[1.6, 2.0, 2.1], [1.4, nan, nan], [nan, nan, nan]]]
    write_log(tmp_path / studies.ABLATION_LOG, setting, speeds)
    figure = draw_ablation(tmp_path)
    speed, time = figure.axes
    (mean,) = (line.get_xdata()[0] for line in speed.lines if line.get_marker() == "o")
    assert mean == pytest.approx(0.7)
    assert [text.get_text() for text in time.texts] == ["1 of 3"]
    write_log(tmp_path / studies.LINKS_LOG, [("links", "3")], speeds)
    curves, best = draw_links(tmp_path).axes
    (median,) = (line for line in curves.lines if not line.get_label().startswith("_"))
    assert median.get_ydata() == pytest.approx([1.4, 0.0, 0.0])
    (mean,) = (line.get_ydata()[0] for line in best.lines if line.get_marker() == "o")
    assert mean == pytest.approx(3.5 / 3)
    write_log(tmp_path / studies.LASTING_LOG, setting, speeds)
    _, share = draw_lasting(tmp_path).axes
    assert share.lines[1].get_ydata() == pytest.approx([1, 0, 0])
    assert share.lines[2].get_ydata() == pytest.approx([0, 0, 0])


def test_links_shows_the_best_of_each_seed(tmp_path, check_whole):
    settings = [("links", "3"), ("links", "10")]
    write_log(tmp_path / studies.LINKS_LOG, settings, [[[0.5, 0.9], [0.7, 0.6]], [[1.0, 3.0], [1.0, 2.0]]])
    figure = draw_links(tmp_path)
    _, best = figure.axes
    means = [line.get_xydata()[0].tolist() for line in best.lines if line.get_marker() == "o"]
    assert np.array(means) == pytest.approx(np.array([[0, 0.8], [1, 2.5]]))
    assert [label.get_text() for label in best.get_xticklabels()] == ["3", "10"]
    check_whole(figure)


def test_lasting_shows_the_fall_from_the_best_so_far(tmp_path, check_whole):
    settings = [(one.factor, one.setting) for one in studies.LASTING]
    write_log(tmp_path / studies.LASTING_LOG, settings, [[[1.0, 2.0, 1.5], [1.0, 1.1, 1.2]], [[1.0, 0.5]]])
    figure = draw_lasting(tmp_path)
    _, share = figure.axes
    assert share.lines[0].get_ydata() == pytest.approx([1, 1, 0.75])
    assert share.lines[1].get_ydata() == pytest.approx([1, 1, 1])
    assert len(share.lines) == 3  # the last one is the mark at 95 %
    check_whole(figure)
