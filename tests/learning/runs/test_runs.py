import csv
import dataclasses
import json
import os
import shutil
import signal
import socket
import subprocess
import sys

import numpy as np
import pytest
import torch

from swimmer_mj.learning.networks.policy import GreedyPolicy
from swimmer_mj.learning.problems.cart_pole import CartPole
from swimmer_mj.learning.problems.forms import CostForm, EpisodeForm
from swimmer_mj.learning.problems.pendulum import Pendulum
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.learning.runs import together
from swimmer_mj.learning.runs.checkpoint import load_checkpoint
from swimmer_mj.learning.runs.config import RunConfig, read_config
from swimmer_mj.learning.runs.lock import RunInUseError
from swimmer_mj.learning.runs.run import (
    Metrics,
    TrainingRun,
    evaluation_sample,
    evaluation_starts,
    load_policy,
)
from swimmer_mj.learning.runs.together import Pack, train_together
from swimmer_mj.learning.td.continuous_td import ContinuousTD, TDSettings
from swimmer_mj.learning.td.method import TDLearning, TemporalDifferences
from swimmer_mj.learning.td.vario_eta import VarioEta
from swimmer_mj.learning.value_gradient.method import ValueGradients
from swimmer_mj.learning.value_gradient.settings import ValueGradientSettings
from swimmer_mj.parameters import SwimmerParameters

SETTINGS = TDSettings(eta=0.04, trial_duration=1.0)


def small(seed=0, evaluate_every=20, **changes):
    """A run of TD(lambda) on the pendulum; changes of the method's settings, or of the learner's."""
    of_learner = {name: changes.pop(name) for name in list(changes) if hasattr(SETTINGS, name)}
    settings = dataclasses.replace(SETTINGS, **of_learner)
    method = TemporalDifferences(settings, **{"neurons": 10, **changes})
    return RunConfig(Pendulum(), method, seed, evaluate_every)


SMALL = small()


@dataclasses.dataclass(frozen=True)
class Brief(Pendulum):
    """Judged in a second, where that takes Python and torch."""

    def form(self, kind):
        return EpisodeForm(1.0, 0.5, 0.01) if kind is EpisodeForm else Pendulum().form(kind)


@dataclasses.dataclass(frozen=True)
class Dear(Brief):
    """One whose torque costs."""

    def form(self, kind):
        return (
            CostForm(lambda x: np.full((*x.shape[:-1], 1), 0.1)) if kind is CostForm else super().form(kind)
        )


@dataclasses.dataclass(frozen=True)
class Apart(Brief):
    """One whose initial states are drawn number by number: all angles, then all angular velocities."""

    def initial_states(self, rng, count):
        return np.stack([rng.uniform(-np.pi, np.pi, count), rng.uniform(-5.0, 5.0, count)], axis=-1)


def advance(run, **kwargs):
    """The metrics of one run, of the next period."""
    metrics = Pack([run]).advance(**kwargs)
    return None if metrics is None else metrics[0]


def saved(run, name):
    return load_checkpoint(run.directory / f"{name}.safetensors")[0]


def tensors_of(run):
    return saved(run, "checkpoint")


def rows_of(run):
    """metrics.csv without the column of wall-clock time."""
    with open(run.directory / "metrics.csv", newline="") as file:
        rows = list(csv.reader(file))
    return [[value for i, value in enumerate(row) if i != 1] for row in rows]


@pytest.mark.parametrize("vario", [None, VarioEta()])
def test_an_interrupted_run_computes_the_same_bits(tmp_path, vario):
    config = small(vario=vario, dtype="float64")
    whole = TrainingRun(tmp_path / "whole", config)
    for _ in range(3):
        advance(whole)

    run = TrainingRun(tmp_path / "parts", config)
    advance(run, stretch=7)
    assert advance(run, stretch=3, stop=lambda: True) is None  # cut off in the middle of a period
    assert [row[0] for row in rows_of(run)] == ["trial", "20"]
    resumed = TrainingRun(tmp_path / "parts", resume=True)
    assert 20 < resumed.trial == run.trial < 40  # it goes on in the middle of the period
    assert resumed.seconds == run.seconds
    advance(resumed)
    resumed = TrainingRun(tmp_path / "parts", resume=True)
    assert resumed.trial == 40
    advance(resumed, stretch=1)

    assert rows_of(resumed) == rows_of(whole)
    assert len(rows_of(whole)) == 4
    for name, tensor in tensors_of(whole).items():
        assert torch.equal(tensors_of(resumed)[name], tensor)
    assert resumed.best_speed == whole.best_speed
    assert resumed.seconds > 0


@pytest.mark.parametrize("engine", ["fused", "population", "stepped", "torch"])
def test_what_is_learned_in_portions_is_the_same_for_any_law_of_initial_states(tmp_path, engine):
    brief = {} if engine in ("fused", "population") else {"trial_duration": 0.2, "neurons": 3}
    config = dataclasses.replace(small(evaluate_every=10, engine=engine, **brief), problem=Apart())
    whole, parts = (TrainingRun(tmp_path / name, config) for name in ("whole", "parts"))
    advance(whole, stretch=10)
    advance(parts, stretch=1)
    assert torch.equal(whole.learning.network.weight, parts.learning.network.weight)
    assert whole.learning.network.weight.abs().sum() > 0


def test_seeds_differ_and_repeat(tmp_path):
    def weights(name, seed):
        run = TrainingRun(tmp_path / name, small(seed))
        advance(run)
        return tensors_of(run)["weight"]

    assert torch.equal(weights("a", 1), weights("b", 1))
    assert not torch.equal(weights("c", 1), weights("d", 2))


def test_keeps_the_best_weights(tmp_path):
    run = TrainingRun(tmp_path / "run", SMALL)
    speeds = iter([0.1, 0.5, 0.3])
    run.learning.rewards = lambda *_: np.array([next(speeds)])
    weights = []
    for _ in range(3):
        advance(run)
        weights.append(run.learning.network.weight.detach().clone())
    best, _, info = load_policy(run.directory)
    assert info["speed"] == 0.5
    assert info["trial"] == 40
    assert torch.equal(best.network.weight, weights[1])
    last, _, _ = load_policy(run.directory, "last")
    assert torch.equal(last.network.weight, weights[2])
    with pytest.raises(ValueError, match="which must be 'best' or 'last', got 'Best'"):
        load_policy(run.directory, "Best")


def test_without_a_number_there_are_no_best_weights(tmp_path):
    run = TrainingRun(tmp_path / "run", SMALL)
    run.learning.rewards = lambda *_: np.array([0.25, np.nan])  # an episode has run away
    assert np.isnan(advance(run).speed)
    assert json.loads((run.directory / "checkpoint.json").read_text())["best_speed"] is None
    with pytest.raises(
        FileNotFoundError, match=r"best\.safetensors is not there: no evaluation gave a number"
    ):
        load_policy(run.directory)
    assert load_policy(run.directory, "last")[2]["trial"] == 20
    resumed = TrainingRun(tmp_path / "run", resume=True)
    resumed.learning.rewards = lambda *_: np.array([0.25])
    advance(resumed)
    assert load_policy(run.directory)[2]["speed"] == resumed.best_speed == 0.25


def test_what_a_run_leaves(tmp_path):
    run = TrainingRun(tmp_path / "run", SMALL)
    metrics = advance(run)
    names = {
        "config.json",
        "metrics.csv",
        *(f"{n}.{s}" for n in ("checkpoint", "best") for s in ("safetensors", "json")),
    }
    assert {p.name for p in run.directory.iterdir()} == names
    with open(run.directory / "metrics.csv", newline="") as file:
        (row,) = csv.DictReader(file)
    assert list(row) == ["trial", "seconds", "mean_value", "mean_squared_hamiltonian", "speed"]
    assert Metrics(*(float(value) for value in row.values())) == metrics
    sample = run.learning.fused.sample(run.problem.initial_states(np.random.default_rng(1), 1000))
    assert metrics is not None
    assert metrics.mean_value == pytest.approx(sample.value.mean())
    assert metrics.mean_squared_hamiltonian == pytest.approx((sample.hamiltonian**2).mean())


def test_a_configuration_survives_its_file(tmp_path):
    parameters = SwimmerParameters(4, [1, 2, 3, 4], 0.5, 3.0, [1, 2, 3])
    settings = TDSettings(eta=0.02, vario=VarioEta(beta=0.05), output_scaling=False)
    config = RunConfig(Swimming(parameters, 0.7), TemporalDifferences(settings, 12, "float64"), 3)
    run = TrainingRun(tmp_path / "run", config)
    assert read_config(run.directory) == config
    values = config.to_json()
    assert RunConfig.from_json(values) == config
    assert RunConfig.from_json(values) == config  # reading has not changed them
    assert json.loads((run.directory / "config.json").read_text())["problem"]["parameters"]["mass"] == [
        1,
        2,
        3,
        4,
    ]


def test_does_not_overwrite_a_run(tmp_path):
    run = TrainingRun(tmp_path / "run", SMALL)
    advance(run)
    before = (run.directory / "metrics.csv").read_text()
    with pytest.raises(FileExistsError, match="already holds a run; resume it, or choose another"):
        TrainingRun(tmp_path / "run", SMALL)
    assert (run.directory / "metrics.csv").read_text() == before


def test_refuses_what_is_no_run(tmp_path):
    with pytest.raises(FileNotFoundError, match="there is no run to resume"):
        TrainingRun(tmp_path / "none", resume=True)
    with pytest.raises(FileNotFoundError, match="is not a run directory"):
        read_config(tmp_path)
    (tmp_path / "config.json").write_text('{"seed": 1}')
    with pytest.raises(ValueError, match="is not the configuration of a run"):
        read_config(tmp_path)


def test_says_when_learning_diverges(tmp_path):
    config = small(eta=1e6)
    run = TrainingRun(tmp_path / "run", config)
    with pytest.raises(
        FloatingPointError, match=r"finite after trial \d+, which began at x = \[.*\]: eta 1000000.0"
    ):
        train_together([run], trials=400)


def test_runs_that_diverge_do_not_stop_the_others(tmp_path):
    """In a pack: both are named at the end, stand where they were saved, and the others compute their own bits."""

    def make(name, eta, seed):
        return TrainingRun(tmp_path / name, small(seed, engine="population", eta=eta))

    good, worse, better, worst = (
        make(name, eta, seed)
        for seed, (name, eta) in enumerate([("good", 0.04), ("worse", 1e6), ("better", 0.02), ("worst", 1e9)])
    )
    advance(better)
    with pytest.raises(FloatingPointError, match=r"worse: weights are no .*; .*worst: weights are no longer"):
        train_together([good, worse, better, worst], trials=60, workers=1)
    assert [run.trial for run in (good, worse, better, worst)] == [60, 0, 60, 0]
    assert all(torch.isfinite(run.learning.network.weight).all() for run in (worse, worst))
    assert worse.history == []
    for run in (good, better):
        alone = make(f"{run.directory.name}-alone", run.config.method.settings.eta, run.config.seed)
        train_together([alone], trials=60)
        assert torch.equal(tensors_of(alone)["weight"], tensors_of(run)["weight"])
        assert rows_of(alone) == rows_of(run)


def test_value_gradients_that_diverge_are_named(tmp_path):
    def make(name, **changes):
        settings = ValueGradientSettings(trajectories=32, steps=5, minibatch=32, dt=0.05, **changes)
        return TrainingRun(tmp_path / name, RunConfig(Brief(), ValueGradients(settings, (8,)), 0, 2))

    good, bad = make("good"), make("bad", learning_rate=1e30)
    with pytest.raises(
        FloatingPointError,
        match=r"bad: the loss is no longer finite in round \d+, whose .* at x = \[.*\]: learn",
    ):
        train_together([bad, good], trials=4, workers=1)
    assert (good.trial, bad.trial, bad.history) == (4, 0, [])


def test_a_trial_of_value_gradients_is_as_long_as_one_of_td(tmp_path):
    """Two trials of 5 s are two rounds of 32 trajectories x 5 steps of 0.05 s."""
    settings = ValueGradientSettings(trajectories=32, steps=5, minibatch=32, dt=0.05)
    run = TrainingRun(tmp_path / "run", RunConfig(Brief(), ValueGradients(settings, (8,)), 0, 2))
    advance(run)
    assert (run.trial, run.learning.learner.rounds) == (2, 2)


def test_both_engines_run_the_same_run(tmp_path):
    weights = []
    for engine in ("fused", "torch"):
        run = TrainingRun(tmp_path / engine, small(dtype="float64", evaluate_every=3, engine=engine))
        advance(run)
        weights.append(tensors_of(run)["weight"])
    assert (weights[0] - weights[1]).abs().max() < 1e-11
    assert weights[0].abs().sum() > 0


def test_controls_are_held_in_an_evaluation_for_as_long_as_the_problem_says():
    @dataclasses.dataclass(frozen=True)
    class Slow(Pendulum):
        def form(self, kind):
            return EpisodeForm(3.0, 1.0, 0.2) if kind is EpisodeForm else Pendulum().form(kind)

    learning = TemporalDifferences(SETTINGS, neurons=4).start(Slow(), 0)
    learning.learn(100)
    states = Slow().initial_states(np.random.default_rng(0), 20)
    held, hasty = (learning.fused.rollout(states, 3.0, 1.0, dt).reward for dt in (0.2, 0.01))
    assert (learning.rewards(states, 3.0, 1.0) == held).all()
    assert np.abs(held - hasty).max() > 1e-3


def test_controls_that_cost_are_learned_by_the_reference_for_many_seeds_too(tmp_path):
    method = TemporalDifferences(SETTINGS, neurons=4).for_seeds(Dear(), 16)
    learning = TrainingRun(tmp_path / "run", RunConfig(Dear(), method)).learning
    learning.learn(2)
    states = learning.problem.initial_states(np.random.default_rng(0), 20)
    policy = GreedyPolicy(Dear(), learning.network)
    assert learning.judge(states)[1] == pytest.approx(policy.judge(states).hamiltonian, rel=1e-6)
    mean = policy.episodes(states, np.full(50, 0.02), 0.01)
    assert learning.rewards(states, 0.5, 0.0) == pytest.approx(mean, rel=1e-6)


def test_another_integrator_is_learned_with_step_by_step_for_many_seeds_too():
    problem = Swimming(SwimmerParameters(n_links=3), integrator="rk4")
    settings = dataclasses.replace(SETTINGS, trial_duration=0.05)
    method = TemporalDifferences(settings, neurons=4, dtype="float64").for_seeds(problem, 16)
    learning = method.start(problem, 0)
    learning.learn(1)
    reference = ContinuousTD(problem, method.network(problem, 0), settings)
    reference.run_trial(problem.initial_states(np.random.default_rng(0), 1)[0])
    assert reference.network.weight[-1].abs().max() > 0
    assert torch.allclose(learning.network.weight, reference.network.weight, rtol=1e-10, atol=1e-14)


def test_a_pack_computes_what_its_runs_compute_alone(tmp_path):
    def make(directory, engine):
        rates = [(0.01, 1.0, None), (0.04, 2.0, None), (0.04, 1.0, VarioEta())]
        return [
            TrainingRun(
                tmp_path / directory / f"{i}",
                small(i, dtype="float64", engine=engine, eta=eta, s_lambda=s, vario=vario),
            )
            for i, (eta, s, vario) in enumerate(rates)
        ]

    together, singles = make("pack", "population"), make("singles", "fused")
    train_together(together, trials=40, workers=1)
    for pack_run, single in zip(together, singles, strict=True):
        advance(single)
        advance(single)
        assert pack_run.trial == single.trial == 40
        assert (pack_run.learning.network.weight - single.learning.network.weight).abs().max() < 1e-12
        assert torch.allclose(pack_run.learning.fused.rate, single.learning.fused.rate, rtol=1e-9)
        assert single.learning.network.weight.abs().sum() > 0
    alone = TrainingRun(tmp_path / "alone", together[1].config)
    advance(alone)
    resumed = TrainingRun(tmp_path / "alone", resume=True)
    train_together([resumed], trials=40)
    # Not bit for bit: beside vario-eta each weight has a rate of its own, alone each neuron, which is another kernel.
    assert torch.allclose(
        resumed.learning.network.weight, together[1].learning.network.weight, rtol=0, atol=1e-12
    )


def test_value_gradients_resume_and_load(tmp_path):
    settings = ValueGradientSettings(trajectories=32, steps=10, minibatch=64)
    problem = Swimming(SwimmerParameters(n_links=3), s_gamma=0.5)
    config = RunConfig(problem, ValueGradients(settings, (8, 8)), 3, 2)
    whole = TrainingRun(tmp_path / "whole", config)
    advance(whole)
    advance(whole)
    parts = TrainingRun(tmp_path / "parts", config)
    advance(parts, stretch=1)
    assert advance(parts, stretch=1, stop=lambda: True) is None  # cut off in the middle of a period
    parts = TrainingRun(tmp_path / "parts", resume=True)
    assert parts.config == config
    assert parts.learning.learner.simulation_steps >= 2 * 500  # it does not begin again, to the same end
    advance(parts)
    assert rows_of(parts) == rows_of(whole)
    assert whole.learning.learner.simulation_steps >= 4 * 500
    for a, b in zip(whole.learning.network.parameters(), parts.learning.network.parameters(), strict=True):
        assert torch.equal(a, b)
    policy, _, _ = load_policy(tmp_path / "parts", "last")
    states = whole.problem.initial_states(np.random.default_rng(0), 5)
    assert policy.judge(states).value == pytest.approx(whole.learning.judge(states)[0], rel=1e-5)
    assert not np.allclose(policy.judge(states).value, 0)


def test_runs_together_stop_at_a_number_of_trials(tmp_path):
    runs = [TrainingRun(tmp_path / f"seed-{s}", small(s)) for s in range(3)]
    reports = []
    train_together(runs, trials=50, report=reports.append, workers=2)
    assert [run.trial for run in runs] == [60, 60, 60]
    assert sum(report.metrics is not None for report in reports) == 9
    alone = TrainingRun(tmp_path / "alone", small(2))
    for _ in range(3):
        advance(alone)
    assert torch.equal(alone.learning.network.weight, runs[2].learning.network.weight)


def test_runs_together_stop_when_one_is_good_enough(tmp_path):
    runs = [TrainingRun(tmp_path / f"seed-{s}", small(s)) for s in range(2)]
    train_together(runs, enough=lambda run: run.trial >= 40)
    assert max(len(run.history) for run in runs) == 2


def test_runs_together_stop_in_time_and_what_was_never_evaluated_is(tmp_path):
    run = TrainingRun(tmp_path / "run", small(evaluate_every=10**9))
    reports = []
    train_together([run], seconds=0.2, report=reports.append)
    (row,) = run.history
    assert reports[-1].metrics == row
    first = run.trial
    assert row.trial == first > 0
    train_together([run], seconds=0.2)  # it has a result: what is learned now waits for its evaluation
    resumed = TrainingRun(tmp_path / "run", resume=True)
    assert resumed.history == [row]
    assert resumed.trial == run.trial > first
    assert torch.equal(resumed.learning.network.weight, run.learning.network.weight)
    assert load_policy(tmp_path / "run", "last")[2]["trial"] == first


def test_a_run_that_is_told_to_stop_before_its_first_evaluation_stops_at_once(tmp_path):
    run = TrainingRun(tmp_path / "run", small(evaluate_every=10**9))
    train_together([run], seconds=1e-3, stop=lambda: run.trial > 0)
    assert run.history == []
    assert TrainingRun(tmp_path / "run", resume=True).trial == run.trial > 0


def test_an_evaluation_in_between_moves_no_other(tmp_path):
    run, whole = (TrainingRun(tmp_path / name, small()) for name in ("run", "whole"))
    assert advance(run, stop=lambda: True) is None
    run.save(run.evaluate(run.seconds))
    for one in (run, run, whole, whole):
        advance(one)
    assert [row.trial for row in run.history][1:] == [20, 40]
    assert rows_of(run)[2:] == rows_of(whole)[1:]
    assert torch.equal(run.learning.network.weight, whole.learning.network.weight)


def test_more_runs_than_workers_share_the_time(tmp_path):
    runs = [TrainingRun(tmp_path / f"seed-{s}", small(s, evaluate_every=10**9)) for s in range(5)]
    train_together(runs, seconds=1.5, workers=2)
    assert min(run.trial for run in runs) > 0


@pytest.mark.parametrize("engine", ["fused", "population", "stepped", "torch"])
def test_a_run_that_is_stopped_goes_on_where_it_stood(tmp_path, engine):
    config = small(engine=engine, neurons=4, trial_duration=0.2)
    run = TrainingRun(tmp_path / "run", config)
    advance(run)
    assert advance(run, stretch=3, stop=lambda: True) is None
    assert run.trial == 21
    assert torch.equal(run.learning.network.weight, saved(run, "unfinished")["weight"])
    whole = TrainingRun(tmp_path / "whole", config)
    for one in (whole, whole, run):
        advance(one)
    assert rows_of(run) == rows_of(whole)
    assert torch.equal(run.learning.network.weight, whole.learning.network.weight)


def test_runs_that_were_killed_at_different_moments_go_on_in_one_pack(tmp_path):
    """One at an evaluation, one between two of them, one at its beginning: each computes its own bits."""

    def make(name):
        return [TrainingRun(tmp_path / f"{name}-{s}", small(s, engine="population")) for s in range(3)]

    runs, whole = make("run"), make("whole")
    advance(runs[0])
    advance(runs[1], stop=lambda: True)
    runs = [TrainingRun(run.directory, resume=True) for run in runs]
    assert [run.trial for run in runs] == [20, 1, 0]
    for trials in (20, 60):
        train_together(runs, trials=trials, workers=1)
        assert [run.trial for run in runs] == [trials] * 3
    train_together(whole, trials=60, workers=1)
    for one, other in zip(runs, whole, strict=True):
        assert rows_of(one) == rows_of(other)
        assert torch.equal(tensors_of(one)["weight"], tensors_of(other)["weight"])


def test_what_is_learned_is_saved_between_evaluations(tmp_path, monkeypatch):
    monkeypatch.setattr(together, "SAVE_SECONDS", 0.0)
    monkeypatch.setattr(together, "STRETCH_SECONDS", 1e6)  # so that no slow moment makes a stretch shorter
    run = TrainingRun(tmp_path / "run", small())
    seen = []

    def news(report):
        if report.progress is not None:
            saved = TrainingRun(tmp_path / "run", resume=True)
            seen.append((report.progress.trial, saved.trial))

    advance(run, stretch=4, report=news)
    assert seen == [(1, 0), (5, 1), (9, 5), (13, 9), (17, 13), (20, 17)]
    assert TrainingRun(tmp_path / "run", resume=True).trial == 20  # of the evaluation, which is newer


def test_learning_is_not_interrupted_for_a_save_in_vain(tmp_path):
    run = TrainingRun(tmp_path / "run", small())
    advance(run)
    run.save_unfinished()
    assert not (tmp_path / "run" / "unfinished.safetensors").exists()


# Divergence ----------------------------------------------------------------------------------------------------------


class Unlucky:
    """Makes the learner of a run diverge at some trials, once each."""

    def __init__(self, monkeypatch, *trials):
        self.trials, learn = {*trials}, TDLearning.learn

        def unlucky(learning, count):
            along = learn(learning, count)
            if self.trials & {*range(learning.trials - count + 1, learning.trials + 1)}:
                self.trials.clear()
                raise FloatingPointError("weights are no longer finite")
            return along

        monkeypatch.setattr(TDLearning, "learn", unlucky)


def test_a_run_that_diverges_can_go_on_from_its_last_evaluation(tmp_path, monkeypatch):
    def diverging(name, stretch, stop_at=None):
        """A run that diverges in trial 33; with another stretch, or after an interruption, at the same bits."""
        run = TrainingRun(tmp_path / name, small())
        with monkeypatch.context() as patch:
            Unlucky(patch, 33)
            pack, reports = Pack([run], restore=True), []
            pack.advance(stretch=stretch)
            if stop_at is not None:
                pack.advance(stretch=stretch, stop=lambda: run.trial >= stop_at)
                run = TrainingRun(tmp_path / name, resume=True)
                pack = Pack([run], restore=True)
            pack.advance(stretch=stretch, report=reports.append)
        (warning,) = [report.warning for report in reports if report.warning]
        assert warning.endswith(
            "finite; it goes on from trial 20, as last evaluated, with other random numbers (1 of 10 times)"
        )
        return run

    run = diverging("run", 100)
    assert (run.trial, run.restores, len(run.history)) == (40, 1, 2)
    undisturbed = TrainingRun(tmp_path / "undisturbed", small())
    for _ in range(2):
        advance(undisturbed)
    assert rows_of(run)[:2] == rows_of(undisturbed)[:2]
    assert rows_of(run)[2] != rows_of(undisturbed)[2]
    for other in (diverging("other", 3), diverging("interrupted", 2, stop_at=30)):
        assert rows_of(other) == rows_of(run)
        assert torch.equal(tensors_of(other)["weight"], tensors_of(run)["weight"])
    assert TrainingRun(run.directory, resume=True).restores == 1


@pytest.mark.parametrize("engine", ["fused", "population"])
def test_a_run_that_always_diverges_stops_in_the_end(tmp_path, engine):
    run = TrainingRun(tmp_path / "run", small(eta=1e6, engine=engine))
    reports = []
    with pytest.raises(FloatingPointError, match=r"1000000.0 is too large; it stands at trial 0, its beg"):
        train_together([run], trials=400, on_divergence="restore", report=reports.append)
    *warnings, last = [report.warning for report in reports if report.warning]
    assert len(warnings) == together.RESTORES
    assert len({*warnings}) == len(warnings)
    assert last.endswith("it stands at trial 0, its beginning")
    assert run.trial == 0
    assert torch.isfinite(run.learning.network.weight).all()


def fails(*_):
    raise FloatingPointError("an episode left what can be simulated")


def test_an_evaluation_that_fails_is_a_divergence(tmp_path):
    runs = [TrainingRun(tmp_path / name, small(engine="population")) for name in ("run", "other")]
    advance(runs[0])
    runs[0].learning.rewards = fails
    with pytest.raises(
        FloatingPointError, match="left what can be simulated; it stands at trial 20, as last"
    ):
        train_together(runs, trials=40, workers=1)
    assert [run.trial for run in runs] == [20, 40]
    again = TrainingRun(runs[0].directory, resume=True)
    again.learning.rewards = fails
    train_together([again], trials=40, on_divergence="restore")  # the learner is a new one then
    assert (again.trial, again.restores) == (40, 1)


def test_an_evaluation_that_fails_when_the_time_is_over_leaves_no_result(tmp_path):
    run = TrainingRun(tmp_path / "run", small(evaluate_every=10**9))
    run.learning.rewards = fails
    with pytest.raises(FloatingPointError, match="left what can be simulated; it was not evaluated"):
        train_together([run], seconds=0.2)
    assert run.history == []
    assert TrainingRun(tmp_path / "run", resume=True).trial == run.trial > 0


def test_seconds_go_on_after_a_divergence(tmp_path):
    run = TrainingRun(tmp_path / "run", small())
    advance(run)
    run.seconds += 1000.0  # of learning what has diverged then
    run.restart()
    assert run.seconds > 1000.0
    assert run.trial == 20
    advance(run)
    assert run.history[-1].seconds > 1000.0


def test_value_gradients_start_again_with_other_random_numbers(tmp_path):
    settings = ValueGradientSettings(trajectories=32, steps=5, minibatch=32, dt=0.05)
    run = TrainingRun(tmp_path / "run", RunConfig(Brief(), ValueGradients(settings, (8,)), 0, 2))
    advance(run)
    weights, states = run.learning.learner._weights.clone(), run.learning.learner._states.copy()
    run.restart()
    assert torch.equal(run.learning.learner._weights, weights)
    assert (run.learning.learner._states != states).all()
    advance(run)
    assert (run.trial, run.restores) == (4, 1)


# Two processes -------------------------------------------------------------------------------------------------------


def test_a_second_process_is_refused_and_told_who_is_there(tmp_path):
    run = TrainingRun(tmp_path / "run", SMALL)
    owner = f"process {os.getpid()} on {socket.gethostname()}"
    with run.held():
        before = {path.name: path.read_bytes() for path in run.directory.iterdir()}
        for refused in (
            lambda: TrainingRun(tmp_path / "run", resume=True),
            lambda: train_together([run], trials=20),
        ):
            with pytest.raises(
                RunInUseError, match=f"run is in use by {owner}; wait for it, or stop it with"
            ):
                refused()
        assert {path.name: path.read_bytes() for path in run.directory.iterdir()} == before
        shutil.copytree(run.directory, tmp_path / "copy")
        train_together([TrainingRun(tmp_path / "copy", resume=True)], trials=20)
    train_together([run], trials=20)
    assert {path.name for path in run.directory.iterdir()} == {
        path.name for path in (tmp_path / "copy").iterdir()
    }


def test_the_lock_of_a_process_that_was_killed_holds_nobody(tmp_path):
    run = TrainingRun(tmp_path / "run", SMALL)
    code = (
        "import os, signal; from pathlib import Path; from swimmer_mj.learning.runs.lock import locked\n"
        f"with locked(Path({str(run.directory)!r})): os.kill(os.getpid(), signal.SIGKILL)"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == -signal.SIGKILL
    assert (run.directory / ".lock").exists()
    (run.directory / ".checkpoint.1.partial.safetensors").write_bytes(b"half a f")
    train_together([run], trials=20)
    assert not any(path.name.startswith(".") for path in run.directory.iterdir())


def test_what_another_process_has_learned_meanwhile_is_not_overwritten(tmp_path):
    early = TrainingRun(tmp_path / "run", SMALL)
    train_together([TrainingRun(tmp_path / "run", resume=True)], trials=20)
    with pytest.raises(
        RunInUseError, match="was changed by another process since it was read; resume it again"
    ):
        train_together([early], trials=20)
    assert TrainingRun(tmp_path / "run", resume=True).trial == 20


def test_a_run_may_be_removed_while_it_is_held(tmp_path):
    run = TrainingRun(tmp_path / "run", SMALL)
    with run.held():
        shutil.rmtree(run.directory)
    assert not run.directory.exists()


@pytest.mark.parametrize(
    ("groups", "workers", "sizes"),
    [
        ([5], 4, [1, 1, 1, 2]),
        ([8], 2, [4, 4]),
        ([17], 1, [8, 9]),
        ([2], 4, [1, 1]),
        ([16, 16], 1, [16, 16]),
        ([6, 1], 3, [1, 3, 3]),
    ],
)
def test_packs_are_balanced_and_as_many_as_there_are_workers(tmp_path, groups, workers, sizes):
    """Runs of one group may learn in step, those of several may not."""
    runs = [
        TrainingRun(
            tmp_path / f"{group}-{seed}",
            small(seed, engine="population", neurons=4 + group),
        )
        for group, count in enumerate(groups)
        for seed in range(count)
    ]
    packs = Pack.of(runs, workers)
    assert sorted(len(pack.runs) for pack in packs) == sizes
    assert [run for pack in packs for run in pack.runs] == runs


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RunConfig(seed=-1), "seed must not be negative, got -1"),
        (lambda: RunConfig(evaluate_every=0), "evaluate_every must be at least 1 trial, got 0"),
        (lambda: TemporalDifferences(neurons=1), "neurons must be at least 2"),
        (lambda: ValueGradients(neurons=1), "neurons must be at least 2"),
        (
            lambda: TemporalDifferences(engine="fast"),
            "engine must be one of 'auto', 'fused', 'population', 'stepped', 'torch'; got 'fast'",
        ),
        (lambda: Swimming(initial_law="slow"), "initial_law must be one of .*'gliding'; got 'slow'"),
        (lambda: Swimming(physics="real"), "physics must be one of 'analytic', 'mujoco'; got 'real'"),
        (
            lambda: ValueGradients(layers=(8,), sigmoid="logistic"),
            "layers are of tanh units: sigmoid must be 'tanh', got 'logistic'",
        ),
    ],
)
def test_configuration_refuses(make, message):
    with pytest.raises(ValueError, match=message):
        make()


IN_MUJOCO = Swimming(physics="mujoco")


@pytest.mark.parametrize(
    ("problem", "method", "message"),
    [
        (IN_MUJOCO, ValueGradients(), "value gradients need the equations themselves, and 'swim5' is to be"),
        (
            IN_MUJOCO,
            TemporalDifferences(engine="population"),
            "learns on compiled equations, and 'swim5' is to be",
        ),
        (IN_MUJOCO, TemporalDifferences(TDSettings(vario=VarioEta())), "needs engine 'stepped'"),
        (
            CartPole(),
            TemporalDifferences(engine="fused"),
            "engine 'fused' cannot learn 'cart-pole', which has no compiled form; use engine 'stepped'",
        ),
        (
            Dear(),
            TemporalDifferences(engine="population"),
            "engine 'population' cannot learn 'pendulum', which has controls that cost; use engine 'stepped'",
        ),
        (
            IN_MUJOCO,
            TemporalDifferences(TDSettings(dt=0.005)),
            "in MuJoCo a control is held for a multiple of 0.01 s, not for 0.005 s",
        ),
        (
            Swimming(integrator="rk4"),
            TemporalDifferences(engine="fused"),
            "by Euler's method, got integrator 'rk4'",
        ),
        (Swimming(integrator="rk4"), ValueGradients(), "by Euler's method, got integrator 'rk4'"),
    ],
)
def test_a_method_that_cannot_learn_a_problem_says_so_before_anything_is_written(
    tmp_path, problem, method, message
):
    with pytest.raises(ValueError, match=message):
        TrainingRun(tmp_path / "run", RunConfig(problem, method))
    assert not (tmp_path / "run").exists()


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device to learn on")
def test_a_device_that_is_not_there_is_refused_before_anything_is_written(tmp_path):
    config = RunConfig(Swimming(), ValueGradients(device="cuda"))
    with pytest.raises(ValueError, match="torch finds no CUDA device here; learn with device 'cpu'"):
        TrainingRun(tmp_path / "run", config)
    assert not (tmp_path / "run").exists()


def test_an_evaluation_is_of_the_policy(tmp_path):
    """Means of V and H^2 over the sample of figure 2, and of the reward of the policy's episodes."""
    run = TrainingRun(tmp_path / "run", SMALL)
    run.learning.learn(20)
    metrics = run.evaluate(3.0)
    states = evaluation_sample(run.problem)
    judged = GreedyPolicy(run.problem, run.learning.network).judge(states)
    assert len(states) == 1000
    assert metrics.mean_value == pytest.approx(judged.value.mean(), rel=1e-6)
    assert metrics.mean_squared_hamiltonian == pytest.approx((judged.hamiltonian**2).mean(), rel=1e-6)
    rollout = run.learning.rewards(evaluation_starts(run.problem), 20.0, 10.0)
    assert metrics.speed == rollout.mean()
    assert (metrics.trial, metrics.seconds) == (run.trial, 3.0)
    assert abs(metrics.mean_value) > 1e-4, "it has learned something to be judged"
