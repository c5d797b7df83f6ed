"""The studies of value gradients: what is varied, what is logged, and that they go on where they were."""

from dataclasses import replace

import numpy as np
import pytest

from swimmer_mj.learning.experiments import value_gradients as studies
from swimmer_mj.learning.experiments.tables import read_table, write_table
from swimmer_mj.learning.runs.config import value_gradient_config

TINY = studies.variant(
    "batch", "tiny", trajectories=32, steps=4, minibatch=32, layers=(8, 8), trial_duration=0.08
)
LOOKS = (256, 512)


def learn_tiny(log, seeds, news):
    studies.run_study(log, [TINY], LOOKS, seeds, news.append, workers=1)
    return read_table(log)


def test_a_study_goes_on_where_it_was(tmp_path):
    log, news = tmp_path / "log.csv", []
    first = learn_tiny(log, [0], news)
    assert first["simulation_steps"].tolist() == list(LOOKS)
    assert first["weights"].tolist() == [17 * 8 + 8 + 8 * 8 + 8 + 9] * 2
    assert np.isfinite(first["speed"]).all()
    assert (first["speed"] != first["speed_last"]).all()
    both = learn_tiny(log, [0, 1], news)
    assert [line.split(",")[1].split(":")[0] for line in news] == [" seed 0", " seed 1"]
    for name, column in first.items():
        # Not computed again: even the times are the same.
        np.testing.assert_array_equal(both[name][:2], column)

    names = list(both)
    rows = list(zip(*(both[name] for name in names), strict=True))
    write_table(log, names, rows[:1] + rows[2:])  # seed 0 was interrupted after its first look
    again = learn_tiny(log, [0, 1], news)
    assert len(news) == 3
    assert "seed 0" in news[-1]
    for name in ("seed", "simulation_steps", "speed", "speed_last"):
        np.testing.assert_allclose(again[name], both[name], rtol=1e-5)  # of six digits in the log


def test_a_study_of_fewer_keeps_what_is_logged_of_others(tmp_path):
    log = tmp_path / "log.csv"
    other = ("lookahead", "3", 7, 1.0, 256, 1.5, 0.25, 0.125)
    interrupted = ("batch", "tiny", 1, 1.0, 256, 1.5, 0.25, 0.125)
    done = ("batch", "tiny", 0, 1.0, 512, 1.5, 0.5, 0.375)
    write_table(log, studies.COLUMNS, [other, interrupted, done])
    studies.run_study(log, [TINY], LOOKS, [0], pytest.fail, workers=1)
    table = read_table(log)
    rows = list(zip(*(table[name].tolist() for name in studies.COLUMNS), strict=True))
    assert rows == [done, other, interrupted]  # those asked for come first


@pytest.mark.parametrize("workers", [1, 2])
def test_a_learner_that_diverges_has_rows_of_nan_and_the_others_go_on(tmp_path, workers):
    wild = studies.variant("learning rate", "wild", learning_rate=1e30, trajectories=32, steps=4, minibatch=32,
                           layers=(8, 8))  # fmt: skip
    log, news = tmp_path / "log.csv", []
    studies.run_study(log, [wild, TINY], LOOKS, [0], news.append, workers=workers)
    table = read_table(log)
    assert table["factor"].tolist() == ["learning rate"] * 2 + ["batch"] * 2
    assert table["simulation_steps"].tolist() == [*LOOKS, *LOOKS]
    assert (
        np.isnan(table["speed"]).tolist()
        == np.isnan(table["speed_last"]).tolist()
        == [True] * 2 + [False] * 2
    )
    assert any(line.startswith("learning rate: wild, seed 0: diverged after") for line in news)
    studies.run_study(log, [wild, TINY], LOOKS, [0], pytest.fail, workers=1)  # it is done


def test_each_variant_differs_from_the_chosen_settings_and_from_the_others():
    chosen, *others = studies.ABLATIONS
    config = value_gradient_config()
    squares = replace(
        config.method, settings=replace(config.method.settings, huber=None)
    )  # as they were chosen
    assert (chosen.problem, chosen.method) == (config.problem, squares)
    configs = [(one.problem, one.method) for one in studies.ABLATIONS]
    assert all(a != b for i, a in enumerate(configs) for b in configs[:i])
    assert len({one.label for one in studies.ABLATIONS}) == len(configs)
    for one in others:
        steps = one.method.settings.steps_per_round
        assert steps == pytest.approx(chosen.method.settings.steps_per_round, rel=0.05)


def test_the_cascade_of_equal_weights_has_them():
    cascade, layers = (
        studies.count_weights(one.method.network(one.problem, 0))
        for one in (studies.variant("", "", layers=None, neurons=studies.EQUAL_WEIGHTS), studies.ABLATIONS[0])
    )
    assert (cascade, layers) == (5307, 5377)


def test_looks_grow_from_the_first_to_the_last():
    assert studies._every(100, 800, 2.0) == (100, 200, 400, 800)
