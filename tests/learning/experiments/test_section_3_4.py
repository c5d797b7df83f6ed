"""Section 3.4's comparison: that each method sets the rates that it should, and what is reported of it."""

import dataclasses

import numpy as np
import pytest
import torch

from swimmer_mj.learning.experiments import LOGS, section_3_4
from swimmer_mj.learning.experiments.section_3_4 import (
    METHODS,
    NOISE_HEADER,
    TASKS,
    Candidate,
    Team,
    best,
    noise_and_curvature,
)
from swimmer_mj.learning.experiments.tables import read_table, rows_where
from swimmer_mj.learning.networks.networks import Cascade
from swimmer_mj.learning.td import levenberg_marquardt
from swimmer_mj.learning.td.continuous_td import TDSettings
from swimmer_mj.learning.td.fused import FusedTD
from swimmer_mj.learning.td.population import PopulationTD
from swimmer_mj.learning.td.vario_eta import VarioEta

SMALL = dataclasses.replace(
    TASKS["pendulum"],
    neurons=5,
    trials=4,
    sweep_trials=2,
    every=2,
    noise_every=4,
    sweep_every=1,
    candidates=tuple(Candidate(method, 0.05, 0.1) for method in METHODS),
)


def test_fixed_rates_and_vario_eta_are_those_of_the_learner_alone():
    candidates = [Candidate("plain", 0.05), Candidate("output scaled", 0.1), Candidate("vario-eta", 0.1, 0.2)]
    team = Team(SMALL, [(candidate, 7) for candidate in candidates])
    team.train(6)
    connected = team.connected
    vario = VarioEta(epsilon=0.2, initial_variance=SMALL.initial_variance)
    settings = (
        TDSettings(eta=0.05, output_scaling=False),
        TDSettings(eta=0.1, output_scaling=True),
        TDSettings(eta=0.1, output_scaling=False, vario=vario),
    )
    for k, own in enumerate(settings):
        network = Cascade(3, 5, generator=torch.Generator().manual_seed(7))
        learner = FusedTD(SMALL.problem, network, own, rate_each=True)
        alone, rng, noise = PopulationTD([learner]), np.random.default_rng(7), 0.0
        for _ in range(6):
            before, rate = network.weight.detach().clone(), learner.rate.clone()
            alone.train(SMALL.problem.initial_states(rng, 1)[None])
            gradient = (network.weight.detach() - before)[network.connected] / rate[network.connected]
            noise = 0.99 * noise + 0.01 * gradient.numpy() ** 2
        assert (network.weight[-1].abs() > 1e-3).all()
        assert team.weights[k] == pytest.approx(network.weight.detach().numpy(), rel=1e-3, abs=1e-5)
        assert team.rate[k] == pytest.approx(learner.rate.numpy(), rel=1e-3)
        assert team.noise[k, connected] == pytest.approx(noise, rel=1e-3, abs=1e-6)


def test_levenberg_marquardt_follows_the_curvature_of_where_trials_began_and_ended():
    eta, mu = 0.05, 0.1
    team = Team(SMALL, [(Candidate("plain", 0.05), 0), (Candidate("Levenberg-Marquardt", eta, mu), 1)])
    connected = team.connected
    h = np.ones(connected.shape)
    assert team.rate[1, connected] == pytest.approx(eta / (1 + mu))
    rng = np.random.default_rng(1)
    for trial in range(4):
        team.train(1)
        began, ended = team.visited[trial, 1]
        assert began == pytest.approx(SMALL.problem.initial_states(rng, 1)[0])
        assert np.abs(ended - began).max() > 0.1
        weight, z = team.weights[1], team.inputs(np.stack([began, ended]))
        new = levenberg_marquardt.gauss_newton_diagonal(weight, levenberg_marquardt.fire(weight, z))
        h = 0.99 * h + 0.01 * (new[0] + new[1]) / 2
        assert team.rate[1, connected] == pytest.approx(eta / (h[connected] + mu), rel=1e-6)
        assert team.learners[1].rate.numpy()[connected] == pytest.approx(team.rate[1, connected], rel=1e-6)
    assert team.rate[0, connected] == pytest.approx(0.05)
    assert np.ptp(team.rate[1, connected]) > 1e-4


def test_the_reported_squared_gradient_is_the_mean_of_autograds_over_recent_states():
    team = Team(SMALL, [(Candidate("plain", 0.05), 0), (Candidate("output scaled", 0.05), 1)])
    team.train(3)
    network = team.learners[1].network
    states = torch.tensor(team.visited[:3, 1].reshape(6, 2), dtype=torch.float32)
    gradients = [
        torch.autograd.grad(network(SMALL.problem.inputs(x)), network.weight)[0] * network.connected
        for x in states
    ]
    expected = (torch.stack(gradients) ** 2).mean(dim=0).numpy()
    assert team.curvature(1)[1] == pytest.approx(expected, rel=1e-3, abs=1e-7)


def test_a_diverged_run_is_marked_and_measured():
    team = Team(SMALL, [(Candidate("plain", 1e6), 0), (Candidate("plain", 0.01), 0)])
    team.train(3)
    (*_, lost_reward, _, lost), (*_, reward, _, kept) = team.evaluate()
    assert (lost, kept) == (1.0, 0.0)
    assert np.isfinite([lost_reward, reward]).all()


def test_packs_go_on_where_they_were_and_find_the_same(tmp_path):
    half = dataclasses.replace(SMALL, trials=2, noise_every=2)
    whole = dataclasses.replace(SMALL, trials=6, noise_every=2)
    arguments = (SMALL.candidates, (3, 4, 5, 6, 7))  # two packs
    section_3_4.compare(half, *arguments, keep=tmp_path)
    assert {path.name for path in tmp_path.glob("*.safetensors")} == {
        "pack-0.safetensors",
        "pack-1.safetensors",
    }
    found = section_3_4.compare(whole, *arguments, keep=tmp_path)
    expected = section_3_4.compare(whole, *arguments)
    assert len(found.learning) == 4 * 5 * 4
    for log, other in zip(found, expected, strict=True):
        assert log == other
    with pytest.raises(
        ValueError, match=r"pack-0.safetensors holds runs with other settings; choose another"
    ):
        section_3_4.compare(whole, SMALL.candidates, (3, 4, 5, 6, 8), keep=tmp_path)


def test_the_best_setting_has_the_largest_area_and_no_diverged_run():
    def rows(candidate, rewards, diverged=0.0):
        return [("p", *candidate, k, 10, reward, diverged) for k, reward in enumerate(rewards)]

    a, b, c = Candidate("plain", 0.1), Candidate("plain", 0.3), Candidate("plain", 1.0)
    vario = Candidate("vario-eta", 0.1, 0.01)
    table = [
        *rows(a, [0.0, 1.0]),
        *rows(b, [0.8, 0.8]),
        *rows(c, [2.0, 2.0], 1.0),
        *rows(vario, [-1.0, -1.0]),
    ]
    assert best(table) == {"plain": b, "vario-eta": vario}


def test_noise_and_curvature_of_weights_with_a_known_relation():
    """Two neurons on 2 inputs: v = h^2 for the hidden neuron's weights; ranks reversed for the output's."""
    connected = np.array([[True, True, True, False], [True, True, True, True]])
    h = np.array([[1.0, 2.0, 3.0, np.nan], [40.0, 50.0, 60.0, 70.0]])
    v = np.array([[1.0, 4.0, 9.0, np.nan], [0.4, 0.3, 0.2, 0.1]])
    named = dict(
        zip(NOISE_HEADER[4:], noise_and_curvature(v, h, np.where(connected, v, 0), connected), strict=True)
    )
    assert named["noise_min"] == 0.1
    assert named["noise_p50"] == 0.4
    assert named["curvature_p50"] == 40.0
    assert named["ratio_p50"] == pytest.approx(0.01)
    assert named["rank_correlation_hidden"] == pytest.approx(1)
    assert named["rank_correlation"] < -0.5
    assert named["rank_correlation_gradient"] == pytest.approx(1)
    lost = noise_and_curvature(np.full((2, 4), np.nan), h, h, connected)
    assert len(lost) == len(named)
    assert np.isnan(lost).all()


def test_runs_twice_alike(tmp_path):
    logs = (section_3_4.SWEEP_LOG, section_3_4.LEARNING_LOG, section_3_4.NOISE_LOG, section_3_4.WEIGHTS_LOG)
    texts = []
    for name in ("a", "b"):
        section_3_4.run(tmp_path / name, tasks=[SMALL], seeds=[0, 1], sweep_seeds=[5])
        texts.append([(tmp_path / name / log).read_text() for log in logs])
    assert texts[0] == texts[1]
    learning = read_table(tmp_path / "a" / section_3_4.LEARNING_LOG)
    assert len(learning["seed"]) == 4 * 2 * 3
    assert len(read_table(tmp_path / "a" / section_3_4.NOISE_LOG)["seed"]) == 4 * 2
    assert np.unique(learning["trial"]).tolist() == [0, 2, 4]
    weights = read_table(tmp_path / "a" / section_3_4.WEIGHTS_LOG)
    assert len(weights["noise"]) == 4 + 5 + 6 + 7 + 8


@pytest.mark.parametrize("problem", TASKS)
def test_the_committed_runs_are_whole_and_have_the_settings_of_the_sweep(problem):
    sweep = rows_where(read_table(LOGS / section_3_4.SWEEP_LOG), problem=problem)
    learning = rows_where(read_table(LOGS / section_3_4.LEARNING_LOG), problem=problem)
    task = TASKS[problem]
    assert not {*sweep["seed"]} & {*learning["seed"]}
    assert {*map(tuple, zip(sweep["method"], sweep["eta"], sweep["bound"], strict=True))} == {
        tuple(c) for c in task.candidates
    }
    chosen = best(list(zip(*sweep.values(), strict=True)))
    for method in METHODS:
        runs = rows_where(learning, method=method)
        assert {*zip(runs["eta"], runs["bound"], strict=True)} == {chosen[method][1:]}
        for seed in range(8):
            assert rows_where(runs, seed=seed)["trial"].tolist() == [*range(0, task.trials + 1, task.every)]
