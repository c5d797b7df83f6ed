"""The figure of section 3.4, from the committed logs."""

import numpy as np
import pytest

from swimmer_mj.learning.experiments import LOGS, section_3_4
from swimmer_mj.learning.experiments.section_3_4 import METHODS, TASKS
from swimmer_mj.learning.experiments.tables import read_table, rows_where
from swimmer_mj.render.second_order import METHOD_LABELS, draw_section_3_4


@pytest.fixture(scope="module")
def panels():
    return np.reshape(draw_section_3_4().axes, (len(TASKS), 4))


@pytest.mark.parametrize(("row", "problem"), [*enumerate(TASKS)])
def test_draws_the_median_of_all_seeds_of_each_method(panels, row, problem):
    table = rows_where(read_table(LOGS / section_3_4.LEARNING_LOG), problem=problem)
    lines = {line.get_label(): line for line in panels[row, 0].lines}
    for method in METHODS:
        runs = rows_where(table, method=method)
        for trial, middle in lines[METHOD_LABELS[method]].get_xydata():
            reward = rows_where(runs, trial=trial)["reward"]
            assert len(reward) == 8
            assert middle == pytest.approx(np.median(reward))


@pytest.mark.parametrize(("row", "problem"), [*enumerate(TASKS)])
def test_draws_each_weight_of_one_run(panels, row, problem):
    table = rows_where(read_table(LOGS / section_3_4.WEIGHTS_LOG), problem=problem)
    hidden, output = panels[row, 2].lines
    for line, of_output in ((hidden, 0), (output, 1)):
        weights = rows_where(table, output=of_output)
        np.testing.assert_array_equal(line.get_xdata(), weights["curvature"])
        np.testing.assert_array_equal(line.get_ydata(), weights["noise"])
    network = TASKS[problem]
    inputs, n = network.problem.n_inputs, network.neurons
    assert len(output.get_xdata()) == inputs + n
    assert len(hidden.get_xdata()) == sum(inputs + 1 + i for i in range(n - 1))


@pytest.mark.parametrize(("row", "problem"), [*enumerate(TASKS)])
def test_draws_noise_and_rank_correlation_of_each_method(panels, row, problem):
    table = rows_where(read_table(LOGS / section_3_4.NOISE_LOG), problem=problem)
    last = table["trial"].max()
    for method, line in zip(METHODS, panels[row, 3].lines, strict=True):
        values = rows_where(table, method=method, trial=last)["rank_correlation"]
        assert line.get_ydata()[-1] == pytest.approx(np.median(values))
    for k, method in enumerate(METHODS):
        middle, low = panels[row, 1].lines[2 * k : 2 * k + 2]
        rows = rows_where(table, method=method, trial=last)
        assert middle.get_ydata()[-1] == pytest.approx(np.median(rows["noise_p50"]))
        assert low.get_ydata()[-1] == pytest.approx(np.median(rows["noise_p05"]))
