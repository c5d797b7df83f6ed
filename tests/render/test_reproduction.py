"""The figures of the experiments, from the committed logs."""

import shutil

import numpy as np
import pytest

from swimmer_mj.learning.experiments import (
    EXPERIMENTS,
    LOGS,
    figure_1,
    hamiltonians,
    linear_approximators,
    section_3_3,
    value_bias,
)
from swimmer_mj.learning.experiments.tables import read_table, rows_where, write_table
from swimmer_mj.render.reproduction import (
    FIGURES,
    draw_figure_1,
    draw_hamiltonian,
    draw_linear,
    draw_section_3_3,
    draw_value_bias,
    extreme_weights,
)


def lines_by_label(axes):
    return {line.get_label(): line for line in axes.lines if not line.get_label().startswith("_")}


def test_each_experiment_has_its_figure():
    assert set(FIGURES) == set(EXPERIMENTS)


@pytest.mark.parametrize("name", FIGURES)
def test_is_drawn_whole_and_can_be_read_in_grey(name, check_whole, check_apart):
    figure = FIGURES[name](LOGS)
    check_whole(figure)
    check_apart(figure)


def test_figures_read_the_directory_that_they_are_given(tmp_path):
    """The same log with another weight made the noisiest draws that weight."""
    for log in EXPERIMENTS["figure-1"].logs:
        shutil.copy(LOGS / log, tmp_path / log)
    table = read_table(tmp_path / figure_1.WEIGHTS_LOG)
    noisy = (table["method"] == "basic") & (table["quantity"] == "noise")
    table["w7"] = np.where(noisy, 50.0, table["w7"])
    names = list(table)
    write_table(tmp_path / figure_1.WEIGHTS_LOG, names, zip(*(table[name] for name in names), strict=True))
    assert extreme_weights(table)[0] == 7
    line = lines_by_label(draw_figure_1(tmp_path).axes[0])["$w_1$, the noisiest of all"]
    np.testing.assert_allclose(
        line.get_ydata(), rows_where(table, method="basic", quantity="weight")["w7"], rtol=1e-5
    )


def test_figure_1_shows_a_noisy_and_a_slow_weight_every_100_trials():
    table = read_table(LOGS / figure_1.WEIGHTS_LOG)
    fast, slow = extreme_weights(table)
    assert fast >= 52  # on a connection to the output unit
    assert slow < 52
    basic, vario, _, noise, _, rate = draw_figure_1().axes
    for axes, method in ((basic, "basic"), (vario, "vario-eta")):
        lines = lines_by_label(axes)
        run = rows_where(table, method=method, quantity="weight")
        assert run["trial"].tolist() == list(range(0, 4001, 100))
        for line, k in zip(axes.lines, (fast, slow), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), run[f"w{k}"])
        assert len(axes.lines) == 2
        assert method != "basic" or len(lines) == 2
    assert len(noise.lines) == len(rate.lines) == 66


def test_section_3_3_draws_medians_of_ratios_beside_the_line_of_the_claim():
    table = read_table(LOGS / section_3_3.LOG)
    last = rows_where(table, problem="pendulum", trial=4000, output_scaling=1)
    lines = lines_by_label(draw_section_3_3().axes[0])
    claim = lines["ratio = n"]
    np.testing.assert_array_equal(claim.get_xdata(), claim.get_ydata())
    drawn = lines["4,000 trials, scaled"]
    for n, ratio in drawn.get_xydata():
        rows = rows_where(last, n=n)
        assert len(rows["seed"]) == 8
        assert ratio == pytest.approx(np.median(rows["output"] / rows["internal"]))


def test_linear_draws_each_approximator_and_extrapolates_what_was_not_measured():
    cost = read_table(LOGS / linear_approximators.COST_LOG)
    curve, weights, seconds = draw_linear().axes
    assert set(lines_by_label(curve)) == set(linear_approximators.APPROXIMATORS)
    radial = rows_where(cost, approximator="radial basis")
    np.testing.assert_allclose(radial["weights"], 5.0 ** (2 * radial["links"] + 2), rtol=1e-3)
    assert any(np.array_equal(line.get_ydata(), radial["weights"]) for line in weights.lines)
    beyond = lines_by_label(seconds)["extrapolated"]
    measured = np.isfinite(radial["seconds"])
    assert 0 < measured.sum() < len(measured)
    assert beyond.get_ydata()[0] == radial["seconds"][measured][-1]
    assert len(beyond.get_xdata()) == (~measured).sum() + 1
    assert (np.diff(np.log10(beyond.get_ydata())) > np.log10(25)).all()


def test_hamiltonian_draws_both_forms_and_marks_the_switches():
    episode = read_table(LOGS / hamiltonians.EPISODE_LOG)
    top = draw_hamiltonian().axes[0]
    gradient, difference, marks = top.lines
    np.testing.assert_array_equal(gradient.get_ydata(), episode["gradient"])
    np.testing.assert_array_equal(difference.get_ydata(), episode["difference"])
    np.testing.assert_array_equal(marks.get_xdata(), episode["time"][episode["switched"] > 0])


def test_value_bias_draws_the_states_of_each_moment():
    states = read_table(LOGS / value_bias.STATES_LOG)
    figure = draw_value_bias()
    first = rows_where(states, problem="pendulum")
    trial = first["trial"].min()
    points = rows_where(first, trial=trial)
    _, dots = figure.axes[0].lines
    np.testing.assert_array_equal(dots.get_xdata(), points["return"])
    np.testing.assert_array_equal(dots.get_ydata(), points["value"])
