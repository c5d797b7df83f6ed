"""The longer studies made small: they go on where they were, measure what they say, and choose what was best."""

import dataclasses

import numpy as np
import pytest

from swimmer_mj.learning.experiments import linear_swimmer, long_runs, noise_at_length, rates_at_length
from swimmer_mj.learning.experiments.long_runs import SWIMMERS, Swimmer
from swimmer_mj.learning.experiments.noise import NoiseMeter
from swimmer_mj.learning.experiments.section_3_3 import power_of_n
from swimmer_mj.learning.experiments.section_3_4 import METHODS, TASKS, Candidate
from swimmer_mj.learning.experiments.tables import read_table, rows_where
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs.config import RunConfig
from swimmer_mj.learning.runs.run import TrainingRun
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.method import TemporalDifferences

# Angles as inputs --------------------------------------------------------------------------------------------------


def test_the_papers_twelve_inputs_are_those_of_the_state():
    for name in long_runs.ANGLES:
        configs = long_runs.configurations(name, "paper")
        assert len(configs) == 8
        for config in configs.values():
            assert (config.problem.n_inputs, config.problem.state_size) == (12, 12)
            assert (config.method.settings.eta, config.method.neurons) == (0.01, 60)
        assert SWIMMERS[name].trials["paper"] == 1_000_000


def test_they_are_compared_with_the_committed_log_where_a_folder_has_none(tmp_path):
    rows = long_runs.paper_runs(tmp_path, 40_000.0)
    assert sorted(set(rows["trial"])) == [20_000.0, 40_000.0]
    assert len(set(rows["seed"])) == 8
    assert set(rows["preset"]) == {"paper"}
    (tmp_path / "swim5.csv").write_text("preset,seed,trial\npaper,9,20000\ntuned,8,20000\npaper,7,60000\n")
    assert long_runs.paper_runs(tmp_path, 40_000.0)["seed"].tolist() == [9.0]


def test_a_run_that_diverges_leaves_the_others_and_its_own_rows(tmp_path, monkeypatch):
    tame = Swimmer(3, 6, {"tame": 4, "wild": 4}, 1.0, etas={"tame": 0.01, "wild": 1e8})
    monkeypatch.setattr(long_runs, "SEEDS", range(2))
    monkeypatch.setattr(long_runs, "EVALUATE_EVERY", 2)
    monkeypatch.setattr(long_runs, "SWIMMERS", {"swim3": tame})
    monkeypatch.setattr(long_runs, "ANGLES", ("swim3",))
    news = []
    long_runs.run_angles(tmp_path, news.append)
    table = read_table(tmp_path / "swim3.csv")
    assert table["preset"].tolist() == ["tame"] * 4
    assert table["trial"].tolist() == [2, 4, 2, 4]
    assert "eta 100000000.0 is too large" in news[-1]


# Noise along a million trials --------------------------------------------------------------------------------------

FEW = {"neurons": (5,), "etas": (0.01, 0.04), "seeds": (0,), "metered": 3}


def test_noise_goes_on_where_it_was(tmp_path):
    whole, pieces = tmp_path / "whole", tmp_path / "pieces"
    noise_at_length.run(whole, moments=(2, 4), **FEW)
    for moments in ((2,), (2, 4)):
        noise_at_length.run(pieces, moments=moments, **FEW)
    text = (whole / noise_at_length.LOG).read_text()
    assert (pieces / noise_at_length.LOG).read_text() == text
    table = read_table(whole / noise_at_length.LOG)
    assert tuple(table) == noise_at_length.HEADER
    assert list(zip(table["eta"], table["trial"], strict=True)) == [
        (0.01, 2),
        (0.01, 4),
        (0.04, 2),
        (0.04, 4),
    ]


def test_noise_is_that_of_the_meter_and_the_runs_stay_as_they_are(tmp_path):
    method = TemporalDifferences(TDSettings(eta=0.04), 5, dtype="float64", engine="population")
    runs = [TrainingRun(tmp_path / str(seed), RunConfig(Swimming(), method, seed, 2)) for seed in (3, 4)]
    for run in runs:
        run.learning.learn(2)
        run.trial = 2
        run.save(run.evaluate(0.0))
    before = [run.learning.network.weight.detach().clone() for run in runs]
    rows = noise_at_length.measure(runs, 6)
    assert all(
        (run.learning.network.weight == weight).all() for run, weight in zip(runs, before, strict=True)
    )
    named = dict(zip(noise_at_length.HEADER, rows[1], strict=True))
    meter = NoiseMeter(FusedTD(Swimming(), runs[1].learning.network, method.settings))
    meter.train(Swimming().initial_states(np.random.default_rng([4, 2]), 6))
    assert named["output"] == pytest.approx(meter.variance[-1].mean().item(), rel=1e-6)
    assert (named["n"], named["seed"], named["trial"]) == (5, 4, 2)
    assert named["speed"] == runs[1].history[-1].speed


def test_the_exponent_is_that_of_a_power_law_and_its_interval_covers():
    rng = np.random.default_rng(0)
    n = np.repeat([15.0, 30.0, 60.0, 120.0], 8)
    inside = 0
    for _ in range(400):
        b, half, _ = power_of_n(n, 3.0 * n**0.8 * np.exp(0.3 * rng.normal(size=n.size)))
        inside += abs(b - 0.8) < half
    assert 0.92 < inside / 400 < 0.98
    assert power_of_n(n, 2.0 * n * np.exp(0.01 * rng.normal(size=n.size)))[0] == pytest.approx(1.0, abs=0.01)


# Rates -------------------------------------------------------------------------------------------------------------


def test_rates_are_compared_by_the_best_setting_and_the_best_start(tmp_path, monkeypatch):
    task = dataclasses.replace(
        TASKS["pendulum"],
        neurons=5,
        trials=2,
        every=2,
        noise_every=2,
        candidates=tuple(Candidate(method, eta, 0.1) for method in METHODS for eta in (0.01, 0.05)),
    )

    def sweep(task, seeds, report):
        """Rewards that are known: the larger eta is the better one, and of v(0) 10, though less so than eta."""
        start = -abs(np.log10(task.initial_variance) - 1.0)
        return [
            (task.problem.name, *one, seed, 4, one.eta + 1e-3 * start, 0.0)
            for one in task.candidates
            for seed in seeds
        ]

    seen = []
    compared = rates_at_length.compare

    def compare(task, candidates, *rest):
        seen.append((task.initial_variance, candidates))
        return compared(task, candidates, *rest)

    monkeypatch.setattr(rates_at_length, "sweep", sweep)
    monkeypatch.setattr(rates_at_length, "compare", compare)
    known = {"task": task, "values": (0.1, 10.0, 100.0), "seeds": (0, 1), "sweep_seeds": (5,)}
    rates_at_length.run(tmp_path, **known)
    log = read_table(tmp_path / rates_at_length.SWEEP_LOG)
    assert log["initial_variance"].tolist() == [1.0] * 8 + [0.1, 10.0, 100.0]
    assert seen == [(10.0, [Candidate(method, 0.05, 0.1) for method in METHODS])]
    assert len(read_table(tmp_path / rates_at_length.LEARNING_LOG)["seed"]) == 4 * 2 * 2
    assert (tmp_path / "runs" / "pack-0.safetensors").exists()

    monkeypatch.setattr(rates_at_length, "sweep", None)  # what is logged is not swept again
    text = (tmp_path / rates_at_length.LEARNING_LOG).read_text()
    rates_at_length.run(tmp_path, **known)
    assert seen[1] == seen[0]
    assert (tmp_path / rates_at_length.LEARNING_LOG).read_text() == text


def test_a_diverged_start_has_no_score():
    candidate = Candidate("vario-eta", 0.1, 0.01)
    rows = [("p", *candidate, 0, 10, 0.5, 0.0), ("p", *candidate, 1, 10, 0.9, 1.0)]
    assert rates_at_length.score(rows[:1], candidate) == 0.5
    assert rates_at_length.score(rows, candidate) == -np.inf


# Tile coding -------------------------------------------------------------------------------------------------------


def test_tile_coding_and_the_cascade_learn_by_the_same_trials(tmp_path, monkeypatch):
    monkeypatch.setattr(linear_swimmer, "EPISODE_DURATION", 0.3)
    monkeypatch.setattr(linear_swimmer, "SETTLING_TIME", 0.1)
    linear_swimmer.run(tmp_path, samples=2, trials=(10, 10, 10), seeds=((100,), (101,), (0,)))
    table = read_table(tmp_path / linear_swimmer.LOG)
    assert tuple(table) == linear_swimmer.HEADER
    assert {stage: int((table["stage"] == stage).sum()) for stage in ("first", "second", "final")} == {
        "first": 20,
        "second": 20,
        "final": 20,
    }
    cascade = rows_where(table, approximator="cascade")
    assert cascade["trial"].tolist() == [*range(1, 11)]
    assert (np.diff(cascade["seconds"]) >= 0).all()
    assert cascade["seconds"][-1] > 0
    assert cascade["weights"][0] == 30 * 12 + 30 * 29 / 2
    tiles = rows_where(table, approximator="tile coding")
    assert (tiles["used"] < 0.05).all()
    assert (np.diff(rows_where(tiles, stage="final")["used"]) >= 0).all()


def test_the_best_tiles_are_the_fastest_in_the_second_half():
    def rows(stage, eta, speeds):
        settings = (eta, 8, 4, 1.0, 1.0)
        return [
            (stage, "tile coding", *settings, 100, 0, 10 * (k + 1), 1.0, 0.1, 0.1, speed, 0.1)
            for k, speed in enumerate(speeds)
        ]

    log = [
        *rows("first", 1.0, [0.9, 0.9, 0.1, 0.1]),
        *rows("first", 2.0, [0, 0, 0.2, 0.2]),
        *rows("second", 3.0, [1]),
    ]
    assert [one["eta"] for one in linear_swimmer.best(log, "first", 2)] == [2.0, 1.0]
    assert linear_swimmer.best(log, "first", 1)[0] == dict(
        zip(linear_swimmer.LAWS, (2.0, 8, 4, 1.0, 1.0), strict=True)
    )
