"""Peers that use the model: their gradients against other statements of them, their targets by hand."""

import csv

import model_peers
import numpy as np
import pytest
import torch
from peers.apg import Apg, ApgSettings
from peers.cfvi import Cfvi, CfviSettings
from peers.engine import SwimEngine
from peers.shac import Shac, ShacSettings, td_lambda_targets

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


def test_a_log_is_gone_on_with_and_the_fastest_goes_into_the_final(tmp_path, monkeypatch):
    out = tmp_path / "log.csv"
    monkeypatch.setattr(model_peers, "FIRST_LOOK", 0.01)
    for _ in range(2):
        model_peers.main("tune", ("apg",), samples=2, seconds=0.02, out=out)
    rows = model_peers.read(out)
    assert {row["sample"] for row in rows} == {"0", "1"}
    assert {row["seed"] for row in rows} == {"1000", "1001"}
    assert len({tuple(row.values()) for row in rows}) == len(rows)
    assert len({(row["sample"], row["cpu_seconds"]) for row in rows}) == len(rows), "each was learned once"
    last = {row["sample"]: float(row["speed"]) for row in rows}
    sample, settings = model_peers.best(rows, "apg")
    assert last[str(sample)] == max(last.values())
    assert settings == ({} if sample == 0 else model_peers.tried("apg", 2)[1])
    with out.open() as file:
        assert next(csv.reader(file)) == list(model_peers.COLUMNS)
