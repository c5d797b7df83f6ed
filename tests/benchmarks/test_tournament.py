"""Peers: their gradients against other statements of them, their targets by hand; and how they are compared."""

import csv
import dataclasses
import json

import numpy as np
import pytest
import torch
import tournament
import tournament_results
import yardstick
from peers.apg import Apg, ApgSettings
from peers.cfvi import Cfvi, CfviSettings
from peers.engine import SwimEngine
from peers.ours import Ours, OursSettings
from peers.sb3 import OffPolicySettings, PpoSettings, Td3Settings, inputs, ppo, sac, td3
from peers.shac import Shac, ShacSettings, td_lambda_targets

import swimmer_mj
from swimmer_mj.compiled.vectors import LANES
from swimmer_mj.learning.problems.differentiable import transition
from swimmer_mj.learning.problems.forms import TorchForm
from swimmer_mj.learning.problems.swim import Swimming
from swimmer_mj.parameters import SwimmerParameters

UNEQUAL = Swimming(SwimmerParameters(4, mass=[0.5, 1.0, 1.5, 0.7], length=[1.2, 0.8, 1.0, 0.6]))


def states_and_torques():
    rng = np.random.default_rng(0)
    x = torch.from_numpy(UNEQUAL.initial_states(rng, LANES).T.copy())
    return x.requires_grad_(True), torch.from_numpy(rng.uniform(-5, 5, (3, LANES))).requires_grad_(True)


def test_a_held_step_and_its_gradients_are_those_of_the_equations():
    engine, (x, u) = SwimEngine(UNEQUAL, hold=3), states_and_torques()
    y, velocity = engine.step(x, u)
    state, seen = x.T, []
    for _ in range(3):
        state = transition(UNEQUAL.form(TorchForm), state, u.T, 0.01)
        seen.append(state[:, 8])
    mean = torch.stack(seen).mean(dim=0)
    torch.testing.assert_close(y, state.T, rtol=1e-11, atol=1e-12)
    torch.testing.assert_close(velocity, mean, rtol=1e-11, atol=1e-12)
    some = torch.linspace(-1.0, 2.0, y.numel(), dtype=torch.float64).view(y.shape)
    found = torch.autograd.grad((some * y).sum() + velocity.square().sum(), (x, u))
    expected = torch.autograd.grad((some * state.T).sum() + mean.square().sum(), (x, u))
    for a, b in zip(found, expected, strict=True):
        torch.testing.assert_close(a, b, rtol=1e-9, atol=1e-10)
    assert engine.simulation_steps == engine.gradient_evaluations == 3 * LANES


def test_what_does_not_fit_is_refused():
    with pytest.raises(ValueError, match=r"N a multiple of 16; got \(10, 16\) and \(3, 8\)"):
        SwimEngine(UNEQUAL).forward(np.zeros((10, 16)), np.zeros((3, 8)))


def test_targets_of_td_lambda():
    rewards, V = torch.rand(5, 2, dtype=torch.float64), torch.rand(6, 2, dtype=torch.float64)
    one_step = rewards + 0.9 * V[1:]
    torch.testing.assert_close(td_lambda_targets(rewards, V, 0.9, 0.0), one_step)
    whole = sum(0.9**t * rewards[t] for t in range(5)) + 0.9**5 * V[5]
    torch.testing.assert_close(td_lambda_targets(rewards, V, 0.9, 1.0)[0], whole)
    # n-step returns, weighted by (1 - lam) lam^(n - 1), the last by what is left
    returns = [sum(0.9**t * rewards[t] for t in range(n)) + 0.9**n * V[n] for n in range(1, 6)]
    mixed = sum(0.3 * 0.7 ** (n - 1) * returns[n - 1] for n in range(1, 5)) + 0.7**4 * returns[4]
    torch.testing.assert_close(td_lambda_targets(rewards, V, 0.9, 0.7)[0], mixed)


def test_a_policy_is_followed_uphill_through_the_model():
    """The change of the discounted velocity in a small step along the gradient is the square of its norm."""
    learner = Apg(UNEQUAL, ApgSettings(trajectories=LANES, horizon=8, hold=2), seed=0)
    actor, x = learner.actor.double(), learner.trajectories.begin_window()

    def value():
        state, total = x, torch.zeros(LANES, dtype=torch.float64)
        for t in range(8):
            z = UNEQUAL.inputs(state.T)
            u = (learner.actor.limits * torch.tanh(actor.mean(z))).T.contiguous()
            state, velocity = learner.engine.step(state, u)
            total = total + 0.9**t * velocity
        return total.mean()

    before = value()
    gradient = torch.autograd.grad(before, list(actor.mean.parameters()))
    norm = torch.sqrt(sum(g.square().sum() for g in gradient))
    h = 1e-5
    with torch.no_grad():
        for w, g in zip(actor.mean.parameters(), gradient, strict=True):
            w += h * g / norm
    assert float((value() - before).detach() / h) == pytest.approx(float(norm), rel=1e-3)


@pytest.mark.parametrize(
    ("make", "settings"),
    [
        (Apg, ApgSettings(trajectories=LANES, horizon=5)),
        (Shac, ShacSettings(trajectories=LANES, horizon=5)),
        (Cfvi, CfviSettings(trajectories=64, steps=5, minibatch=32)),
    ],
)
def test_the_same_seed_learns_the_same(make, settings):
    torques = []
    states = Swimming().initial_states(np.random.default_rng(1), 7)
    for seed in (0, 0, 1):
        learner = make(Swimming(), settings, seed)
        before = learner.policy()(states)
        for _ in range(3):
            learner.learn()
        torques.append(learner.policy()(states))
        assert torques[-1].shape == (7, 4)
        assert np.abs(torques[-1]).max() <= 5.0
        if make is not Cfvi:  # whose torques are at their limits
            assert not np.array_equal(before, torques[-1])
    np.testing.assert_array_equal(torques[0], torques[1])
    assert not np.array_equal(torques[0], torques[2])


def test_cfvi_fits_the_value_and_nothing_else():
    """Fitted to the same targets for longer, V comes closer to them."""
    errors = []
    for passes in (1, 30):
        learner = Cfvi(
            Swimming(), CfviSettings(trajectories=64, steps=8, minibatch=64, passes=passes), seed=0
        )
        assert not learner.engine.slope_weights.any()
        batch, _ = learner.engine.collect(learner.weights, learner.states, np.ones((8, 64, 4)))
        learner.learn()
        out = torch.zeros_like(learner.weights)
        errors.append(learner.engine.loss_gradient(learner.weights, batch, 0, out)[0])
    assert errors[1] < 0.5 * errors[0]


@pytest.mark.parametrize(
    ("make", "settings"),
    [
        (ppo, PpoSettings(n_envs=4, n_steps=25, batch_size=50, hold=10, hidden=16)),
        (sac, OffPolicySettings(n_envs=4, gradient_steps=1, hold=10, hidden=16, batch_size=8)),
        (td3, Td3Settings(n_envs=4, gradient_steps=1, hold=10, hidden=16, batch_size=8)),
    ],
)
def test_learners_without_the_model_learn_and_count(make, settings):
    torques = []
    states = Swimming().initial_states(np.random.default_rng(1), 7)
    for seed in (0, 0, 1):
        learner = make(Swimming(), settings, seed)
        before = learner.policy()(states)
        for _ in range(2):
            learner.learn()
        assert learner.simulation_steps == 2 * 25 * 4 * 10
        torques.append(learner.policy()(states))
        assert torques[-1].shape == (7, 4)
        assert np.abs(torques[-1]).max() <= 5.0
        assert not np.array_equal(before, torques[-1])
    np.testing.assert_array_equal(torques[0], torques[1])
    assert not np.array_equal(torques[0], torques[2])
    actions, _ = learner.model.predict(inputs(states), deterministic=True)
    np.testing.assert_allclose(torques[-1], 5.0 * actions)  # N m
    assert learner.model.gamma == pytest.approx(np.exp(-0.3 * 0.1))


def test_ours_are_the_two_that_train_has():
    joints = Ours(Swimming(), OursSettings(), 0).learner.problem
    assert (joints.coordinates, joints.held) == ("joints", True)
    state = Ours(Swimming(), OursSettings(form="state, instant"), 0).learner.problem
    assert (state.coordinates, state.held) == ("links", False)


def looks_at(name, sample, speeds, stage="tune", seed="7", given="8"):
    """Rows of looks after 1, 2, .. s."""
    common = {"stage": stage, "algorithm": name, "sample": str(sample), "settings": f'{{"rate": {sample}}}'}
    return [
        common
        | {
            "seed": seed,
            "given": given,
            "cpu_seconds": str(i + 1.0),
            "simulation_steps": str(100 * (i + 1)),
            "gradient_evaluations": str(10 * (i + 1)),
            "speed": str(speed),
            "steady_speed": str(speed + 0.5) if i + 1 >= float(given) / 2 else "",
        }
        for i, speed in enumerate(speeds)
    ]


def test_the_mean_of_the_last_window_decides():
    """The best look is not in it, nor is the last one all of it."""
    once = looks_at("apg", 0, [0.0, 9.0, 9.0, 1.0, 1.0, 1.0, 1.0, 1.0])
    last = looks_at("apg", 1, [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.5])
    assert tournament.last_window(last) == pytest.approx(1.1)
    found = tournament.tuned([*once, *last, *looks_at("shac", 0, [5.0] * 8)], "apg")
    assert found == {0: (1.0, {"rate": 0}), 1: (pytest.approx(1.1), {"rate": 1})}
    assert tournament.best([*once, *last], "apg") == (1, {"rate": 1})


def test_the_thrifty_one_has_our_settings_but_for_what_it_changes():
    rows = [*looks_at("ours", 0, [1.0] * 8), *looks_at("ours", 1, [2.0] * 8)]
    sample, settings = tournament.best(rows, "ours-thrifty")
    assert (sample, settings["rate"]) == (1, 1)
    learner = Ours(Swimming(), OursSettings(**settings), 0).learner
    assert learner.settings.steps_per_round == 64 * OursSettings().steps
    assert learner.settings.passes == 2


def test_a_log_is_gone_on_with_and_the_fastest_goes_into_the_final(tmp_path, monkeypatch):
    out = tmp_path / "log.csv"
    for stage in ("tune", "start", "final"):
        monkeypatch.setitem(tournament.STAGES, stage, tournament.STAGES[stage]._replace(first=0.2))
    monkeypatch.setattr(yardstick, "N_EPISODES", 2)
    monkeypatch.setattr(tournament, "SPEED", (0.5, 1.0))
    monkeypatch.setattr(tournament, "STEADY", (1.0, 2.0))
    for _ in range(2):
        tournament.main("tune", ("apg",), samples=2, seconds=0.4, out=out)
    rows = tournament.read(out)
    assert {row["sample"] for row in rows} == {"0", "1"}
    assert {row["seed"] for row in rows} == {"1000", "1001"}
    assert len({tuple(row.values()) for row in rows}) == len(rows)
    assert len({(row["sample"], row["simulation_steps"]) for row in rows}) == len(rows), (
        "each was learned once"
    )
    assert all(row["steady_speed"] for row in rows if float(row["cpu_seconds"]) >= 0.2)
    sample, settings = tournament.best(rows, "apg")
    scores = {key: score for key, (score, _) in tournament.tuned(rows, "apg").items()}
    assert scores[sample] == max(scores.values())
    changes = {} if sample == 0 else tournament.tried("apg", 2)[1]
    assert settings == dataclasses.asdict(ApgSettings(**changes))
    tournament.main("final", ("apg",), seeds=(3,), seconds=0.4, out=out)
    final = [row for row in tournament.read(out) if row["stage"] == "final"]
    assert {(row["seed"], row["settings"], row["version"]) for row in final} == {
        ("3", json.dumps(settings), swimmer_mj.__version__)
    }
    for stage in ("start", "all"):  # what is there is not done again
        tournament.main(
            stage, ("apg",), samples=2, seeds=(3,), seconds=0.6 if stage == "start" else 0.4, out=out
        )
    start = [row for row in tournament.read(out) if row["stage"] == "start"]
    assert len({row["simulation_steps"] for row in start}) == len(start) > len(final)
    assert {(row["seed"], row["settings"]) for row in start} == {("3", json.dumps(settings))}
    with out.open() as file:
        assert next(csv.reader(file)) == list(tournament.COLUMNS)


def test_who_takes_part_with_which_seeds():
    tuning = tournament.entries("tune", None, 2, None)
    assert len({*tuning}) == len(tuning) == 2 * (len(tournament.PEERS) - len(tournament.LIKE_OURS))
    final = tournament.entries("final", None, 2, None)
    assert len({*final}) == len(final) == 10 * len(tournament.PEERS)
    assert {seed for name, seed in final if name == "ours-thrifty"}.isdisjoint(tournament.FINAL_SEEDS)
    assert {seed for name, seed in final if name != "ours-thrifty"} == {*tournament.FINAL_SEEDS}
    assert tournament.entries("start", ("apg", "shac"), 2, (7, 8)) == [
        ("apg", 7), ("shac", 7), ("apg", 8), ("shac", 8),
    ]  # fmt: skip
    assert {name for name, _ in tournament.entries("start", None, 2, None)} == {*tournament.CLOSER}


def append(log, rows):
    with log.open("a", newline="") as file:
        writer = csv.DictWriter(file, tournament.COLUMNS)
        writer.writerows(row | {"version": "0", "wall_seconds": row["cpu_seconds"]} for row in rows)


@pytest.fixture
def log(tmp_path):
    """Two seeds of ours, of SHAC and of PPO."""
    out = tmp_path / "log.csv"
    rows = [
        *looks_at("ours", 0, [1.2, 2.1, 2.2, 2.5], "final", "0", "4"),
        *looks_at("ours", 0, [0.9, 2.1, 2.1, 2.3], "final", "1", "4"),
        *looks_at("shac", 0, [0.2, 0.8, 1.0, 1.2], "final", "0", "4"),
        *looks_at("shac", 0, [0.2, 0.8, 0.9, 0.8], "final", "1", "4"),
        *looks_at("ppo", 0, [0.0, 0.1, 0.2, 0.3], "final", "0", "4"),
    ]
    out.write_text(",".join(tournament.COLUMNS) + "\n")
    append(out, rows)
    return out


def test_of_the_start_the_closer_looks_count(log):
    """Up to their end; from there on those of the final, as far as they are further on. On a core that is twice as
    fast they take half the time, which is no merit of the learner's."""
    start = looks_at("shac", 0, [0.5, 0.9, 1.5], "start", "0", "1")
    steps = (50, 125, 350)
    append(
        log,
        [
            row | {"cpu_seconds": str(step / 200), "simulation_steps": str(step)}
            for row, step in zip(start, steps, strict=True)
        ],
    )
    one, other = tournament_results.finalists(log)["shac"]
    np.testing.assert_array_equal(one.cpu_seconds, [0.5, 1.25, 3.5, 4.0])
    np.testing.assert_array_equal(one.simulation_steps, [*steps, 400])
    np.testing.assert_array_equal(one.speed, [0.5, 0.9, 1.5, 1.2])
    np.testing.assert_array_equal(other.speed, [0.2, 0.8, 0.9, 0.8])
    assert one.given == 4.0
    assert tournament_results.finals(log).rows[1][3:5] == ("> 3.75 (1)", "> 3.75 (1)")


def test_the_final_in_a_table(log):
    ours, shac, ppo = tournament_results.finals(log).rows
    assert ours[3:7] == ("1.5 (2)", "2 (2)", "2 (2)", "> 4 (1)")
    assert ours[7:] == ("2.27, 2.17", "2.77, 2.67")
    assert shac[3:7] == ("> 3.5 (1)", "none", "none", "none")
    assert ppo[1:4] == ("1", "4", "none")


def test_ours_beside_the_soonest_peer(log):
    rows = tournament_results.against_the_fastest(log).rows
    assert rows[0][0] == "1.0 m/s"
    assert rows[0][2:] == (
        "median 1.5 s, 2 of 2, 1 by the first look",
        "SHAC: median > 3.5 s, 1 of 2",
        "at most 0.43",
        "1/3: missed",
    )
    assert [row[1] for row in rows[:3]] == ["s", "steps", "gradients"]
    assert [row[-1] for row in rows[:3]] == ["1/3: missed", "1/2: met", ""]
    assert rows[3][3:] == ("no peer got there", "", "")


def test_a_goal_counts_as_met_by_known_medians_alone(log):
    for seed in ("5", "6", "7"):  # and so the median of ours is not known
        append(log, looks_at("ours", 0, [0.1], "final", seed, "4"))  # stopped after 1 s: it may take for ever
    rows = tournament_results.against_the_fastest(log).rows
    assert [row[-1] for row in rows[:3]] == ["1/3: missed", "1/2: missed", ""]


def test_who_makes_no_gradients_is_not_first_by_them(log):
    fast = [
        row | {"gradient_evaluations": "0"}
        for row in looks_at("sac", 0, [1.0, 1.0, 1.0, 1.0], "final", "0", "4")
    ]
    append(log, fast)
    rows = tournament_results.against_the_fastest(log).rows
    assert rows[0][3].startswith("SAC")
    assert rows[2][3].startswith("SHAC")


def test_of_peers_the_one_that_may_be_soonest_counts(log):
    """SHAC's median is 3.5 s or more."""
    names = tournament_results.NAMES
    for name, looks, soonest in (
        ("td3", [0.1, 0.2, 0.8, 1.1], f"{names['shac']}: median > 3.5 s, 1 of 2"),
        ("apg", [0.1, 0.9, 1.0, 1.1], f"{names['apg']}: median 3 s, 1 of 1"),
    ):
        append(log, looks_at(name, 0, looks, "final", "0", "4"))
        assert tournament_results.against_the_fastest(log).rows[0][3] == soonest


def test_any_of_ours_can_be_held_beside_the_soonest_peer(log):
    append(log, looks_at("ours-thrifty", 0, [0.5, 2.1, 2.1], "final", "0", "4"))
    summary = tournament_results.against_the_fastest(log, "ours-thrifty")
    assert summary.header[2] == "value gradients, thrifty"
    assert summary.rows[0][2:] == (
        "median 2 s, 1 of 1",
        "SHAC: median > 3.5 s, 1 of 2",
        "at most 0.57",
        "1/3: missed",
    )


def test_the_share_that_is_there(log):
    spent, share = tournament_results.share_there(
        tournament_results.finalists(log)["ours"], 2.4, "cpu_seconds"
    )
    np.testing.assert_array_equal(spent, [4.0, 4.0])
    np.testing.assert_array_equal(share, [0.0, 0.5])
    spent, share = tournament_results.share_there(
        tournament_results.finalists(log)["ours"], 1.0, "cpu_seconds"
    )
    np.testing.assert_array_equal(spent, [1.0, 1.0, 2.0, 2.0])
    np.testing.assert_array_equal(share, [0.0, 0.5, 0.5, 1.0])
    tournament_results.draw(tournament_results.finalists(log))
